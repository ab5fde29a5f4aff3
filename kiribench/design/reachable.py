"""What Poisson's ratio any allowed cuts can have at a strain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.box_newton import expected_gain, minimise_in_box
from kiribench.design.patch_search import rough_extremes
from kiribench.design.patchwork import Patchwork
from kiribench.design.response import Jet, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BLOCK = 1_000
"""Cells at a time."""

EQUAL = 1e-7
"""Of the response: extremes that are compared only after Newton's method ended."""

FEWEST_STEPS = 4
"""Of the coarse grid: what the stencils of the patches take."""

GRID_STEP = 0.025
"""Of the coarse grid, fraction of the cell edge: half of the steps of the paper's table."""


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
    return np.linspace(0.0, high, 1 + max(FEWEST_STEPS, int(np.ceil(high / GRID_STEP - 1e-9))))


def reachable(
    response: Response,
    high: float,
    grid: FloatArray | None = None,
    cells: IntArray | None = None,
    patches: Patchwork | None = None,
) -> Reachable:
    """The global extremes: the lowest and highest places of bicubic patches, by Newton's method.

    Args:
        response: of n cells.
        high: longest cut, fraction.
        grid: (n, A, A) the response on :func:`axis`, if it is there already.
        cells: (n,) which cells; all by default.
        patches: through the grid, if they are there already.
    """
    ticks = axis(high)
    which = np.arange(response.count) if cells is None else cells
    if patches is None:
        values = response.on_grid(ticks, ticks, which) if grid is None else grid
        patches = Patchwork.of(ticks, values)
    points, cell, sign = rough_extremes(patches)
    near = _promising(response, which[cell], sign, points, high)
    points, cell, sign = points[near], cell[near], sign[near]
    points, value = extremes(response, which[cell], sign, points, high)
    best = np.lexsort((sign * value, cell, -sign))
    group = 2 * cell[best] + (sign[best] < 0)
    first = best[np.concatenate(([True], np.diff(group) != 0))]
    low, top = first[sign[first] > 0], first[sign[first] < 0]
    return Reachable(value[low], value[top], points[low], points[top])


def reachable_in_blocks(response: Response, high: float) -> Reachable:
    """The same for any number of cells, some at a time: 70 kB a cell are in use."""
    parts = [
        reachable(response, high, cells=np.arange(start, min(start + BLOCK, response.count)))
        for start in range(0, response.count, BLOCK)
    ]
    return Reachable(
        np.concatenate([part.low for part in parts]),
        np.concatenate([part.high for part in parts]),
        np.concatenate([part.at_low for part in parts]),
        np.concatenate([part.at_high for part in parts]),
    )


def _promising(
    response: Response, cells: IntArray, sign: FloatArray, points: FloatArray, high: float
) -> IntArray:
    """Indices of the places that may be their cell's lowest or highest, by one Newton step.

    Where the response hardly changes the patches have dozens of extremes, equal but for their
    error; twice the gain that Newton's method expects tells most of them apart.
    """
    at = response.jet(points, cells)
    value = sign * at.value
    gain = expected_gain(points, sign[:, None] * at.slope, sign[:, None, None] * at.curvature, high)
    group = 2 * (cells - cells.min(initial=0)) + (sign < 0)
    least = np.full(group.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, group, value)
    return np.flatnonzero(value - 2.0 * gain <= least[group] + EQUAL)


def extremes(
    response: Response, cells: IntArray, sign: FloatArray, start: FloatArray, high: float
) -> tuple[FloatArray, FloatArray]:
    """Local minima (sign 1) and maxima (sign -1) of responses: (k, 2) points, (k,) values.

    Args:
        response: of n cells.
        cells: (k,) whose response.
        sign: (k,).
        start: (k, 2) near them.
        high: longest cut, fraction.
    """

    def objective(x: FloatArray, which: IntArray) -> Jet:
        at, s = response.jet(x, cells[which]), sign[which]
        return Jet(s * at.value, s[:, None] * at.slope, s[:, None, None] * at.curvature)

    points = minimise_in_box(objective, start, high)
    return points, response.jet(points, cells).value


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
