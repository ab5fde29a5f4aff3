"""Paired comparison of two models on the same folds.

Training sets of different folds share most of their rows, so the folds' differences are
correlated and the plain paired t-test is far too sure. Nadeau & Bengio 2003
(doi:10.1023/A:1024068626366) replace the variance of the mean, s^2 / J, by
``(1 / J + n_test / n_train) s^2``. The same scale gives the Bayesian correlated t-test of
Corani & Benavoli 2015 (doi:10.1007/s10994-015-5486-z) and the probability that the
difference is too small to matter (region of practical equivalence, ROPE).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t as student


@dataclass(frozen=True)
class Comparison:
    """Model against reference, score smaller is better.

    Attributes:
        difference: mean of model minus reference over the folds; positive: the model is worse.
        standard_error: corrected.
        statistic: difference over standard error.
        p_value: two-sided, of no difference.
        low, high: 95 % interval of the difference.
        p_worse, p_equivalent, p_better: probabilities that the difference is above, inside
            and below the ROPE; they add up to 1.
        rope: half its width.
        folds: number of folds.
    """

    difference: float
    standard_error: float
    statistic: float
    p_value: float
    low: float
    high: float
    p_worse: float
    p_equivalent: float
    p_better: float
    rope: float
    folds: int


def compare(
    model: ArrayLike, reference: ArrayLike, *, test_over_train: float, rope: float = 0.0
) -> Comparison:
    """The corrected resampled t-test and the ROPE of paired scores.

    Args:
        model, reference: (k,) scores of the same folds, k at least 2.
        test_over_train: test rows over training rows of a fold: 1 / 9 for ten folds.
        rope: half width of the region of practical equivalence, unit of the scores.
    """
    d = np.asarray(model, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    k = len(d)
    if k < 2:
        raise ValueError("a comparison needs at least two folds")
    mean = float(d.mean())
    error = math.sqrt((1.0 / k + test_over_train) * float(d.var(ddof=1)))
    freedom = k - 1
    if error <= 1e-15 * max(abs(mean), float(np.max(np.abs(d)))) or error == 0.0:
        # Every fold has the same difference: there is no spread to test against.
        equal = mean == 0.0
        inside = abs(mean) <= rope
        return Comparison(
            mean,
            0.0,
            0.0 if equal else math.copysign(math.inf, mean),
            1.0 if equal else 0.0,
            mean,
            mean,
            float(not inside and mean > 0),
            float(inside),
            float(not inside and mean < 0),
            rope,
            k,
        )
    statistic = mean / error
    reach = float(student.ppf(0.975, freedom)) * error
    below = float(student.cdf((-rope - mean) / error, freedom))
    above = float(student.sf((rope - mean) / error, freedom))
    return Comparison(
        difference=mean,
        standard_error=error,
        statistic=statistic,
        p_value=2.0 * float(student.sf(abs(statistic), freedom)),
        low=mean - reach,
        high=mean + reach,
        p_worse=above,
        p_equivalent=max(0.0, 1.0 - below - above),
        p_better=below,
        rope=rope,
        folds=k,
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values: the chance of any false alarm among all stays below the level."""
    order = np.argsort(p_values, kind="stable")
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for position, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - position) * p_values[index]))
        adjusted[int(index)] = largest
    return adjusted
