"""Scores of Gaussian predictive distributions, each row a mean and a standard deviation.

Gneiting & Raftery 2007 (doi:10.1198/016214506000001437): both scores are proper, so that
nobody gains by stating more or less uncertainty than there is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

FloatArray = NDArray[np.float64]
LEVELS = (0.5, 0.8, 0.95)
CURVE = (*(round(0.05 * step, 2) for step in range(1, 20)), 0.99)


def nlpd(truth: FloatArray, mean: FloatArray, sd: FloatArray) -> float:
    """Mean negative log predictive density, nats a row (unit: that of log targets).

    Args:
        truth, mean, sd: (n,), unit of the targets; sd positive.
    """
    z = (truth - mean) / sd
    return float(np.mean(0.5 * np.log(2.0 * np.pi) + np.log(sd) + 0.5 * z * z))


def crps(truth: FloatArray, mean: FloatArray, sd: FloatArray) -> float:
    """Mean continuous ranked probability score, unit of the targets (closed form, eq. 21)."""
    z = (truth - mean) / sd
    each = sd * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))
    return float(np.mean(each))


def coverage(truth: FloatArray, mean: FloatArray, sd: FloatArray, level: float) -> float:
    """Share of rows inside the central interval of probability ``level``."""
    return float(np.mean(np.abs(truth - mean) <= norm.ppf(0.5 + 0.5 * level) * sd))


def calibration_curve(
    truth: FloatArray, mean: FloatArray, sd: FloatArray
) -> list[tuple[float, float]]:
    """(stated, found) coverage at the levels of :data:`CURVE`."""
    return [(level, coverage(truth, mean, sd, level)) for level in CURVE]
