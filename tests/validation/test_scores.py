"""Scores against integration, counting and scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from sklearn.metrics import mean_absolute_error, r2_score, root_mean_squared_error
from tolerances import CRPS_QUADRATURE

from kiribench.validation import gaussian_scores, point_scores

RNG = np.random.default_rng(3)
TRUTH = RNG.normal(size=40)
MEAN = TRUTH + 0.3 * RNG.normal(size=40)
SD = RNG.uniform(0.1, 0.8, size=40)


def test_crps_is_the_integral_of_its_definition() -> None:
    """CRPS = integral of (F(x) - 1[x >= y])^2 (Gneiting & Raftery 2007, eq. 20)."""
    for y, m, s in zip(TRUTH[:8], MEAN[:8], SD[:8], strict=True):
        below, _ = quad(lambda x, m=m, s=s: norm.cdf(x, m, s) ** 2, m - 12 * s, y, epsabs=1e-12)
        above, _ = quad(lambda x, m=m, s=s: norm.sf(x, m, s) ** 2, y, m + 12 * s, epsabs=1e-12)
        ours = gaussian_scores.crps(np.array([y]), np.array([m]), np.array([s]))
        assert ours == pytest.approx(below + above, abs=CRPS_QUADRATURE)


def test_crps_of_a_sure_prediction_is_the_absolute_error() -> None:
    sure = gaussian_scores.crps(TRUTH, MEAN, np.full(40, 1e-12))
    assert sure == pytest.approx(point_scores.mae(TRUTH, MEAN), rel=1e-9)


def test_nlpd_is_the_density() -> None:
    expected = -np.mean(norm.logpdf(TRUTH, MEAN, SD))
    assert gaussian_scores.nlpd(TRUTH, MEAN, SD) == pytest.approx(expected, rel=1e-12)


def test_nlpd_and_crps_are_least_at_the_true_spread() -> None:
    truth = np.random.default_rng(0).normal(size=200_000)
    zero = np.zeros_like(truth)
    for score in (gaussian_scores.nlpd, gaussian_scores.crps):
        at = {s: score(truth, zero, np.full_like(truth, s)) for s in (0.8, 1.0, 1.25)}
        assert at[1.0] < at[0.8] and at[1.0] < at[1.25]


def test_coverage_counts() -> None:
    truth, zero, one = np.array([0.0, 0.6, 0.7, 1.9, 2.0]), np.zeros(5), np.ones(5)
    assert gaussian_scores.coverage(truth, zero, one, 0.5) == 0.4  # |z| <= 0.6745
    assert gaussian_scores.coverage(truth, zero, one, 0.95) == 0.8  # |z| <= 1.9600
    curve = gaussian_scores.calibration_curve(truth, zero, one)
    assert (0.95, 0.8) in curve and curve == sorted(curve)


def test_point_scores_are_scikit_learns() -> None:
    assert point_scores.r2(TRUTH, MEAN) == pytest.approx(r2_score(TRUTH, MEAN), rel=1e-12)
    assert point_scores.rmse(TRUTH, MEAN) == pytest.approx(root_mean_squared_error(TRUTH, MEAN))
    assert point_scores.mae(TRUTH, MEAN) == pytest.approx(mean_absolute_error(TRUTH, MEAN))
    assert point_scores.max_error(TRUTH, MEAN) == np.abs(TRUTH - MEAN).max()


def test_r2_is_absent_where_it_does_not_exist() -> None:
    assert point_scores.r2(np.array([0.3]), np.array([0.2])) is None
    assert point_scores.r2(np.full(5, 0.3), np.zeros(5)) is None
