"""Whether the frames stand in the order in which they were taken."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError
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
) -> None:
    """Refuse frames out of order.

    With the crosshead's displacement, the stretch has to rise and fall with it. Without, a test
    declared as ``loading`` has to stretch further from frame to frame.

    Args:
        names: of the frames. stretch: (n,) of the block along the pull. load: at the frames.
        path: ``loading`` or ``any``. noise: standard deviation of the stretches.

    Raises:
        DatasetError: ``frame-order``, with the frames.
    """
    least = max(STEP_BACK, 6 * noise)
    known = np.flatnonzero(np.isfinite(stretch))
    moved = load.displacement_mm[known]
    with_machine = len(moved) > 2 and bool(np.isfinite(moved).all()) and np.ptp(moved) > 0
    if path == "any" and not with_machine:
        return
    for one, two in pairwise(known.tolist()):
        change = stretch[two] - stretch[one]
        if with_machine:
            way = load.displacement_mm[two] - load.displacement_mm[one]
            wrong = change * way < 0 and abs(change) > least
        else:
            wrong = change < -least
        if wrong:
            raise DatasetError(
                "frame-order",
                "The sheet goes back between two frames: they are not in their order.",
                remedy="Name the frames by their order, or list them in tensile.json; a test that "
                'unloads is declared by "path": "any".',
                file=names[two],
                got=f"stretch {stretch[two]:.4f} after {stretch[one]:.4f} in {names[one]}",
                expected="growing stretch"
                if not with_machine
                else "stretch that goes with the crosshead",
            )
