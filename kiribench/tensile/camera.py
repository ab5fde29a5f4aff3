"""From pixels to the plane of the sheet: lens, tilt and scale, each with its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault
from kiribench.tensile.elements import Block
from kiribench.tensile.sidecar import Lens, Sidecar

FloatArray = npt.NDArray[np.float64]

TILT_LIMIT = 0.30
"""Change of scale across the block (ratio - 1) above which the view is refused."""
LENS_LIMIT = 0.04
"""Displacement by the lens / half the picture's diagonal above which it is refused."""
RESIDUAL_LIMIT = 0.015
"""Rms distance of markers from a regular grid / pitch up to which they are one."""
TILT_WORTH_A_WORD = 0.01


@dataclass(frozen=True, eq=False)
class PlaneView:
    """How the sheet's plane is seen.

    Attributes:
        lens: calibration or estimate; None is a lens without distortion.
        to_plane: (3, 3) homography from undistorted px to the plane.
        unit_mm: whether the plane is in millimetres, else in pixels of the block's middle.
        mm_per_px: at the block's middle, or None.
        notes: what was corrected. warnings: what could not be.
        record: sizes, for the JSON.
    """

    lens: Lens | None
    to_plane: FloatArray
    unit_mm: bool
    mm_per_px: float | None
    notes: tuple[str, ...]
    warnings: tuple[Fault, ...]
    record: dict[str, float | str | None]

    def plane(self, px: FloatArray) -> FloatArray:
        """(..., 2) points of the plane for (..., 2) px; NaN stays NaN."""
        flat = px.reshape(-1, 2)
        known = np.isfinite(flat).all(axis=1)
        out = np.full(flat.shape, np.nan)
        out[known] = project(self.to_plane, undistort(self.lens, flat[known]))
        return out.reshape(px.shape)


def project(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2) images of points (n, 2) under a homography (3, 3)."""
    image = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return np.asarray(image[:, :2] / image[:, 2:])


def undistort(lens: Lens | None, px: FloatArray) -> FloatArray:
    """(n, 2) px as a lens without distortion would give them."""
    if lens is None or not len(px):
        return px
    import cv2

    matrix = np.array(
        [
            [lens.focal_px, 0, lens.principal_px[0]],
            [0, lens.focal_px, lens.principal_px[1]],
            [0, 0, 1],
        ]
    )
    bent = np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
    flat = (
        cv2.undistortPointsIter(
            px.reshape(-1, 1, 2).astype(np.float64), matrix, bent, None, None, criteria
        )
        if hasattr(cv2, "undistortPointsIter")
        else cv2.undistortPoints(
            px.reshape(-1, 1, 2).astype(np.float64), matrix, bent, criteria=criteria
        )
    )
    return np.asarray(flat.reshape(-1, 2) * lens.focal_px + np.asarray(lens.principal_px))


def fit_homography(source: FloatArray, image: FloatArray) -> FloatArray:
    """(3, 3) homography of (n, 2) to (n, 2), n >= 4, least squares (Hartley-normalised DLT)."""

    def normal(points: FloatArray) -> FloatArray:
        middle = points.mean(axis=0)
        scale = np.sqrt(2) / max(np.linalg.norm(points - middle, axis=1).mean(), 1e-300)
        return np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1]])

    one, two = normal(source), normal(image)
    a, b = project(one, source), project(two, image)
    rows = []
    for (x, y), (u, v) in zip(a, b, strict=True):
        rows.append([x, y, 1, 0, 0, 0, -u * x, -u * y, -u])
        rows.append([0, 0, 0, x, y, 1, -v * x, -v * y, -v])
    inner = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
    whole = np.linalg.inv(two) @ inner @ one
    return np.asarray(whole / whole[2, 2])


def make_view(
    sidecar: Sidecar,
    block: Block,
    size_px: tuple[int, int],
    marks: tuple[FloatArray, FloatArray] | None,
    file: str,
) -> PlaneView:
    """The view of a test.

    Args:
        sidecar: what was declared. block: in the first picture. size_px: (width, height).
        marks: places in cells (n, 2) (across, along) and px (n, 2) of markers that were
            located in the first picture; None where there are none (speckle).
        file: of the sidecar, for messages.

    Raises:
        DatasetError: ``tensile-tilt``, ``tensile-lens``, ``tensile-target``: too large to be
            corrected, or not what was declared; with its size.
    """
    notes: list[str] = []
    warnings: list[Fault] = []
    record: dict[str, float | str | None] = {}
    pitch = sidecar.cells.pitch_mm
    lens = sidecar.lens
    four = len(sidecar.cells.corners_px) == 4
    lattice = block.corner_lattice()
    corners = block.px(lattice)
    centre = block.px(np.array([[block.rows / 2, block.columns / 2]]))[0]

    if lens is None and marks is not None and len(marks[0]) >= 20:
        lens = _estimated_lens(marks, size_px)
        if lens is not None:
            notes.append(f"lens estimated from the straightness of the markers, k1 = {lens.k1:.4f}")
    bend = _bend(lens, corners, size_px)
    record["LensDisplacementPx"] = bend
    if lens is not None:
        half = 0.5 * float(np.hypot(*size_px))
        if bend > LENS_LIMIT * half:
            raise DatasetError(
                "tensile-lens",
                "The lens bends the block too much to be corrected.",
                remedy="Use a longer lens and more distance, or the middle of the picture.",
                file=file,
                got=f"{bend:.1f} px at the block's corners",
                expected=f"at most {LENS_LIMIT * half:.1f} px",
            )
        notes.append(f"lens corrected: up to {bend:.2f} px at the block's corners")

    choice = sidecar.tilt
    if choice == "auto":
        regular = False
        if marks is not None and len(marks[0]) >= 6:
            residual = _residual(marks, lens)
            regular = residual <= RESIDUAL_LIMIT
            record["GridResidual"] = residual
        choice = "target" if sidecar.target else "block" if regular else "none"
    scale_mm: float | None = None
    unit_mm = True
    if choice == "target" and sidecar.target is not None:
        px = undistort(lens, np.array(sidecar.target.points_px))
        mm = np.array(sidecar.target.points_mm)
        to_plane = fit_homography(px, mm)
        rms = float(np.sqrt(np.mean(np.sum((project(to_plane, px) - mm) ** 2, axis=1))))
        span = float(np.ptp(mm, axis=0).max())
        record["TargetResidualMm"] = rms
        if not rms <= 0.01 * span:
            raise DatasetError(
                "tensile-target",
                "The points of the target do not agree with one plane.",
                remedy="Check points_px and points_mm, in the same order; give the lens.",
                file=file,
                got=f"{rms:.3g} mm rms",
                expected=f"at most {0.01 * span:.3g} mm",
            )
    elif choice == "block":
        if marks is not None and len(marks[0]) >= 4:
            across, px = marks
        else:
            if not four:
                raise DatasetError(
                    "tensile-tilt-corners",
                    "Two corners do not say how the block is tilted.",
                    remedy="Give all four corners_px.",
                    file=file,
                )
            across, px = lattice[:, ::-1], corners
        to_plane = fit_homography(undistort(lens, px), across * (pitch or 1.0))
        unit_mm = pitch is not None
        if not unit_mm:
            local = _scale_at(to_plane, undistort(lens, centre[None]))
            to_plane = np.diag([1 / local, 1 / local, 1.0]) @ to_plane
    else:
        to_plane = np.eye(3)
        unit_mm = False
    tilt = _scale_change(to_plane, lens, corners)
    record["ScaleChangeAcrossBlock"] = tilt
    if choice != "none":
        if tilt > TILT_LIMIT:
            raise DatasetError(
                "tensile-tilt",
                "The sheet is seen too obliquely.",
                remedy="Set the camera square to the sheet, further away.",
                file=file,
                got=f"the scale changes by {100 * tilt:.0f} % across the block",
                expected=f"at most {100 * TILT_LIMIT:.0f} %",
            )
        notes.append(
            f"tilt corrected by the {'target' if choice == 'target' else 'regular cells'}: the "
            f"scale changes by {100 * tilt:.2f} % across the block"
        )
    elif four:
        inverse = np.asarray(np.linalg.inv(block.to_px), dtype=np.float64)
        seen = _scale_change(inverse, None, corners)
        record["ScaleChangeAcrossBlock"] = None
        record["ScaleChangeByCorners"] = seen
        if seen > TILT_WORTH_A_WORD:
            warnings.append(
                Fault(
                    "tensile-tilt-uncorrected",
                    "The declared corners say that the sheet is tilted; this is not corrected.",
                    'Give a target, or "tilt": "block" if the corners are exact.',
                    file=file,
                    got=f"the scale changes by {100 * seen:.1f} % across the block",
                    severity="warning",
                )
            )
    record["TiltBy"] = choice
    if unit_mm:
        scale_mm = _scale_at(to_plane, undistort(lens, centre[None]))
    else:
        scale_mm = _declared_scale(sidecar, block, lens)
    return PlaneView(lens, to_plane, unit_mm, scale_mm, tuple(notes), tuple(warnings), record)


def _declared_scale(sidecar: Sidecar, block: Block, lens: Lens | None) -> float | None:
    """mm a pixel by ruler, number or cell; None without any."""
    if sidecar.mm_per_px is not None:
        return sidecar.mm_per_px
    if sidecar.ruler is not None:
        ends = undistort(lens, np.array(sidecar.ruler.points_px))
        return float(sidecar.ruler.length_mm / np.linalg.norm(ends[1] - ends[0]))
    if sidecar.cells.pitch_mm is None:
        return None
    corners = undistort(lens, block.px(block.corner_lattice()))
    grid = corners.reshape(block.rows + 1, block.columns + 1, 2)
    along = np.linalg.norm(np.diff(grid, axis=0), axis=2).mean()
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2).mean()
    return float(sidecar.cells.pitch_mm / np.sqrt(along * across))


def _scale_at(matrix: FloatArray, point: FloatArray) -> float:
    """Square root of the area that a homography gives to a unit square at a point (1, 2)."""
    step = np.array([[-0.5, 0.0], [0.5, 0.0], [0.0, -0.5], [0.0, 0.5]])
    image = project(matrix, point + step)
    one, two = image[1] - image[0], image[3] - image[2]
    return float(np.sqrt(abs(one[0] * two[1] - one[1] * two[0])))


def _scale_change(matrix: FloatArray, lens: Lens | None, corners: FloatArray) -> float:
    """Largest over smallest scale at the block's corners, less 1."""
    flat = np.asarray(undistort(lens, corners), dtype=np.float64)
    scales = [_scale_at(matrix, point[None]) for point in flat]
    return float(max(scales) / min(scales) - 1)


def _bend(lens: Lens | None, points: FloatArray, size_px: tuple[int, int]) -> float:
    """How far the lens moves points, px, beyond a change of scale at the picture's middle."""
    if lens is None:
        return 0.0
    return float(np.linalg.norm(undistort(lens, points) - points, axis=1).max())


def _residual(marks: tuple[FloatArray, FloatArray], lens: Lens | None) -> float:
    """Rms distance of markers from the projection of a regular grid / pitch."""
    across, px = marks
    flat = undistort(lens, px)
    matrix = fit_homography(flat, across)
    return float(np.sqrt(np.mean(np.sum((project(matrix, flat) - across) ** 2, axis=1))))


def _estimated_lens(marks: tuple[FloatArray, FloatArray], size_px: tuple[int, int]) -> Lens | None:
    """k1 by which a regular grid becomes straight; None where straightness does not ask for it.

    The focal length is set to the picture's width (it only scales k1) and the centre to the
    picture's middle.
    """
    from scipy.optimize import minimize_scalar

    width, height = size_px
    middle = ((width - 1) / 2, (height - 1) / 2)

    def rms(k1: float) -> float:
        return _residual(marks, Lens(focal_px=width, principal_px=middle, k1=k1))

    plain = _residual(marks, None)
    best = minimize_scalar(rms, bounds=(-0.5, 0.5), method="bounded", options={"xatol": 1e-5})
    # One more number always fits a little better: it must explain a third of the residual.
    if not best.fun < 0.67 * plain or plain < 1e-4:
        return None
    return Lens(focal_px=width, principal_px=middle, k1=float(best.x))
