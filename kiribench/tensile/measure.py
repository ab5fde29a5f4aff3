"""A folder of frames to a tensile test: everything in its order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault
from kiribench.tensile.camera import PlaneView, fit_homography, make_view
from kiribench.tensile.cells import CellStates, SpeckleCells, cells_of_corners, local_scale
from kiribench.tensile.clock import LoadAtFrames, load_at_frames
from kiribench.tensile.elements import Block, make_elements
from kiribench.tensile.follow import Follower, FollowOptions
from kiribench.tensile.frames import FrameList, check_exposure, decode, list_frames
from kiribench.tensile.markers import MarkerFollower
from kiribench.tensile.order import check_order
from kiribench.tensile.result import TensileTest
from kiribench.tensile.shake import STAY, StillThings
from kiribench.tensile.sidecar import Cells, Sidecar, read_sidecar

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]

PULLS = {"down": (0.0, 1.0), "up": (0.0, -1.0), "right": (1.0, 0.0), "left": (-1.0, 0.0)}


@dataclass(frozen=True)
class MeasureOptions:
    """How a test is measured.

    Attributes:
        zncc: least correlation at which a part of the sheet counts as found.
    """

    zncc: float = 0.75


def block_of(cells: Cells, pull: str) -> Block:
    """The block of cells in the first picture, from its two or four declared corners."""
    corners = np.array(cells.corners_px)
    if len(corners) == 2:
        (x0, y0), (x1, y1) = corners
        if pull in ("down", "up"):
            corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        else:
            corners = np.array([[x0, y0], [x0, y1], [x1, y1], [x1, y0]])
    columns, rows = cells.columns, cells.rows
    square = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]])
    return Block(rows, columns, fit_homography(square, corners))


def measure_frames(
    folder: Path,
    options: MeasureOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    sidecar: Path | None = None,
) -> TensileTest:
    """Measure the stretches of the declared cells in every frame of a folder.

    Args:
        folder: pictures or one video, ``tensile.json``, maybe the machine's table.
        options: limits. progress: called with (done, total) frames.
        sidecar: another file than ``tensile.json`` of the folder.

    Raises:
        DatasetError: what is wrong with the folder, each fault by its code.
        TableError: what is wrong with the machine's table.
    """
    options = options or MeasureOptions()
    declared, path = read_sidecar(folder, sidecar)
    frames = list_frames(folder, declared.frames)
    load = load_at_frames(folder, declared, frames, str(path))
    block = block_of(declared.cells, declared.pull)
    _check_block(block, frames, str(path))
    pictures = decode(frames)
    first = next(pictures)
    box = _box(block)
    share = check_exposure(first, box, frames.names[0], None)
    kind: _Speckle | _Markers
    if declared.marker == "speckle":
        kind = _Speckle(first, block, declared, options, frames, str(path))
    else:
        kind = _Markers(first, block, declared, frames, str(path))
    still = (
        StillThings(first, declared.still_px, kind.view, str(path)) if declared.still_px else None
    )
    states, corner_px = [kind.at_rest()], [kind.corner_px_at_rest()]
    shakes = [0.0]
    if progress:
        progress(1, len(frames.names))
    for number, picture in enumerate(pictures, 1):
        name = frames.names[number]
        check_exposure(picture, _seen_box(corner_px[-1], box, picture.shape), name, share)
        back, size = (STAY, 0.0) if still is None else still.back(picture)
        shakes.append(size)
        state, corners = kind.step(picture, back)
        states.append(state)
        corner_px.append(corners)
        if progress:
            progress(number + 1, len(frames.names))
    return _result(
        declared, path, frames, load, kind, states, np.array(corner_px), np.array(shakes)
    )


class _Speckle:
    """A speckled sheet."""

    def __init__(
        self,
        first: Float32Array,
        block: Block,
        declared: Sidecar,
        options: MeasureOptions,
        frames: FrameList,
        file: str,
    ) -> None:
        self._block = block
        elements = make_elements(block, cut=declared.cut, beyond=not declared.cells.outline)
        if elements.edge_px.min() < 14:
            raise DatasetError(
                "tensile-resolution",
                "The cells are too small in the pictures for speckle.",
                remedy="Go closer, or follow dots.",
                file=file,
                got=f"{2 * elements.edge_px.min():.0f} px a cell",
                expected="at least 28",
            )
        self.view = make_view(declared, block, frames.size_px, None, file)
        self._follower = Follower(
            first,
            elements,
            np.array(PULLS[declared.pull]) if len(declared.cells.corners_px) == 2 else _pull(block),
            cut=declared.cut,
            options=FollowOptions(options.zncc, options.zncc),
        )
        flat = ~self._follower.usable
        if flat.mean() > 0.3:
            raise DatasetError(
                "tensile-texture",
                f"{int(flat.sum())} of {len(flat)} parts of the block show no speckle, or are not "
                "in the first picture.",
                remedy="Check corners_px; spray a matt speckle; or declare the block as "
                'the whole sheet ("outline": true).',
                file=file,
            )
        self._cells = SpeckleCells(block, elements, self.view, cut=declared.cut)

    def at_rest(self) -> CellStates:
        count = self._block.rows * self._block.columns
        return CellStates(
            np.ones(count),
            np.ones(count),
            np.zeros((count, 2)),
            np.full(count, "ok", dtype="<U16"),
            self._cells.rest,
            np.ones(2),
        )

    def corner_px_at_rest(self) -> FloatArray:
        return self._corner_px(self._cells.rest)

    def step(self, picture: Float32Array, back: FloatArray) -> tuple[CellStates, FloatArray]:
        seen = self._follower.step(picture)
        state = self._cells.read(seen, back)
        pixels = self._cells.corner_px(seen)
        return state, pixels

    def _corner_px(self, _: FloatArray) -> FloatArray:
        shape = (self._block.rows + 1, self._block.columns + 1, 2)
        return self._block.px(self._block.corner_lattice()).reshape(shape)

    shifted_steps = 0

    @property
    def large_steps(self) -> int:
        """Elements that were found again after a large step."""
        return self._follower.relocated


class _Markers:
    """A sheet with dots, a drawn grid, or slits that are seen."""

    def __init__(
        self, first: Float32Array, block: Block, declared: Sidecar, frames: FrameList, file: str
    ) -> None:
        self._block = block
        self._follower = MarkerFollower(
            first,
            block,
            declared.marker,
            bright=declared.bright,
            pull=_pull(block),
            file=file,
        )
        marks = self._follower.marks() if declared.marker != "grid" else None
        self.view = make_view(declared, block, frames.size_px, marks, file)
        self._shape = (block.rows + 1, block.columns + 1)
        self._rest = self.view.plane(self._follower.first_px).reshape(*self._shape, 2)
        self._rest_sd = self._follower.first_sd * local_scale(self.view, self._follower.first_px)

    def at_rest(self) -> CellStates:
        sd = np.zeros(self._shape)
        status = self._follower.first_status.reshape(self._shape)
        return cells_of_corners(self._rest, self._rest, sd, status)

    def corner_px_at_rest(self) -> FloatArray:
        return self._follower.first_px.reshape(*self._shape, 2)

    def step(self, picture: Float32Array, back: FloatArray) -> tuple[CellStates, FloatArray]:
        seen = self._follower.step(picture)
        now = self.view.plane(seen.px) @ back[:, :2].T + back[:, 2]
        # The places in the first picture have their noise too.
        sd = seen.sd_px * local_scale(self.view, seen.px)
        if not self._follower.by_templates:
            sd = np.hypot(sd, self._rest_sd)
        status = seen.status.copy()
        hidden = self._follower.first_status == "hidden"
        status[hidden] = "hidden"
        state = cells_of_corners(
            self._rest,
            now.reshape(*self._shape, 2),
            sd.reshape(self._shape),
            status.reshape(self._shape),
        )
        return state, seen.px.reshape(*self._shape, 2)

    @property
    def shifted_steps(self) -> int:
        """Steps over which the markers may be their neighbours."""
        return self._follower.shifted_steps

    @property
    def large_steps(self) -> int:
        """Steps over which the markers were paired by a map."""
        return self._follower.large_steps


def _sample(declared: Sidecar) -> dict[str, Any]:
    """What was said of the sample, as the record keeps it."""
    said: dict[str, Any] = {}
    if declared.sample is not None:
        said["Specimen"] = declared.sample.model_dump(by_alias=True, exclude_none=True)
    if declared.specimen:
        said["SpecimenNotes"] = declared.specimen
    return said


def _pull(block: Block) -> FloatArray:
    """Unit vector of the rows' direction in the first picture."""
    ends = block.px(np.array([[0.0, block.columns / 2], [block.rows, block.columns / 2]]))
    away = ends[1] - ends[0]
    return np.asarray(away / np.linalg.norm(away))


def _box(block: Block) -> tuple[int, int, int, int]:
    corners = block.px(block.corner_lattice())
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _seen_box(
    corners: FloatArray, box: tuple[int, int, int, int], shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Around the corners as they were last seen; the first box where none was."""
    known = corners.reshape(-1, 2)
    known = known[np.isfinite(known).all(axis=1)]
    if len(known) < 3:
        return box
    low, high = known.min(axis=0), known.max(axis=0)
    return (
        int(max(low[0], 0)),
        int(max(low[1], 0)),
        int(min(high[0], shape[1] - 1)),
        int(min(high[1], shape[0] - 1)),
    )


def _check_block(block: Block, frames: FrameList, file: str) -> None:
    corners = block.px(block.corner_lattice())
    width, height = frames.size_px
    if (corners < 0).any() or (corners > [width - 1, height - 1]).any():
        raise DatasetError(
            "tensile-block",
            "The declared block is not all in the first picture.",
            remedy="Give corners_px in pixels of the first picture, x then y.",
            file=file,
            got=f"({corners[:, 0].min():.0f}, {corners[:, 1].min():.0f}) to "
            f"({corners[:, 0].max():.0f}, {corners[:, 1].max():.0f})",
            expected=f"within {width} x {height} px",
        )


def _result(
    declared: Sidecar,
    path: Path,
    frames: FrameList,
    load: LoadAtFrames,
    kind: _Speckle | _Markers,
    states: list[CellStates],
    corner_px: FloatArray,
    shakes: FloatArray,
) -> TensileTest:
    view: PlaneView = kind.view
    along = np.array([state.longitudinal for state in states])
    across = np.array([state.lateral for state in states])
    sd = np.array([state.sd for state in states])
    status = np.array([state.status for state in states])
    block = np.array([state.block for state in states])
    warnings = [*frames.warnings, *load.warnings, *view.warnings]
    measured = np.isfinite(along).sum(axis=1)
    if not measured[1:].any():
        counts = dict(zip(*np.unique(status[1:], return_counts=True), strict=True))
        raise DatasetError(
            "tensile-nothing-followed",
            "Nothing of the block was found in any later frame.",
            remedy="Check corners_px and the marker; take pictures at smaller steps; see "
            "docs/tensile.md on how to photograph.",
            file=path,
            got=", ".join(f"{word}: {number}" for word, number in counts.items()),
        )
    empty = np.flatnonzero(measured == 0)
    if len(empty):
        warnings.append(
            Fault(
                "frame-lost",
                f"No cell was found in {len(empty)} frames.",
                "Look at these pictures: out of focus, covered, or too large a step?",
                file=frames.names[empty[0]],
                got=", ".join(frames.names[k] for k in empty[:6]),
                severity="warning",
            )
        )
    if np.isnan(shakes).any():
        at = int(np.flatnonzero(np.isnan(shakes))[0])
        warnings.append(
            Fault(
                "tensile-still-lost",
                f"The things at rest were not found in {int(np.isnan(shakes).sum())} frames: the "
                "camera's motion is not removed there.",
                "Choose still_px that stay in the picture and uncovered.",
                file=frames.names[at],
                severity="warning",
            )
        )
    if kind.shifted_steps:
        warnings.append(
            Fault(
                "tensile-identity",
                "After a large step the markers could be their neighbours by a whole pitch: they "
                "look alike, and the rim of the pattern is not in the picture.",
                "Take pictures at smaller steps, or show the rim; where cells are alike the "
                "stretches do not depend on it.",
                file=str(path),
                got=f"{kind.shifted_steps} steps",
                severity="warning",
            )
        )
    floor = float(np.median(sd[1:][np.isfinite(sd[1:])]))
    warnings += check_order(frames.names, along, load, declared.path, floor)
    notes = [*view.notes, *load.notes]
    if declared.still_px:
        unit = "mm" if view.unit_mm else "px"
        notes.append(
            f"camera motion removed by {len(declared.still_px)} things at rest: up to "
            f"{np.nanmax(shakes):.3g} {unit}"
        )
    if kind.large_steps:
        what = "parts of the sheet" if declared.marker == "speckle" else "steps"
        notes.append(f"large steps: {kind.large_steps} {what} found again without a prediction")
    rows, columns = declared.cells.rows, declared.cells.columns
    row, col = np.divmod(np.arange(rows * columns), columns)
    table = () if load.table is None else (load.table.file,)
    return TensileTest(
        frame=frames.names,
        time_s=load.time_s,
        displacement_mm=load.displacement_mm,
        force_n=load.force_n,
        cell=tuple(f"r{r}c{c}" for r, c in zip(row, col, strict=True)),
        row=row.astype(np.int64),
        col=col.astype(np.int64),
        longitudinal_stretch=along,
        lateral_stretch=across,
        status=status,
        stretch_sd=sd,
        block_stretch=block,
        corner_px=corner_px,
        strain_sd=floor,
        scale_mm_per_px=view.mm_per_px,
        marker=declared.marker,
        notes=tuple(notes),
        warnings=tuple(warnings),
        record={
            "Rows": rows,
            "Columns": columns,
            "PitchMm": declared.cells.pitch_mm,
            "Cut": declared.cut,
            **_sample(declared),
            "View": view.record,
        },
        files=(path, *frames.paths, *table),
    )
