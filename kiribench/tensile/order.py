"""Whether the frames stand in the order in which they were taken."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError, Fault
from kiribench.tensile.clock import LoadAtFrames

FloatArray = npt.NDArray[np.float64]

STEP_BACK = 0.004
"""A stretch that falls by more than this between two frames of a loading is a step back."""


def check_order(
    names: tuple[str, ...],
    stretch: FloatArray,
    load: LoadAtFrames,
    path: str,
    noise: float,
) -> tuple[Fault, ...]:
    """Refuse frames out of order.

    With the crosshead's displacement, the stretch has to rise and fall with it. Without, a test
    declared as ``loading`` has to stretch further from frame to frame: a step back that is made
    good later is an error, one to the end may also be a sample that slips, tears or necks
    elsewhere, and is a warning.

    Args:
        names: of the frames. stretch: (n, k) of the cells along the pull, NaN where not measured.
        load: at the frames. path: ``loading`` or ``any``.
        noise: standard deviation of the stretches.

    Returns:
        A warning, or nothing.

    Raises:
        DatasetError: ``frame-order``, with the frames.
    """
    least = max(STEP_BACK, 6 * noise)
    known = np.flatnonzero(np.isfinite(stretch).any(axis=1))
    moved = load.displacement_mm[known]
    with_machine = len(moved) > 2 and bool(np.isfinite(moved).all()) and np.ptp(moved) > 0
    if path == "any" and not with_machine:
        return ()
    for at, (one, two) in enumerate(pairwise(known.tolist())):
        change = _change(stretch[one], stretch[two])
        if with_machine:
            way = load.displacement_mm[two] - load.displacement_mm[one]
            wrong, sure = change * way < 0 and abs(change) > least, True
        else:
            wrong = change < -least
            sure = any(_change(stretch[one], stretch[n]) > least for n in known[at + 2 :])
        if not wrong:
            continue
        fault = Fault(
            "frame-order",
            "The sheet goes back between two frames: they are not in their order."
            if sure
            else "The sheet goes back to the end: does it unload, slip or tear, or are the last "
            "frames not in their order?",
            "Name the frames by their order, or list them in tensile.json; a test that unloads is "
            'declared by "path": "any".',
            file=names[two],
            got=f"a change of stretch of {change:+.4f} from {names[one]}",
            expected="a stretch that goes with the crosshead" if with_machine else "a growing one",
            severity="error" if sure else "warning",
        )
        if sure:
            raise DatasetError.of([fault])
        return (fault,)
    return ()


def _change(one: FloatArray, two: FloatArray) -> float:
    """Mean change of the cells that are measured in both frames; 0 if there is none."""
    both = np.isfinite(one) & np.isfinite(two)
    return float((two[both] - one[both]).mean()) if both.any() else 0.0
