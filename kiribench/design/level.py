"""Points on a level curve of a response, within the limits: the nearest, or the nearest to none."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.design.response import Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ITERATIONS = 8
ON_LEVEL = 1e-9

MOST_STEPS = 40
SMALL_STEP = 1e-8  # of the cell edge; Newton's next one would be its square
LONGEST_STEP = 0.05


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


def shortest_on_level(
    response: Response, start: FloatArray, cells: IntArray, level: FloatArray, high: float
) -> tuple[FloatArray, FloatArray]:
    """Points of ``response = level`` that are locally nearest to the origin, within the box.

    Sequential quadratic programming with the bounds as an active set.

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
    live = np.arange(len(x))
    for _ in range(MOST_STEPS):
        if not len(live):
            break
        at = response.jet(x[live], cells[live])
        new, moved = _stepped(x[live], at.value - level[live], at.slope, at.curvature, high)
        x[live] = new
        live = live[moved > SMALL_STEP]
    return x, np.abs(response.jet(x, cells).value - level)


@njit(cache=True, error_model="numpy")
def _stepped(
    x: FloatArray, miss: FloatArray, slope: FloatArray, curvature: FloatArray, high: float
) -> tuple[FloatArray, FloatArray]:
    """(k, 2) next points, and (k,) how far they moved."""
    new, moved = np.empty_like(x), np.empty(len(x))
    for k in range(len(x)):
        h = curvature[k]
        new[k, 0], new[k, 1], moved[k] = level_step(
            x[k, 0], x[k, 1], miss[k], slope[k, 0], slope[k, 1], h[0, 0], h[0, 1], h[1, 1], high
        )
    return new, moved


@njit(cache=True, error_model="numpy")
def level_step(
    x: float, y: float, miss: float,
    gx: float, gy: float, hxx: float, hxy: float, hyy: float, high: float,
) -> tuple[float, float, float]:  # fmt: skip
    """The next point: towards the curve along the slope, and along it towards the origin.

    Args:
        x, y: the point.
        miss: value minus level there.
        gx, gy, hxx, hxy, hyy: derivatives there.
        high: upper bound of both.

    Returns:
        The point, and how far it moved in the larger of both.
    """
    held_x = held_y = False
    dx = dy = 0.0
    for turn in range(3):  # at most two variables can be found to cross their bounds
        dx, dy = _free_step(x, y, miss, gx, gy, hxx, hxy, hyy, held_x, held_y)
        if turn == 2:
            break
        held_x |= (x <= 0.0 and dx < 0.0) or (x >= high and dx > 0.0)
        held_y |= (y <= 0.0 and dy < 0.0) or (y >= high and dy > 0.0)
        if held_x and held_y:  # the one with more slope is what can still reach the curve
            held_x, held_y = abs(gx) < abs(gy), abs(gy) < abs(gx)
    share = min(1.0, LONGEST_STEP / max(math.hypot(dx, dy), 1e-300))
    new_x = min(max(x + share * dx, 0.0), high)
    new_y = min(max(y + share * dy, 0.0), high)
    return new_x, new_y, max(abs(new_x - x), abs(new_y - y))


@njit(cache=True, error_model="numpy")
def _free_step(
    x: float, y: float, miss: float,
    gx: float, gy: float, hxx: float, hxy: float, hyy: float,
    held_x: bool, held_y: bool,
) -> tuple[float, float]:  # fmt: skip
    if held_x:
        gx = 0.0
    if held_y:
        gy = 0.0
    square = max(gx * gx + gy * gy, 1e-300)
    nx, ny = -miss / square * gx, -miss / square * gy
    if held_x or held_y:
        return nx, ny
    multiplier = -2.0 * (x * gx + y * gy) / square
    lxx, lxy, lyy = 2.0 + multiplier * hxx, multiplier * hxy, 2.0 + multiplier * hyy
    tx, ty = -gy / math.sqrt(square), gx / math.sqrt(square)
    pull = tx * (2.0 * x + lxx * nx + lxy * ny) + ty * (2.0 * y + lxy * nx + lyy * ny)
    bend = tx * tx * lxx + 2.0 * tx * ty * lxy + ty * ty * lyy
    along = -pull / max(abs(bend), 0.05)
    return nx + along * tx, ny + along * ty
