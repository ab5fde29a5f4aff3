"""Many small minimisations over a square at once: projected Newton in (a, b)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.design.response import Jet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Objective = Callable[[FloatArray, IntArray], Jet]

ITERATIONS = 60
CONVERGED = 1e-9  # projected slope; the functions are of order 1
SMALL_STEP = 1e-8  # of the cell edge; Newton's next one would be its square
LONGEST_STEP = 0.05
NOTICED = 1e-12
"""Gain of a function of order 1 that its rounding hides: such a last step is taken unseen."""


def minimise_in_box(objective: Objective, start: FloatArray, high: float) -> FloatArray:
    """Local minima from k starts, each of its own function, within 0 <= a, b <= high.

    Newton steps in the variables that are not held at a bound; where the curvature is not
    positive it is made so, and a step that does not lower the function is shortened.

    Args:
        objective: jet of the functions at (j, 2) points for the indices (j,) of the starts.
        start: (k, 2).
        high: upper bound of both.

    Returns:
        (k, 2).
    """
    x = np.clip(start, 0.0, high)
    live = np.arange(len(x))
    radius = np.full(len(x), LONGEST_STEP)
    at = objective(x, live)
    value, slope, curvature = at.value.copy(), at.slope.copy(), at.curvature.copy()
    for _ in range(ITERATIONS):
        trial, length, last = _trials(x[live], slope[live], curvature[live], radius[live], high)
        x[live[last]] = trial[last]
        moving = (length > 0.0) & ~last
        live, trial, length = live[moving], trial[moving], length[moving]
        if not len(live):
            break
        new = objective(trial, live)
        better = new.value < value[live]
        radius[live] = np.where(
            better, np.minimum(2 * radius[live], LONGEST_STEP), radius[live] / 4
        )
        taken = live[better]
        x[taken], value[taken] = trial[better], new.value[better]
        slope[taken], curvature[taken] = new.slope[better], new.curvature[better]
        live = live[np.where(better, length, radius[live]) > SMALL_STEP]
    return x


@njit(cache=True, error_model="numpy")
def expected_gain(
    x: FloatArray, slope: FloatArray, curvature: FloatArray, high: float
) -> FloatArray:
    """(k,) by how much the next step should lower each function: half of slope times step."""
    gain = np.zeros(len(x))
    for k in range(len(x)):
        h = curvature[k]
        dx, dy, _ = box_step(
            x[k, 0], x[k, 1], slope[k, 0], slope[k, 1], h[0, 0], h[0, 1], h[1, 1], high
        )
        gain[k] = -0.5 * (slope[k, 0] * dx + slope[k, 1] * dy)
    return gain


@njit(cache=True, error_model="numpy")
def _trials(
    x: FloatArray, slope: FloatArray, curvature: FloatArray, radius: FloatArray, high: float
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """(k, 2) next points, (k,) lengths of the steps (0: none is needed), (k,) whether the last."""
    trial, length = x.copy(), np.zeros(len(x))
    last = np.zeros(len(x), dtype=np.bool_)
    for k in range(len(x)):
        h = curvature[k]
        dx, dy, pull = box_step(
            x[k, 0], x[k, 1], slope[k, 0], slope[k, 1], h[0, 0], h[0, 1], h[1, 1], high
        )
        if pull > CONVERGED:
            length[k] = math.hypot(dx, dy)
            share = min(1.0, radius[k] / max(length[k], 1e-300))
            last[k] = share == 1.0 and pull * length[k] <= NOTICED
            trial[k, 0] = min(max(x[k, 0] + share * dx, 0.0), high)
            trial[k, 1] = min(max(x[k, 1] + share * dy, 0.0), high)
    return trial, length, last


@njit(cache=True, error_model="numpy")
def box_step(
    x: float, y: float, gx: float, gy: float, hxx: float, hxy: float, hyy: float, high: float
) -> tuple[float, float, float]:
    """A descent step of the free variables by curvatures made positive, and the largest pull.

    A variable at a bound that descent would cross is held. With both free the step is
    ``-|H|^-1 g``: the absolute eigenvalues l, by the projector ``(H - l' I) / (l - l')``.
    """
    held_x = (x <= 0.0 and gx > 0.0) or (x >= high and gx < 0.0)
    held_y = (y <= 0.0 and gy > 0.0) or (y >= high and gy < 0.0)
    if held_x and held_y:
        return 0.0, 0.0, 0.0
    if held_x:
        return 0.0, -gy / max(abs(hyy), 1e-12), abs(gy)
    if held_y:
        return -gx / max(abs(hxx), 1e-12), 0.0, abs(gx)
    pull = max(abs(gx), abs(gy))
    middle, half = 0.5 * (hxx + hyy), math.hypot(0.5 * (hxx - hyy), hxy)
    big, small = middle + half, middle - half
    floor = max(1e-8 * max(abs(big), abs(small)), 1e-12)
    if half <= 1e-12 * abs(middle):
        size = max(abs(middle), floor)
        return -gx / size, -gy / size, pull
    along_x = ((hxx - small) * gx + hxy * gy) / (2.0 * half)
    along_y = (hxy * gx + (hyy - small) * gy) / (2.0 * half)
    big, small = max(abs(big), floor), max(abs(small), floor)
    return (
        -along_x / big - (gx - along_x) / small,
        -along_y / big - (gy - along_y) / small,
        pull,
    )
