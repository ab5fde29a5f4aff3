"""Points moved onto a level curve of a response, within the limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.design.response import Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ITERATIONS = 8
ON_LEVEL = 1e-9


def onto_level(
    response: Response, points: FloatArray, cells: IntArray, level: FloatArray, high: float
) -> FloatArray:
    """(k, 2) points moved by Newton's method along the slope; NaN where that does not arrive.

    Args:
        response: of n cells.
        points: (k, 2) near the curves, within 0 <= a, b <= high.
        cells: (k,) whose response.
        level: (k,) that it is to have.
        high: upper bound of a and b.
    """
    x = points.copy()
    if not len(x):
        return x
    for _ in range(ITERATIONS):
        at = response.jet(x, cells)
        miss = at.value - level
        step = -miss[:, None] * at.slope
        held = ((x <= 0.0) & (step < 0.0)) | ((x >= high) & (step > 0.0))
        slope = np.where(held, 0.0, at.slope)
        square = np.maximum((slope**2).sum(axis=1), 1e-12)
        x = np.clip(x - (miss / square)[:, None] * slope, 0.0, high)
    missed = np.abs(response.jet(x, cells).value - level)
    return np.asarray(np.where((missed < ON_LEVEL)[:, None], x, np.nan))
