"""The control: the best single pair of cut lengths for the whole patch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.design.box_newton import minimise_in_box
from kiribench.design.cells import Cells
from kiribench.design.reachable import axis, starts_of
from kiribench.design.response import Jet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STARTS = 8
BLOCK = 500  # cells at a time


def best_single(cells: Cells) -> FloatArray:
    """(2,) a, b with the least sum of squared errors of Poisson's ratio over all cells.

    The global optimum: a grid, then projected Newton from its best local minima.
    """
    ticks = axis(cells.high)
    total = np.zeros((1, len(ticks), len(ticks)))
    for start in range(0, len(cells), BLOCK):
        some = np.arange(start, min(start + BLOCK, len(cells)))
        error = cells.poisson.on_grid(ticks, ticks, some) - cells.target[some, None, None]
        total[0] += (error * error).sum(axis=0)
    points, _ = starts_of(total, ticks, STARTS)

    def objective(x: FloatArray, _: IntArray) -> Jet:
        n = len(cells)
        at = cells.poisson.jet(np.repeat(x, n, axis=0), np.tile(np.arange(n), len(x)))
        error = at.value - np.tile(cells.target, len(x))
        outer = at.slope[:, :, None] * at.slope[:, None, :]
        by_cell = (
            error**2,
            2.0 * error[:, None] * at.slope,
            2.0 * (outer + error[:, None, None] * at.curvature),
        )
        # The mean, so that convergence does not depend on the number of cells.
        value, slope, curvature = (
            part.reshape(len(x), n, *part.shape[1:]).mean(axis=1) for part in by_cell
        )
        return Jet(value, slope, curvature)

    points = minimise_in_box(objective, points, cells.high)
    value = objective(points, np.arange(len(points))).value
    return np.asarray(points[int(np.argmin(value))])
