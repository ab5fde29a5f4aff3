"""What Poisson's ratio any allowed cuts can have at a strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.box_newton import Objective, minimise_in_box
from kiribench.design.patchwork import Patchwork
from kiribench.design.response import Jet, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GRID_STEP = 0.02
"""Of the coarse grid, fraction of the cell edge: the paper's table has steps of 0.05."""

STARTS = 4
"""Local extremes of the grid that Newton's method starts from, a cell, at most."""

ROUGH = 5e-4
"""Of Poisson's ratio: by how much extremes on the patches may be off."""

BELOW_GRID = 0.02
"""By how much an extreme may exceed the nearest grid point: half the curvature (up to some 100 for
Poisson's ratio) times the square of half the grid's diagonal (.014)."""


@dataclass(frozen=True, eq=False)
class Reachable:
    """The range of a response over the allowed cuts, for n cells.

    Attributes:
        low, high: (n,) smallest and largest value.
        at_low, at_high: (n, 2) cuts that have it, fractions.
    """

    low: FloatArray
    high: FloatArray
    at_low: FloatArray
    at_high: FloatArray

    def nearest(self, target: FloatArray) -> FloatArray:
        """(n,) the targets, where out of reach the nearest value within."""
        return np.clip(target, self.low, self.high)

    def distance(self, target: FloatArray) -> FloatArray:
        """(n,) of the targets to the range, 0 inside."""
        return np.maximum(np.maximum(self.low - target, target - self.high), 0.0)


def axis(high: float) -> FloatArray:
    """The coarse grid's axis from 0 to the longest cut."""
    return np.linspace(0.0, high, 1 + int(np.ceil(high / GRID_STEP - 1e-9)))


def reachable(
    response: Response,
    high: float,
    grid: FloatArray | None = None,
    cells: IntArray | None = None,
    patches: Patchwork | None = None,
) -> Reachable:
    """The global extremes: from the best local ones of a coarse grid, by Newton's method.

    Args:
        response: of n cells.
        high: longest cut, fraction.
        grid: (n, A, A) the response on :func:`axis`, if it is there already.
        cells: (n,) which cells; all by default.
        patches: through the grid, if they are there already.
    """
    ticks = axis(high)
    which = np.arange(response.count) if cells is None else cells
    values = response.on_grid(ticks, ticks, which) if grid is None else grid
    fast = Patchwork.of(ticks, values) if patches is None else patches
    low, at_low = _least(response, fast, which, values, ticks, 1.0)
    high_, at_high = _least(response, fast, which, -values, ticks, -1.0)
    return Reachable(low, -high_, at_low, at_high)


def local_minima(values: FloatArray) -> NDArray[np.bool_]:
    """(n, A, B) whether no neighbour on the grid is smaller."""
    padded = np.pad(values, ((0, 0), (1, 1), (1, 1)), constant_values=np.inf)
    lowest = np.ones(values.shape, dtype=bool)
    rows, columns = values.shape[1:]
    for i in range(3):
        for j in range(3):
            if (i, j) != (1, 1):
                lowest &= values <= padded[:, i : i + rows, j : j + columns]
    return lowest


def starts_of(
    values: FloatArray, ticks: FloatArray, count: int, within: float = np.inf
) -> tuple[FloatArray, IntArray]:
    """The ``count`` lowest local minima of each cell's grid: (k, 2) points, (k,) cells.

    Only those that are ``within`` so much of the lowest.
    """
    n, _rows, columns = values.shape
    ranked = np.where(local_minima(values), values, np.inf).reshape(n, -1)
    count = min(count, ranked.shape[1])
    best = np.argpartition(ranked, count - 1, axis=1)[:, :count]
    found = np.take_along_axis(ranked, best, axis=1)
    low = found <= found.min(axis=1, keepdims=True) + within
    cell, place = np.nonzero(np.isfinite(found) & low)
    flat = best[cell, place]
    return np.column_stack([ticks[flat // columns], ticks[flat % columns]]), cell


def _least(
    response: Response,
    patches: Patchwork,
    cells: IntArray,
    values: FloatArray,
    ticks: FloatArray,
    sign: float,
) -> tuple[FloatArray, FloatArray]:
    """Minima of ``sign * response``: (n,) values and (n, 2) points; on the patches first."""
    points, cell = starts_of(values, ticks, STARTS, within=BELOW_GRID)
    high = float(ticks[-1])
    points = minimise_in_box(_signed(patches, cell, sign), points, high)
    rough = sign * patches.jet(points, cell).value
    best = np.full(len(values), np.inf)
    np.minimum.at(best, cell, rough)
    keep = rough <= best[cell] + ROUGH
    points, cell = points[keep], cell[keep]
    points = minimise_in_box(_signed(response, cells[cell], sign), points, high)
    value = sign * response.jet(points, cells[cell]).value
    order = np.lexsort((value, cell))
    first = order[np.concatenate(([True], np.diff(cell[order]) > 0))]
    return value[first], points[first]


def _signed(response: Response, cells: IntArray, sign: float) -> Objective:
    def objective(x: FloatArray, which: IntArray) -> Jet:
        at = response.jet(x, cells[which])
        return Jet(sign * at.value, sign * at.slope, sign * at.curvature)

    return objective
