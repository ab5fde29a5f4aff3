"""Bring the worn scan into the frame of the bare scan by the skin outside the patch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kiribench.conformability.result import FrameReport
from kiribench.errors import Fault, NotConvergedError, RegistrationError
from kiribench.surface.acquisition import Acquired
from kiribench.surface.locate import locate
from kiribench.surface.mesh import FloatArray, Mesh
from kiribench.surface.register import Registration, register
from kiribench.surface.rigid import RigidTransform, kabsch

Registering = Literal["auto", "none"]

#: Skin points that register the scans: on facets of 3 mm their number, not the skin, limits
#: the fit (8000: corners off by up to 0.007 mm; 20000: by 0.003 mm).
SKIN_POINTS = 20_000
#: Skin within this distance of the patch's cells is left out: edges curl, straps press.
MARGIN_MM = 3.0
#: Less skin than this share of the patch's area cannot tell where the patch lies.
LEAST_SKIN_SHARE = 0.10
#: A registration whose uncertainty moves the patch by more is no registration.
LARGEST_SHIFT_SD_MM = 1.0
#: 95 % point of chi-squared with 6 degrees of freedom.
CHI2_6_95 = 12.592
#: A motion that moves no corner by more changes no overlap by .002.
NO_MOTION_MM = 0.02
#: A patch whose corners lie farther from the skin than this plus its thickness (median)
#: is in another frame.
NEAR_MM = 5.0


@dataclass(frozen=True, eq=False)
class Brought:
    """The patch in the bare scan's frame.

    Attributes:
        patch_mm: (R+1, C+1, 3) corners, NaN where absent.
        draws_mm: (n, R+1, C+1, 3) displacements of the corners by the uncertainty of the
            registration (0 where absent), or None where the frame is given.
        report: how. notes, warnings: for the reader.
    """

    patch_mm: FloatArray
    draws_mm: FloatArray | None
    report: FrameReport
    notes: tuple[str, ...] = ()
    warnings: tuple[Fault, ...] = ()


def bring_together(
    worn: Acquired,
    bare: Acquired,
    skin_mm: FloatArray,
    *,
    thickness_mm: float,
    registering: Registering,
    declared: bool,
    samples: int,
    rng: np.random.Generator,
) -> Brought:
    """Find the motion of the worn scan, or the reason to keep it where it is.

    The skin outside the patch is registered from the frames as they are, if the patch lies
    near the skin there, and otherwise from the motion that brings the patch's corners
    closest to the skin nodes under them. The frames are kept as they are when "no motion"
    lies inside the 95 % confidence region of the registration.

    Args:
        worn: its nodes are the patch's corners. bare: the scan to come to.
        skin_mm: (R+1, C+1, 3) skin nodes under the corners, NaN where absent.
        thickness_mm: of the patch.
        registering: ``none`` takes the frames as they are.
        declared: the sidecar says that they are one.
        samples: number of draws. rng: their source.

    Raises:
        RegistrationError: the scans do not fit, or too little skin is seen and the patch
            does not lie near the skin either.
    """
    patch = worn.nodes.positions_mm
    if registering == "none":
        return Brought(patch, None, _given("none"))
    if declared:
        return Brought(patch, None, _given("declared"))
    near = _near(bare.mesh, patch, thickness_mm)
    outside = ~under_patch(worn.mesh, patch)
    skin_area = float(worn.mesh.face_areas_mm2[outside].sum())
    patch_area = float(worn.mesh.face_areas_mm2[~outside].sum())
    if skin_area < LEAST_SKIN_SHARE * patch_area:
        share = f"{skin_area:.0f} mm2 of skin for a patch of {patch_area:.0f} mm2"
        return _assume(patch, near, share)
    found: Registration | None = None
    failure: RegistrationError | NotConvergedError | None = None
    if near:
        found, failure = _try(worn.mesh, bare.mesh, ~outside, RigidTransform.identity())
        if found is not None and _shift_sd(found, patch) > LARGEST_SHIFT_SD_MM:
            return _assume(patch, near, _loose(found, patch))
        if found is not None and _negligible(found, patch):
            return _kept(patch, found, samples, rng)
    other, other_failure = _try(
        worn.mesh, bare.mesh, ~outside, kabsch(patch.reshape(-1, 3), skin_mm.reshape(-1, 3))
    )
    if other is not None and (found is None or other.residual_rms_mm < found.residual_rms_mm):
        found = other
    if found is None:
        error = failure or other_failure
        if error is not None and error.code == "registration-overlap":
            return _assume(patch, near, "the scans share too little skin outside the patch")
        raise error or _not_near()
    if _shift_sd(found, patch) > LARGEST_SHIFT_SD_MM:
        return _assume(patch, near, _loose(found, patch))
    moved = found.transform.apply(patch)
    if not _near(bare.mesh, moved, thickness_mm):
        raise _not_near()
    return Brought(
        patch_mm=moved,
        draws_mm=_draws(found, patch, samples, rng),
        report=_report("registered", found, patch),
    )


def under_patch(mesh: Mesh, patch_mm: FloatArray) -> NDArray[np.bool_]:
    """(m,) whether a face of the worn scan may belong to the patch or lies close to it.

    A point of a cell is at most half a diagonal away from one of the cell's corners.

    Args:
        patch_mm: (R+1, C+1, 3) corners on this scan, NaN where absent.
    """
    corners = patch_mm[np.isfinite(patch_mm).all(axis=-1)]
    diagonals = np.concatenate(
        [
            np.linalg.norm(patch_mm[1:, 1:] - patch_mm[:-1, :-1], axis=-1).ravel(),
            np.linalg.norm(patch_mm[1:, :-1] - patch_mm[:-1, 1:], axis=-1).ravel(),
        ]
    )
    known = diagonals[np.isfinite(diagonals)]
    reach = (0.5 * float(known.max()) if len(known) else 0.0) + MARGIN_MM
    distance, _ = cKDTree(corners).query(mesh.corners_mm.mean(axis=1), distance_upper_bound=reach)
    return np.asarray(np.isfinite(distance))


def _try(
    worn: Mesh, bare: Mesh, patch_faces: NDArray[np.bool_], start: RigidTransform
) -> tuple[Registration | None, RegistrationError | NotConvergedError | None]:
    try:
        found = register(worn, bare, initial=start, exclude_moving=patch_faces, samples=SKIN_POINTS)
    except (RegistrationError, NotConvergedError) as error:
        return None, error
    return found, None


def _present(patch: FloatArray) -> FloatArray:
    return patch[np.isfinite(patch).all(axis=-1)]


def _near(bare: Mesh, patch: FloatArray, thickness_mm: float) -> bool:
    """Whether the patch's corners lie near the bare skin as they are."""
    distance = locate(bare, _present(patch)).distance_mm
    return float(np.median(distance)) <= thickness_mm + NEAR_MM


def _negligible(found: Registration, patch: FloatArray) -> bool:
    """Whether no motion at all is as good as the one found."""
    corners = _present(patch)
    moved = np.linalg.norm(found.transform.apply(corners) - corners, axis=1).max()
    if moved <= NO_MOTION_MM:
        return True
    motion = _motion_vector(found)
    distance2 = float(motion @ np.linalg.pinv(found.covariance) @ motion)
    return distance2 <= CHI2_6_95


def _motion_vector(found: Registration) -> FloatArray:
    """(6,) rotation vector about the registration's centre (radians) and translation (mm)."""
    from scipy.spatial.transform import Rotation

    back = found.transform.inverse().apply(found.centre_mm)
    return np.concatenate(
        [Rotation.from_matrix(found.rotation).as_rotvec(), found.centre_mm - back]
    )


def _shift_sd(found: Registration, patch: FloatArray) -> float:
    """Rms over corners and axes of the standard deviation of the patch's place, mm."""
    at = found.transform.apply(_present(patch))
    return float(np.sqrt(np.trace(found.point_covariance_mm2(at).mean(axis=0)) / 3.0))


def _loose(found: Registration, patch: FloatArray) -> str:
    return f"the skin outside the patch fixes its place only to {_shift_sd(found, patch):.1f} mm"


def _draws(
    found: Registration, patch: FloatArray, samples: int, rng: np.random.Generator
) -> FloatArray:
    """(n, R+1, C+1, 3) displacements of the corners, 0 where absent."""
    usual = found.transform.apply(patch)
    moved = np.stack([motion.apply(patch) - usual for motion in found.sample(rng, samples)])
    return np.nan_to_num(moved, nan=0.0)


def _kept(
    patch: FloatArray, found: Registration, samples: int, rng: np.random.Generator
) -> Brought:
    return Brought(
        patch_mm=patch,
        draws_mm=_draws(found, patch, samples, rng),
        report=_report("kept", found, patch),
    )


def _assume(patch: FloatArray, near: bool, why: str) -> Brought:
    if not near:
        raise RegistrationError(
            "registration-too-little-skin",
            "The worn scan shows too little skin outside the patch to be registered, and the "
            "patch does not lie on the bare scan's skin as it is.",
            remedy="Scan some 30 mm of skin around the patch; or register the scans yourself "
            'and write "RegisteredTo": "flex090" into the worn scan\'s sidecar.',
            got=why,
        )
    return Brought(
        patch_mm=patch,
        draws_mm=None,
        report=_given("assumed"),
        warnings=(
            Fault(
                "frame-assumed",
                "The worn scan and the bare scan are assumed to be in one frame; nothing checks "
                "it. An error of 0.3 mm changes grades.",
                'Scan some 30 mm of skin around the patch, or write "RegisteredTo": "flex090" '
                "into the worn scan's sidecar if you know it.",
                got=why,
                severity="warning",
            ),
        ),
    )


def _not_near() -> RegistrationError:
    return RegistrationError(
        "registration-patch-off-skin",
        "After registration the patch does not lie on the skin.",
        remedy="Check that both scans are of the same leg and that the patch's nodes are on "
        "the worn scan.",
    )


def _given(method: Literal["declared", "assumed", "none"]) -> FrameReport:
    return FrameReport(
        method=method,
        rotation_deg=0.0,
        shift_mm=0.0,
        residual_rms_mm=None,
        inlier_fraction=None,
        points_used=0,
        shift_sd_mm=0.0,
        rotation_sd_deg=0.0,
        grades_at_risk=0,
    )


def _report(
    method: Literal["registered", "kept"], found: Registration, patch: FloatArray
) -> FrameReport:
    centre = _present(patch).mean(axis=0)
    moved = method == "registered"
    shift = float(np.linalg.norm(found.transform.apply(centre) - centre))
    return FrameReport(
        method=method,
        rotation_deg=found.transform.angle_deg if moved else 0.0,
        shift_mm=shift if moved else 0.0,
        residual_rms_mm=found.residual_rms_mm if moved else found.initial_rms_mm,
        inlier_fraction=found.inlier_fraction,
        points_used=found.points_used,
        shift_sd_mm=_shift_sd(found, patch),
        rotation_sd_deg=float(np.rad2deg(np.sqrt(np.trace(found.covariance[:3, :3]) / 3.0))),
        grades_at_risk=0,
    )
