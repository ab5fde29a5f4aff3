"""Where the search on a surrogate begins: extremes and level curves of bicubic patches.

Everything here is rough by the error of the patches; Newton's method on the surrogate decides.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.design.box_newton import NOTICED, box_step
from kiribench.design.patch_walk import descend, towards_origin, walk
from kiribench.design.patchwork import Patchwork, patch_jet, patch_jet_in

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BELOW_GRID = 0.02
"""By how much an extreme may exceed the nearest grid point: half the curvature (up to some 100 for
Poisson's ratio) times the square of half the grid's diagonal (.018)."""

ROUGH_VALUE = 5e-4
"""Of the response: by how much extremes of the patches may be off."""

ROUGH_PLACE = 2e-3
"""Of the cell edge: by how much ends on the patches may be off."""

WORSE = 0.005
"""Of the cell edge: a crossing of the grid's edges is at most so much farther out than the end of
its branch, half a step along the circle about the origin (.0125^2 / 2 r for r > .02); what comes
nearer than by a slope is looked for within the squares."""

APART = 1e-4
"""Of the cell edge: ends nearer to each other are one."""

NEARER = 5e-4
"""Of the cell edge: by how much a place must be nearer than the nearest end to be looked for."""

_MOST = 64  # ends a cell
_HALVINGS = 3  # of a square of the grid
_ARRIVED = 1e-6  # of the response


def rough_extremes(patches: Patchwork) -> tuple[FloatArray, IntArray, FloatArray]:
    """The lowest and highest places of the patches, and whatever is nearly as low or high.

    Returns:
        (k, 2) points, (k,) their cell, (k,) 1 where it is a minimum and -1 where a maximum.
    """
    points, cell, sign = _extremes(patches.nodes, patches.step)
    return points, cell, sign


def rough_ends(
    patches: Patchwork, level: FloatArray, side: FloatArray, worse: float = ROUGH_PLACE
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Locally nearest points to the origin of the curves ``response = level``.

    Args:
        patches: of n cells.
        level: (n,).
        side: (n,) 1 where the response at the origin is below its level, -1 where above, 0 for a
            cell to leave out.
        worse: how much farther out than the nearest an end may be, fraction of the cell edge.

    Returns:
        (k, 2) ends and (k,) their cells; (m, 2) extremes so close to their level that only the
        surrogate can say whether they reach it, and (m,) their cells.
    """
    ends, cell, peaks, peak_cell = _ends(patches.nodes, patches.step, level, side, worse)
    return ends, cell, peaks, peak_cell


@njit(cache=True, error_model="numpy")
def _extremes(nodes: FloatArray, step: float) -> tuple[FloatArray, IntArray, FloatArray]:
    n, count = nodes.shape[0], nodes.shape[1]
    points = np.empty((2 * _MOST * n, 2))
    cell, sign = np.empty(2 * _MOST * n, dtype=np.int64), np.empty(2 * _MOST * n)
    found = 0
    mine, value = np.empty((_MOST, 2)), np.empty(_MOST)
    reach = np.empty((count, count))  # the least of a node's control points, or less
    for k in range(n):
        for s in (1.0, -1.0):
            low = np.inf
            for i in range(count):
                for j in range(count):
                    f = nodes[k, i, j]
                    low = min(low, s * f[0])
                    reach[i, j] = s * f[0] - (abs(f[1]) + abs(f[2])) / 3.0 - abs(f[3]) / 9.0
            kept = 0
            for i in range(count):
                for j in range(count):
                    near = s * nodes[k, i, j, 0] <= low + BELOW_GRID
                    if near and kept < _MOST and _is_lowest(nodes[k], i, j, s):
                        x, y, v = descend(nodes[k], step, s, i * step, j * step)
                        kept = _add(mine, value, kept, x, y, v)
            least = value[:kept].min()
            # Squares whose control points go below the least so far: ridges between the nodes.
            for i in range(count - 1):
                for j in range(count - 1):
                    rough = min(
                        min(reach[i, j], reach[i, j + 1]), min(reach[i + 1, j], reach[i + 1, j + 1])
                    )
                    if rough < least - NOTICED and kept < _MOST:
                        x, y = i * step, j * step
                        bound, _, _, _ = _bound(nodes[k], step, s * least, -s, x, y, step)
                        if bound > NOTICED:
                            x, y = x + 0.5 * step, y + 0.5 * step
                            x, y, v = descend(nodes[k], step, s, x, y)
                            kept = _add(mine, value, kept, x, y, v)
                            least = min(least, v)
            for m in range(kept):
                if value[m] <= least + ROUGH_VALUE:
                    points[found] = mine[m]
                    cell[found], sign[found] = k, s
                    found += 1
    return points[:found].copy(), cell[:found].copy(), sign[:found].copy()


@njit(cache=True, error_model="numpy")
def _ends(
    nodes: FloatArray, step: float, level: FloatArray, side: FloatArray, worse: float
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    n, count = nodes.shape[0], nodes.shape[1]
    ends, cell = np.empty((_MOST * n, 2)), np.empty(_MOST * n, dtype=np.int64)
    peaks, peak_cell = np.empty((_MOST * n, 2)), np.empty(_MOST * n, dtype=np.int64)
    found, peaked = 0, 0
    mine, size = np.empty((_MOST, 2)), np.empty(_MOST)
    tops, height = np.empty((_MOST, 2)), np.empty(_MOST)
    starts, far = np.empty((2 * count * count, 2)), np.empty(2 * count * count)
    for k in range(n):
        if side[k] == 0.0:
            continue
        begun = _crossings(nodes[k], step, level[k], starts, far)
        kept = 0
        nearest = np.inf
        if begun:
            # The nearest crossing first: what lies much farther out than its end cannot win.
            first = far[:begun].argmin()
            x, y, gap = walk(nodes[k], step, level[k], starts[first, 0], starts[first, 1])
            nearest = far[first]
            if gap <= _ARRIVED:
                nearest = min(nearest, math.hypot(x, y))
        for m in range(begun):
            if far[m] <= nearest + worse + WORSE and kept < _MOST:
                x, y, gap = walk(nodes[k], step, level[k], starts[m, 0], starts[m, 1])
                if gap <= _ARRIVED:
                    kept = _add(mine, size, kept, x, y, math.hypot(x, y))
        kept, topped = _between(nodes[k], step, level[k], side[k], mine, size, kept, tops, height)
        peaks[peaked : peaked + topped] = tops[:topped]
        peak_cell[peaked : peaked + topped] = k
        peaked += topped
        least = size[:kept].min() if kept else 0.0
        for m in range(kept):
            if size[m] <= least + worse:
                ends[found] = mine[m]
                cell[found] = k
                found += 1
    return (
        ends[:found].copy(),
        cell[:found].copy(),
        peaks[:peaked].copy(),
        peak_cell[:peaked].copy(),
    )


@njit(cache=True, error_model="numpy")
def _between(
    nodes: FloatArray, step: float, level: float, side: float,
    ends: FloatArray, size: FloatArray, kept: int, tops: FloatArray, height: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """What the grid's points do not show: nearer ends within its squares, by halving them.

    A bicubic patch lies below the largest of its 16 control points. Every square that is nearer
    than the nearest end so far, and may reach the level by that bound, is looked into.

    Args:
        nodes, step: of the cell.
        level, side: what is to be reached, from below (1) or from above (-1).
        ends, size, kept: ends so far and their distances, added to.
        tops, height: extremes within ``ROUGH_VALUE`` of the level are put there.

    Returns:
        Numbers of ends and of extremes.
    """
    count, topped = nodes.shape[0], 0
    nearest = size[:kept].min() if kept else np.inf
    stack = np.empty((4 * _HALVINGS + 4, 3))
    reach = np.empty((count, count))  # the largest of a node's control points, or more
    for i in range(count):
        for j in range(count):
            f = nodes[i, j]
            bend = (abs(f[1]) + abs(f[2])) / 3.0 + abs(f[3]) / 9.0
            reach[i, j] = side * (f[0] - level) + bend
    for i in range(count - 1):
        for j in range(count - 1):
            if math.hypot(i, j) * step >= nearest - NEARER:
                break
            rough = max(
                max(reach[i, j], reach[i, j + 1]), max(reach[i + 1, j], reach[i + 1, j + 1])
            )
            if rough < -ROUGH_VALUE:
                continue
            stack[0] = i * step, j * step, step
            open_ = 1
            while open_ > 0:
                open_ -= 1
                x, y, edge = stack[open_]
                if math.hypot(x, y) >= nearest - NEARER:
                    continue
                bound, at_x, at_y, there = _bound(nodes, step, level, side, x, y, edge)
                if bound < -ROUGH_VALUE:
                    continue
                whole = edge > 1.5 * step * 0.5**_HALVINGS
                if not whole and math.hypot(x, y) >= nearest - edge:
                    continue
                if there >= 0.0 and math.hypot(at_x, at_y) < nearest:
                    # A place beyond the level that is nearer than every end: there is a better.
                    at_x, at_y = towards_origin(nodes, step, level, side, at_x, at_y)
                elif (bound < 0.0 or not whole) and _levels_off(nodes, step, side, x, y, edge):
                    at_x, at_y, top = descend(nodes, step, -side, x + 0.5 * edge, y + 0.5 * edge)
                    there = -top - side * level
                    if abs(there) <= ROUGH_VALUE and topped < _MOST:
                        topped = _add(tops, height, topped, at_x, at_y, there)
                    if there > 0.0 and math.hypot(at_x, at_y) < nearest:
                        at_x, at_y = towards_origin(nodes, step, level, side, at_x, at_y)
                    else:
                        there = -1.0
                else:
                    there = -1.0
                if there >= 0.0 and kept < _MOST:
                    at_x, at_y, gap = walk(nodes, step, level, at_x, at_y)
                    if gap <= _ARRIVED:
                        kept = _add(ends, size, kept, at_x, at_y, math.hypot(at_x, at_y))
                        nearest = min(nearest, math.hypot(at_x, at_y))
                if bound >= 0.0 and whole:
                    half = 0.5 * edge
                    for m in range(4):
                        stack[open_] = x + (m % 2) * half, y + (m // 2) * half, half
                        open_ += 1
    return kept, topped


@njit(cache=True, error_model="numpy")
def _levels_off(
    nodes: FloatArray, step: float, side: float, x: float, y: float, edge: float
) -> bool:
    """Whether Newton's method from a square's middle stays there: no mere slope."""
    high = step * (nodes.shape[0] - 1)
    at_x, at_y = x + 0.5 * edge, y + 0.5 * edge
    _, gx, gy, hxx, hxy, hyy = patch_jet(nodes, step, at_x, at_y)
    dx, dy, _ = box_step(
        at_x, at_y, -side * gx, -side * gy, -side * hxx, -side * hxy, -side * hyy, high
    )
    # To a bound that cuts the square off is no farther than to the square's own side.
    dx = min(max(dx, -at_x), high - at_x)
    dy = min(max(dy, -at_y), high - at_y)
    there: bool = max(abs(dx), abs(dy)) <= edge
    return there


@njit(cache=True, error_model="numpy")
def _bound(
    nodes: FloatArray, step: float, level: float, side: float, x: float, y: float, edge: float
) -> tuple[float, float, float, float]:
    """No place of a square is farther beyond the level; and its corner nearest to the origin.

    Returns:
        The largest control point, and of the corners beyond the level the nearest to the origin:
        its place and 1, or -1 where none is.
    """
    bound, near, there = -np.inf, np.inf, -1.0
    at_x, at_y = x, y
    third = edge / 3.0
    # Jets within the square, so that all corners belong to the same patch.
    base_i = min(int((x + 0.5 * edge) / step), nodes.shape[0] - 2)
    base_j = min(int((y + 0.5 * edge) / step), nodes.shape[0] - 2)
    for p in range(2):
        for q in range(2):
            cx, cy = x + p * edge, y + q * edge
            f, gx, gy, _, gxy, _ = patch_jet_in(nodes, step, cx, cy, base_i, base_j)
            h = side * (f - level)
            by_x = side * third * (gx if p == 0 else -gx)
            by_y = side * third * (gy if q == 0 else -gy)
            by_both = side * third * third * (gxy if p == q else -gxy)
            bound = max(bound, h, h + by_x, h + by_y, h + by_x + by_y + by_both)
            if h >= 0.0 and math.hypot(cx, cy) < near:
                near, at_x, at_y, there = math.hypot(cx, cy), cx, cy, 1.0
    return bound, at_x, at_y, there


@njit(cache=True, error_model="numpy")
def _crossings(
    nodes: FloatArray, step: float, level: float, starts: FloatArray, far: FloatArray
) -> int:
    """Points where the grid's edges cross the level, by linear interpolation; how many."""
    count, found = nodes.shape[0], 0
    for i in range(count):
        for j in range(count):
            f = nodes[i, j, 0]
            if i + 1 < count and (f >= level) != (nodes[i + 1, j, 0] >= level):
                share = (level - f) / (nodes[i + 1, j, 0] - f)
                starts[found] = (i + share) * step, j * step
                far[found] = math.hypot(starts[found, 0], starts[found, 1])
                found += 1
            if j + 1 < count and (f >= level) != (nodes[i, j + 1, 0] >= level):
                share = (level - f) / (nodes[i, j + 1, 0] - f)
                starts[found] = i * step, (j + share) * step
                far[found] = math.hypot(starts[found, 0], starts[found, 1])
                found += 1
    return found


@njit(cache=True, error_model="numpy")
def _is_lowest(nodes: FloatArray, i: int, j: int, sign: float) -> bool:
    """Whether no neighbour is lower; of equal ones the last is."""
    count, here = nodes.shape[0], sign * nodes[i, j, 0]
    for p in range(max(i - 1, 0), min(i + 2, count)):
        for q in range(max(j - 1, 0), min(j + 2, count)):
            there = sign * nodes[p, q, 0]
            if there < here or (there == here and (p > i or (p == i and q > j))):
                return False
    return True


@njit(cache=True, error_model="numpy")
def _add(points: FloatArray, value: FloatArray, kept: int, x: float, y: float, v: float) -> int:
    """Append a point unless it is there; the new number of points."""
    for m in range(kept):
        if abs(points[m, 0] - x) < APART and abs(points[m, 1] - y) < APART:
            return kept
    points[kept] = x, y
    value[kept] = v
    return kept + 1
