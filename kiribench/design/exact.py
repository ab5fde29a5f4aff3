"""The least cuts that meet a target, in every cell, with certainty.

Smallest ``a^2 + b^2`` over ``0 <= a, b <= longest`` subject to
``|nu(a, b) - target| <= tolerance``. Unless no cuts at all will do, the answer lies on one of the
curves ``nu = target - tolerance`` and ``nu = target + tolerance``. A grid finds every branch of
both; in each of twelve directions from the origin the nearest crossing starts a Newton iteration
on the conditions of optimality (sequential quadratic programming with the bounds as an active
set); the best end is the answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.box_newton import SMALL_STEP, minimise_in_box
from kiribench.design.patchwork import Patchwork
from kiribench.design.reachable import Reachable, axis, reachable, starts_of
from kiribench.design.response import Jet, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SECTORS = 12
BLOCK = 500  # cells at a time
ITERATIONS = 40
LONGEST_STEP = 0.05
ON_CURVE = 1e-10  # of Poisson's ratio
ROUGH = 2e-3  # of the cell edge: by how much ends on the patches may be off
WORSE = 0.03  # of the cell edge: a start that much farther out than the best cannot win


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
    ticks = axis(high)
    target = targets[some]
    grid = response.on_grid(ticks, ticks, some)
    patches = Patchwork.of(ticks, grid)
    span = reachable(response, high, grid, some, patches)
    cuts = np.where((target > span.high)[:, None], span.at_high, span.at_low)
    # Within the range, or out of it by less than the tolerance: there is something to choose.
    open_ = span.distance(target) < tolerance
    free = np.abs(grid[:, 0, 0] - target) <= tolerance
    cuts[free] = 0.0
    cells = np.flatnonzero(open_ & ~free)
    points, which, level = _crossings(grid[cells], ticks, target[cells], tolerance)
    # The nearest reachable point itself is always admissible.
    extreme = np.concatenate([span.at_low[cells], span.at_high[cells]])
    twice = np.tile(cells, 2)
    at_extreme = response.jet(extreme, some[twice]).value
    near = np.abs(at_extreme - target[twice]) <= tolerance
    # On the patches first; then only what may still win goes on to the surrogate.
    rough, _ = shortest_on_level(patches, points, cells[which], level, high)
    keep = _may_win(rough, which, level)
    points, which, level = rough[keep], which[keep], level[keep]
    ends, gap = shortest_on_level(response, points, some[cells[which]], level, high)
    good = gap <= ON_CURVE
    every = np.concatenate([ends[good], extreme[near]])
    cell = np.concatenate([cells[which[good]], twice[near]])
    size = (every**2).sum(axis=1)
    order = np.lexsort((size, cell))
    first = order[np.concatenate(([True], np.diff(cell[order]) > 0))] if len(order) else order
    cuts[cell[first]] = every[first]
    return cuts, span


def _may_win(ends: FloatArray, which: IntArray, level: FloatArray) -> IntArray:
    """Indices of the ends that are nearly the nearest of their cell, each place once.

    Args:
        ends: (k, 2) on the patches.
        which: (k,) cells.
        level: (k,) on which of the curves.
    """
    size = np.hypot(ends[:, 0], ends[:, 1])
    least = np.full(which.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, which, size)
    near = np.flatnonzero(size <= least[which] + ROUGH)
    place = np.round(ends[near] / ROUGH)
    _, first = np.unique(
        np.column_stack([which[near], level[near], place]), axis=0, return_index=True
    )
    return np.asarray(near[first])


def _crossings(
    grid: FloatArray, ticks: FloatArray, target: FloatArray, tolerance: float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Where the grid's edges cross the two level curves: the nearest in each direction.

    Returns:
        (k, 2) points by linear interpolation, (k,) index of the cell, (k,) the level.
    """
    found: list[tuple[FloatArray, IntArray, FloatArray]] = []
    for side in (-1.0, 1.0) if tolerance > 0 else (0.0,):
        level = target + side * tolerance
        above = grid >= level[:, None, None]
        for axis_ in (1, 2):
            here = np.moveaxis(above, axis_, 1)
            cell, i, j = np.nonzero(here[:, :-1] != here[:, 1:])
            f = np.moveaxis(grid, axis_, 1)
            f0, f1 = f[cell, i, j], f[cell, i + 1, j]
            share = (level[cell] - f0) / (f1 - f0)
            along = ticks[i] + share * (ticks[i + 1] - ticks[i])
            pair = (along, ticks[j]) if axis_ == 1 else (ticks[j], along)
            found.append((np.column_stack(pair), cell, level[cell]))
    points = np.concatenate([part[0] for part in found])
    cell = np.concatenate([part[1] for part in found])
    levels = np.concatenate([part[2] for part in found])
    size = np.hypot(points[:, 0], points[:, 1])
    sector = np.minimum(
        (np.arctan2(points[:, 1], points[:, 0]) * (2 * SECTORS / np.pi)).astype(np.int64),
        SECTORS - 1,
    )
    group = (2 * cell + (levels > target[cell])) * SECTORS + sector
    order = np.lexsort((size, group))
    first = order[np.concatenate(([True], np.diff(group[order]) > 0))] if len(order) else order
    best = np.full(len(target), np.inf)
    np.minimum.at(best, cell, size)
    first = first[size[first] <= best[cell[first]] + WORSE]
    return points[first], cell[first], levels[first]


def shortest_on_level(
    response: Response, start: FloatArray, cells: IntArray, level: FloatArray, high: float
) -> tuple[FloatArray, FloatArray]:
    """Points of ``response = level`` that are locally nearest to the origin, within the box.

    Args:
        response: of n cells.
        start: (k, 2) near the curves.
        cells: (k,) whose response.
        level: (k,).
        high: upper bound of a and b.

    Returns:
        (k, 2) points, and (k,) by how much they miss their level.
    """
    x = start.copy()
    gap = np.full(len(x), np.inf)
    live = np.arange(len(x))
    for _ in range(ITERATIONS):
        at = response.jet(x[live], cells[live])
        miss = at.value - level[live]
        gap[live] = np.abs(miss)
        step = _step(x[live], miss, at, high)
        new = np.clip(x[live] + step, 0.0, high)
        moved = np.abs(new - x[live]).max(axis=1, initial=0.0)
        x[live] = new
        live = live[moved > SMALL_STEP]  # Newton's next step would be its square
        if not len(live):
            break
    return x, np.abs(response.jet(x, cells).value - level)


def _step(x: FloatArray, miss: FloatArray, at: Jet, high: float) -> FloatArray:
    """Towards the curve along the slope, and along the curve towards the origin."""
    g = at.slope
    held = np.zeros(x.shape, dtype=bool)
    step = np.zeros_like(x)
    for _ in range(2):  # at most two variables can be found to cross their bounds
        step = _free_step(x, miss, at, held)
        held |= ((x <= 0.0) & (step < 0.0)) | ((x >= high) & (step > 0.0))
        both = held.all(axis=1)
        held[both] = np.abs(g[both]) < np.abs(g[both]).max(axis=1, keepdims=True)
    step = _free_step(x, miss, at, held)
    length = np.linalg.norm(step, axis=1)
    return np.asarray(step * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-300))[:, None])


def _free_step(x: FloatArray, miss: FloatArray, at: Jet, held: NDArray[np.bool_]) -> FloatArray:
    g = np.where(held, 0.0, at.slope)
    square = np.maximum((g * g).sum(axis=1), 1e-300)
    normal = -(miss / square)[:, None] * g
    multiplier = -2.0 * (x * g).sum(axis=1) / square
    hessian = multiplier[:, None, None] * at.curvature
    hessian[:, [0, 1], [0, 1]] += 2.0
    tangent = np.column_stack([-g[:, 1], g[:, 0]]) / np.sqrt(square)[:, None]
    tangent[held.any(axis=1)] = 0.0
    pull = 2.0 * x + np.einsum("kij,kj->ki", hessian, normal)
    slope = (tangent * pull).sum(axis=1)
    curvature = np.einsum("ki,kij,kj->k", tangent, hessian, tangent)
    along = -slope / np.maximum(np.abs(curvature), 0.05)
    return np.asarray(normal + along[:, None] * tangent)


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
    span = reachable(response, high, grid)
    square = ticks[:, None] ** 2 + ticks[None, :] ** 2
    points, cell = starts_of((grid - target[:, None, None]) ** 2 + penalty * square, ticks, SECTORS)
    near, of, _ = _crossings(grid, ticks, target, 0.0)
    points, cell = np.concatenate([points, near]), np.concatenate([cell, of])

    def objective(x: FloatArray, which: IntArray) -> Jet:
        return penalised(response, x, cell[which], target[cell[which]], penalty)

    points = minimise_in_box(objective, points, high)
    value = penalised(response, points, cell, target[cell], penalty).value
    order = np.lexsort((value, cell))
    first = order[np.concatenate(([True], np.diff(cell[order]) > 0))]
    return Exact(points[first], span)


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
