"""A folder of frames to a tensile test: everything in its order."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault
from kiribench.tensile.camera import PlaneView, fit_homography
from kiribench.tensile.cells import CellStates
from kiribench.tensile.clock import LoadAtFrames, load_at_frames
from kiribench.tensile.elements import Block
from kiribench.tensile.followed import FollowedMarkers, FollowedSpeckle, MeasureOptions
from kiribench.tensile.frames import FrameList, check_exposure, decoded, list_frames
from kiribench.tensile.order import check_order
from kiribench.tensile.result import TensileTest
from kiribench.tensile.shake import STAY, StillThings
from kiribench.tensile.sidecar import Cells, Sidecar, read_sidecar

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]


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
    with decoded(frames) as pictures:
        first = next(pictures)
        box = _box(block)
        share = check_exposure(first, box, frames.names[0], None)
        kind: FollowedSpeckle | FollowedMarkers
        if declared.marker == "speckle":
            kind = FollowedSpeckle(first, block, declared, options, frames, str(path))
        else:
            kind = FollowedMarkers(first, block, declared, frames, str(path))
        still = (
            StillThings(first, declared.still_px, kind.view, str(path))
            if declared.still_px
            else None
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


def _sample(declared: Sidecar) -> dict[str, Any]:
    """What was said of the sample, as the record keeps it."""
    said: dict[str, Any] = {}
    if declared.sample is not None:
        said["Specimen"] = declared.sample.model_dump(by_alias=True, exclude_none=True)
    if declared.specimen:
        said["SpecimenNotes"] = declared.specimen
    return said


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
    kind: FollowedSpeckle | FollowedMarkers,
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
