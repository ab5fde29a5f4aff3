"""Scores of point predictions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def r2(truth: FloatArray, mean: FloatArray) -> float | None:
    """Coefficient of determination against the mean of ``truth`` (n,).

    ``None`` where it does not exist: fewer than two rows, or equal targets.
    """
    spread = float(np.sum((truth - truth.mean()) ** 2)) if len(truth) > 1 else 0.0
    if spread <= 1e-24 * max(1.0, float(np.max(np.abs(truth), initial=0.0)) ** 2):
        return None
    return 1.0 - float(np.sum((truth - mean) ** 2)) / spread


def rmse(truth: FloatArray, mean: FloatArray) -> float:
    """Root mean square error, unit of the targets."""
    return float(np.sqrt(np.mean((truth - mean) ** 2)))


def mae(truth: FloatArray, mean: FloatArray) -> float:
    """Mean absolute error, unit of the targets; the CRPS of a prediction without spread."""
    return float(np.mean(np.abs(truth - mean)))


def max_error(truth: FloatArray, mean: FloatArray) -> float:
    """Largest absolute error, unit of the targets."""
    return float(np.max(np.abs(truth - mean)))
