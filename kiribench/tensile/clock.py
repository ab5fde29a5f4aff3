"""When the frames were taken, and what the machine did then."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault
from kiribench.tensile.frames import FrameList
from kiribench.tensile.load_data import LoadTable, read_load
from kiribench.tensile.sidecar import Sidecar

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LoadAtFrames:
    """The machine at the frames, (n,) each; NaN where not known.

    Attributes:
        time_s: by the machine's clock where there is a load table, else by the camera's.
        displacement_mm, force_n: as named.
        notes: how the clocks were brought together. warnings: frames outside of the record.
        table: the machine's record, or None.
    """

    time_s: FloatArray
    displacement_mm: FloatArray
    force_n: FloatArray
    notes: tuple[str, ...]
    warnings: tuple[Fault, ...]
    table: LoadTable | None


def load_at_frames(folder: Path, sidecar: Sidecar, frames: FrameList, file: str) -> LoadAtFrames:
    """Bring the machine's table to the frames, by time, by an event, or row by row.

    Args:
        folder: of the pictures. sidecar: what was declared. frames: of the test.
        file: of the sidecar, for messages.

    Raises:
        DatasetError: ``frame-times``: as many times as frames are needed; a frame rate cannot
            time a series with gaps. ``load-sync``: nothing says how the clocks go together.
    """
    camera = _camera_times(sidecar, frames, file)
    nothing = np.full(len(frames.names), np.nan)
    if sidecar.load is None:
        time = nothing if camera is None else camera
        return LoadAtFrames(time, nothing, nothing.copy(), (), (), None)
    table = read_load(folder / sidecar.load.file, sidecar.load)
    rows = len(table.force_n)
    if camera is None:
        if rows != len(frames.names):
            raise DatasetError(
                "load-sync",
                "Nothing says which row of the machine's table belongs to which frame.",
                remedy="Give frame_times_s or frame_rate_hz, or one row a frame.",
                file=file,
                got=f"{rows} rows, {len(frames.names)} frames",
            )
        note = "load data: one row a frame"
        return LoadAtFrames(
            table.time_s, table.displacement_mm, table.force_n, (note,), table.warnings, table
        )
    if not np.isfinite(table.time_s).all():
        raise DatasetError(
            "load-time-missing",
            "The machine's table has no time for every row.",
            remedy="Export the time column, or give one row a frame and no frame times.",
            file=table.file,
        )
    offset, note = _offset(sidecar, frames, camera, table, file)
    time = camera + offset
    displacement, force = table.at(time)
    warnings = list(table.warnings)
    missing = np.flatnonzero(np.isnan(displacement) & np.isnan(force))
    if len(missing):
        warnings.append(
            Fault(
                "load-outside",
                f"{len(missing)} frames lie outside of the machine's record and have no load.",
                "Check the times and the event.",
                file=str(table.file),
                got=f"{frames.names[missing[0]]} at {time[missing[0]]:g} s",
                expected=f"{table.time_s[0]:g} to {table.time_s[-1]:g} s",
                severity="warning",
            )
        )
    return LoadAtFrames(time, displacement, force, (note,), tuple(warnings), table)


def _camera_times(sidecar: Sidecar, frames: FrameList, file: str) -> FloatArray | None:
    count = len(frames.names)
    if sidecar.frame_times_s is not None:
        times = np.array(sidecar.frame_times_s)
        if len(times) != count or np.any(np.diff(times) <= 0):
            raise DatasetError(
                "frame-times",
                "The times of the frames are not one growing number a frame.",
                remedy="Give frame_times_s in the order of the frames.",
                file=file,
                got=f"{len(times)} times, {count} frames",
            )
        return times
    rate = sidecar.frame_rate_hz or frames.frame_rate_hz
    if rate is None:
        return None
    if any(fault.code == "frame-gap" for fault in frames.warnings):
        raise DatasetError(
            "frame-times",
            "A frame rate cannot time a series of frames with gaps.",
            remedy="Restore the missing frames, or give frame_times_s.",
            file=file,
            got=frames.warnings[0].got,
        )
    return np.arange(count) / rate


def _offset(
    sidecar: Sidecar, frames: FrameList, camera: FloatArray, table: LoadTable, file: str
) -> tuple[float, str]:
    """Machine's clock less camera's clock, and how it is known."""
    load = sidecar.load
    if load is None or load.event is None:
        offset = 0.0 if load is None or load.offset_s is None else load.offset_s
        return offset, f"clocks: the first frame at {offset + camera[0]:g} s of the machine"
    if load.event.frame not in frames.names:
        raise DatasetError(
            "load-event",
            "The frame of the event is none of the frames.",
            remedy="Give the name of a picture.",
            file=file,
            got=load.event.frame,
        )
    at = camera[frames.names.index(load.event.frame)]
    machine = table.start_s if load.event.time_s is None else load.event.time_s
    if not np.isfinite(machine):
        raise DatasetError(
            "load-event",
            "The crosshead never starts in the machine's table.",
            remedy="Give time_s of the event.",
            file=table.file,
        )
    how = "the crosshead's start" if load.event.time_s is None else f"{machine:g} s"
    return float(machine - at), f"clocks: {load.event.frame} is {how} of the machine"
