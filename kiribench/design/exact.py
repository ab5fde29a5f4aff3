"""The least cuts that meet a target, in every cell, with certainty.

Smallest ``a^2 + b^2`` over ``0 <= a, b <= longest`` subject to
``|nu(a, b) - target| <= tolerance``. Where no cuts at all will not do, the straight way from there
to the answer ends where it first meets the tolerance: on the curve ``nu = target - tolerance`` if
nu without cuts is lower, else on ``nu = target + tolerance``. Bicubic patches through a coarse grid
show every branch of that curve, islands between the grid's points included; from each crossing of
the grid near the nearest one a compiled walk goes to a locally nearest point, and Newton's method
on the surrogate itself (sequential quadratic programming, the bounds as an active set) ends it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.box_newton import minimise_in_box
from kiribench.design.level import shortest_on_level
from kiribench.design.patch_search import ROUGH_VALUE, rough_ends
from kiribench.design.patchwork import Patchwork
from kiribench.design.reachable import Reachable, axis, extremes, reachable, starts_of
from kiribench.design.response import Jet, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STARTS = 12  # local minima of the penalised objective on the grid, a cell
BLOCK = 500  # cells at a time
WORSE = 0.03  # of the cell edge: ends that much farther out than the nearest are not begun from
ON_CURVE = 1e-10  # of Poisson's ratio
SLOPE_AT_BOUND = 1e-6  # more than that holds an extreme at its bound


@dataclass(frozen=True, eq=False)
class Exact:
    """The answer for n cells.

    Attributes:
        cuts: (n, 2) a, b, fractions.
        reachable: the range of the response in each cell.
    """

    cuts: FloatArray
    reachable: Reachable


def least_cuts(response: Response, target: FloatArray, high: float, tolerance: float) -> Exact:
    """The least cuts within ``tolerance`` of the target, or of the nearest value in reach.

    Where the target is out of reach by more than the tolerance, the cuts that come nearest.

    Args:
        response: of n cells.
        target: (n,).
        high: longest cut, fraction of the cell edge.
        tolerance: of the response.
    """
    blocks = [
        _least_cuts(
            response, np.arange(start, min(start + BLOCK, response.count)), target, high, tolerance
        )
        for start in range(0, response.count, BLOCK)
    ]
    return Exact(
        np.concatenate([cuts for cuts, _ in blocks]),
        Reachable(
            *(
                np.concatenate([getattr(span, name) for _, span in blocks])
                for name in ("low", "high", "at_low", "at_high")
            )
        ),
    )


def _least_cuts(
    response: Response, some: IntArray, targets: FloatArray, high: float, tolerance: float
) -> tuple[FloatArray, Reachable]:
    """The same for some of the cells, so that the grids of many stay small."""
    ticks, target = axis(high), targets[some]
    patches = Patchwork.of(ticks, response.on_grid(ticks, ticks, some))
    span = reachable(response, high, cells=some, patches=patches)
    cuts = np.where((target > span.high)[:, None], span.at_high, span.at_low)
    # The straight way from no cuts to the answer crosses the nearer curve at the answer.
    uncut = patches.nodes[:, 0, 0, 0] - target
    free = np.abs(uncut) <= tolerance
    cuts[free] = 0.0
    open_ = (span.distance(target) < tolerance) & ~free
    side = np.where(open_, -np.sign(uncut), 0.0)
    level = target - side * tolerance
    start, cell, peaks, peak_cell = rough_ends(patches, level, side)
    peaks, height = extremes(response, some[peak_cell], -side[peak_cell], peaks, high)
    above = side[peak_cell] * (height - level[peak_cell]) > 0.0
    # And where little of the cell's own extreme is beyond the level.
    left = np.where(side > 0, span.high - level, level - span.low)
    last = np.flatnonzero((side != 0.0) & (left > 0.0) & (left <= ROUGH_VALUE))
    tops = np.where((side > 0)[:, None], span.at_high, span.at_low)[last]
    tops, of_top = np.concatenate([peaks[above], tops]), np.concatenate([peak_cell[above], last])
    start = np.concatenate([start, _near_side(response, some, of_top, tops, level, high)])
    cell = np.concatenate([cell, of_top])
    ends, gap = shortest_on_level(response, start, some[cell], level[cell], high)
    # What lies between the curves is admissible wherever it was found.
    cells = np.flatnonzero(open_)
    places = np.concatenate([peaks, span.at_low[cells], span.at_high[cells]])
    values = np.concatenate([height, span.low[cells], span.high[cells]])
    of = np.concatenate([peak_cell, cells, cells])
    between = np.abs(values - target[of]) <= tolerance
    good = gap <= ON_CURVE
    every = np.concatenate([ends[good], places[between]])
    owner = np.concatenate([cell[good], of[between]])
    first = _first_of_each(owner, (every**2).sum(axis=1))
    cuts[owner[first]] = every[first]
    return cuts, span


def _near_side(
    response: Response,
    some: IntArray,
    cell: IntArray,
    peaks: FloatArray,
    level: FloatArray,
    high: float,
) -> FloatArray:
    """(k, 2) the places nearest to the origin of small islands about extremes beyond their level.

    On an extreme itself Newton's method has no slope to begin with. To second order the island is
    the ellipse ``d' H d = 2 h``, h beyond the level; a variable held at its bound stays.
    """
    at = response.jet(peaks, some[cell])
    beyond = at.value - level[cell]
    held = ((peaks <= 0.0) | (peaks >= high)) & (np.abs(at.slope) > SLOPE_AT_BOUND)
    towards = np.where(held, 0.0, peaks)
    h = np.where(held[:, :, None] | held[:, None, :], np.eye(2), at.curvature)
    values, vectors = np.linalg.eigh(h)
    values = np.maximum(np.abs(values), SLOPE_AT_BOUND)
    turned = np.einsum("kij,ki->kj", vectors, towards) / values
    shift = np.where(held, 0.0, np.einsum("kij,kj->ki", vectors, turned))
    size = np.maximum((towards * shift).sum(axis=1), 1e-300)
    far = np.sqrt(2.0 * np.abs(beyond) / size)
    return np.asarray(np.clip(peaks - shift * far[:, None], 0.0, high))


def _first_of_each(owner: IntArray, value: FloatArray) -> IntArray:
    """Indices of the least value of every owner."""
    order = np.lexsort((value, owner))
    return order[np.diff(owner[order], prepend=-1) > 0]


def least_penalised(response: Response, target: FloatArray, high: float, penalty: float) -> Exact:
    """The global optimum of the paper's objective, ``(nu - target)^2 + penalty (a^2 + b^2)``.

    By projected Newton, from the best local minima of a grid and, as the valley along
    ``nu = target`` may be narrower than the grid, from the crossings of that curve.

    Args:
        response: of n cells.
        target: (n,).
        high: longest cut, fraction.
        penalty: lambda, for a and b as fractions.
    """
    ticks = axis(high)
    grid = response.on_grid(ticks, ticks)
    patches = Patchwork.of(ticks, grid)
    span = reachable(response, high, patches=patches)
    square = ticks[:, None] ** 2 + ticks[None, :] ** 2
    points, cell = starts_of((grid - target[:, None, None]) ** 2 + penalty * square, ticks, STARTS)
    near, of, _, _ = rough_ends(patches, target, np.sign(target - grid[:, 0, 0]), WORSE)
    points, cell = np.concatenate([points, near]), np.concatenate([cell, of])

    def objective(x: FloatArray, which: IntArray) -> Jet:
        return penalised(response, x, cell[which], target[cell[which]], penalty)

    points = minimise_in_box(objective, points, high)
    value = penalised(response, points, cell, target[cell], penalty).value
    return Exact(points[_first_of_each(cell, value)], span)


def penalised(
    response: Response, x: FloatArray, cells: IntArray, target: FloatArray, penalty: float
) -> Jet:
    """The paper's objective with its derivatives at (k, 2) points."""
    at = response.jet(x, cells)
    miss = at.value - target
    outer = at.slope[:, :, None] * at.slope[:, None, :]
    curvature = 2.0 * (outer + miss[:, None, None] * at.curvature)
    curvature[:, [0, 1], [0, 1]] += 2.0 * penalty
    return Jet(
        miss**2 + penalty * (x * x).sum(axis=1),
        2.0 * miss[:, None] * at.slope + 2.0 * penalty * x,
        curvature,
    )
