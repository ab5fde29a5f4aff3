"""The unit of a scan, checked against what was drawn on the skin."""

from __future__ import annotations

import math

from kiribench.errors import Fault
from kiribench.surface.read import MM_PER_UNIT, mm_per_unit

LARGEST_STRETCH = 1.6
"""Skin over a knee was never seen to stretch or shrink by more on average over a grid."""


def check_pitch(
    median_spacing: float, pitch_mm: float, *, units: str = "mm", file: str | None = None
) -> Fault | None:
    """Compare the drawn pitch with the spacing of the nodes on the scan.

    Args:
        median_spacing: median distance of adjacent nodes, in the unit of the file.
        pitch_mm: the pitch that was drawn, mm (15 in the paper).
        units: the unit that the sidecar declares.
        file: the scan, for the fault.

    Returns:
        None if the spacing is within a factor ``LARGEST_STRETCH`` of the pitch, else the error
        ``scan-units`` with the unit that fits, or ``scan-pitch`` if none does.
    """
    got = median_spacing * mm_per_unit(units, file=file)
    shown = f"a median node spacing of {got:.4g} mm (as {units})"
    expected = f"about {pitch_mm:g} mm"
    if not (math.isfinite(got) and got > 0):
        return Fault(
            "scan-pitch",
            "The nodes' spacing on the scan is no positive number.",
            remedy="Check the nodes table against the scan.",
            file=file,
            got=shown,
            expected=expected,
        )
    limit = math.log(LARGEST_STRETCH)
    if abs(math.log(got / pitch_mm)) <= limit:
        return None
    misfit, likely = min(
        (abs(math.log(median_spacing * scale / pitch_mm)), unit)
        for unit, scale in MM_PER_UNIT.items()
    )
    if misfit <= limit:
        return Fault(
            "scan-units",
            f"The scan is in {likely}, not in {units}.",
            remedy=f'Set "Units": "{likely}" in the scan\'s JSON sidecar.',
            file=file,
            got=shown,
            expected=expected,
        )
    return Fault(
        "scan-pitch",
        "The spacing of the nodes fits the drawn pitch in no unit that is known.",
        remedy=f"Check the pitch ({pitch_mm:g} mm) in the layout and the scale of the scan; "
        f"known units are {', '.join(MM_PER_UNIT)}.",
        file=file,
        got=shown,
        expected=expected,
    )
