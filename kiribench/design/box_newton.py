"""Many small minimisations over a square at once: projected Newton in (a, b)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kiribench.design.response import Jet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Objective = Callable[[FloatArray, IntArray], Jet]

ITERATIONS = 60
CONVERGED = 1e-9  # projected slope; the functions are of order 1
SMALL_STEP = 1e-8  # of the cell edge; Newton's next one would be its square
LONGEST_STEP = 0.05


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
        held = held_at_bound(x[live], slope[live], high)
        pull = np.where(held, 0.0, slope[live])
        moving = np.abs(pull).max(axis=1, initial=0.0) > CONVERGED
        live, held, pull = live[moving], held[moving], pull[moving]
        if not len(live):
            break
        step = newton_step(curvature[live], pull, held)
        length = np.linalg.norm(step, axis=1)
        step *= np.minimum(1.0, radius[live] / np.maximum(length, 1e-300))[:, None]
        trial = np.clip(x[live] + step, 0.0, high)
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


def held_at_bound(x: FloatArray, slope: FloatArray, high: float) -> NDArray[np.bool_]:
    """(k, 2) variables at a bound that descent would cross."""
    return ((x <= 0.0) & (slope > 0.0)) | ((x >= high) & (slope < 0.0))


def newton_step(curvature: FloatArray, slope: FloatArray, held: NDArray[np.bool_]) -> FloatArray:
    """(k, 2) descent steps of the free variables, by curvatures made positive."""
    free = ~held
    h = curvature * (free[:, :, None] & free[:, None, :])
    h[:, [0, 1], [0, 1]] += held  # a unit entry for a variable that stays
    values, vectors = np.linalg.eigh(h)
    size = np.maximum(np.abs(values), 1e-8 * np.abs(values).max(axis=1, keepdims=True) + 1e-300)
    turned = np.einsum("kij,ki->kj", vectors, np.where(held, 0.0, slope))
    return np.asarray(np.where(held, 0.0, -np.einsum("kij,kj->ki", vectors, turned / size)))
