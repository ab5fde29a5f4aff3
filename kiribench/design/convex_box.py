"""A smooth convex function of many variables in a box: projected Newton."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Jet = Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]


def newton_in_box(
    jet: Jet, start: FloatArray, low: FloatArray, high: FloatArray, *, steps: int = 60
) -> FloatArray:
    """Minimum of a smooth convex function in a box, by Newton steps of the free variables.

    Bertsekas (1982, doi 10.1137/0320018): variables at a bound that the slope holds there are
    left out; the step of the others is shortened until the function falls.

    Args:
        jet: value, gradient (n,) and positive definite Hessian (n, n).
        start, low, high: (n,), the start within the bounds.
    """
    x = start.copy()
    value, gradient, hessian = jet(x)
    for _ in range(steps):
        held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
        free = ~held
        if np.abs(gradient[free]).max(initial=0.0) < 1e-12 * max(1.0, abs(value)):
            break
        direction = np.zeros_like(x)
        direction[free] = np.linalg.solve(hessian[np.ix_(free, free)], -gradient[free])
        length, better = 1.0, False
        while length > 1e-6:
            trial = np.clip(x + length * direction, low, high)
            new = jet(trial)
            if np.isfinite(new[0]) and new[0] < value - 1e-4 * gradient @ (x - trial):
                better = True
                break
            length /= 2
        if not better:
            break
        gained = value - new[0]
        x, (value, gradient, hessian) = trial, new
        if gained < 1e-12 * max(1e-6, abs(value)):
            break
    return x
