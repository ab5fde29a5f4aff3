"""How long the machine works on a drawing, and what it may take amiss in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from kiribench.errors import Fault
from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.slits import Slits
from kiribench.fabrication.strokes import CUT_ROLES


@dataclass(frozen=True)
class Work:
    """The work of one drawing.

    Attributes:
        name: of the drawing.
        cuts: number of strokes that go through.
        cut_mm, marked_mm, travel_mm: lengths, mm; travel is the way with the beam off.
        seconds: at the profile's speeds, None where it does not state all that are needed;
            acceleration and the machine's pauses are not in it.
    """

    name: str
    cuts: int
    cut_mm: float
    marked_mm: float
    travel_mm: float
    seconds: float | None


def work_of(drawing: Drawing, profile: Profile) -> Work:
    """Lengths and time of a drawing on a machine."""
    cut, marked, travel = drawing.cut_mm, drawing.marked_mm, drawing.travel_mm
    parts = (
        (cut, profile.cut_mm_s),
        (marked, profile.mark_mm_s),
        (travel, profile.travel_mm_s),
    )
    seconds: float | None = 0.0
    for length, speed in parts:
        if length == 0:
            continue
        seconds = None if speed is None or seconds is None else seconds + length / speed
    return Work(drawing.name, len(drawing.of(*CUT_ROLES)), cut, marked, travel, seconds)


def narrow_gaps(slits: Slits, gap_mm: float) -> int:
    """Number of pairs of slits in one line whose tips are at most ``gap_mm`` apart."""
    if len(slits) < 2:
        return 0
    tips = np.stack([slits.start_mm, slits.end_mm], axis=1)
    way = (slits.end_mm - slits.start_mm) / slits.length_mm[:, None]
    pairs = cKDTree(tips.reshape(-1, 2)).query_pairs(gap_mm + 1e-9, output_type="ndarray")
    one, two = pairs[:, 0] // 2, pairs[:, 1] // 2
    points = tips.reshape(-1, 2)
    offset = points[pairs[:, 1]] - points[pairs[:, 0]]
    along = np.abs(way[one, 0] * way[two, 1] - way[one, 1] * way[two, 0]) < 1e-9
    in_line = np.abs(offset[:, 0] * way[one, 1] - offset[:, 1] * way[one, 0]) < 1e-6
    return int(np.sum(along & in_line & (one != two)))


def work_warnings(slits: Slits, profile: Profile, *, kerf_mm: float | None) -> tuple[Fault, ...]:
    """What the person at the machine should know before cutting."""
    warnings = []
    if kerf_mm is None:
        warnings.append(
            Fault(
                "kerf-not-known",
                "No kerf was given: the slits are not compensated, and come out longer by the "
                "width of the beam.",
                "Cut the kerf coupon in this material, read it, and export again with --kerf-mm.",
                severity="warning",
            )
        )
    if profile.closes_gaps_mm is not None:
        # 'About': a fifth more is warned of too.
        gaps = narrow_gaps(slits, 1.2 * profile.closes_gaps_mm)
        if gaps:
            warnings.append(
                Fault(
                    "gaps-may-be-closed",
                    f"{gaps} gaps between slits in one line are hardly wider than "
                    f"{profile.closes_gaps_mm:g} mm, or narrower: the program of this machine may "
                    "close them (geometry optimisation).",
                    "Switch it off, and verify the file that comes out of the program.",
                    severity="warning",
                )
            )
    return tuple(warnings)
