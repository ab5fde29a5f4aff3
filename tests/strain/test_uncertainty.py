"""First-order propagation and Fieller's interval, against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import FIELLER_COVERAGE, FIRST_ORDER_SD

from kiribench.strain.uncertainty import cell_quantities, fieller, jacobian, propagate

CELL = 7.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
SD_MM = 0.25
DRAWS = 200_000


@pytest.fixture(scope="module")
def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(deformed cell, propagated covariance, drawn covariance)."""
    rng = np.random.default_rng(5)
    deformed = CELL @ np.array([[1.3, 0.25], [0.0, 0.9]]).T
    sd = np.full(4, SD_MM)
    first_order = propagate(CELL, deformed, sd, 0.5 * sd)
    values = cell_quantities(
        CELL + SD_MM * rng.normal(size=(DRAWS, 4, 2)),
        deformed + 0.5 * SD_MM * rng.normal(size=(DRAWS, 4, 2)),
    )
    return deformed, first_order, np.cov(values.T)


def test_propagation_agrees_with_monte_carlo(
    drawn: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    _, first_order, sampled = drawn
    np.testing.assert_allclose(
        np.sqrt(np.diag(first_order)), np.sqrt(np.diag(sampled)), rtol=FIRST_ORDER_SD
    )
    correlation = first_order[0, 1] / np.sqrt(first_order[0, 0] * first_order[1, 1])
    drawn_correlation = sampled[0, 1] / np.sqrt(sampled[0, 0] * sampled[1, 1])
    assert correlation == pytest.approx(drawn_correlation, abs=FIRST_ORDER_SD)


def test_square_cell_has_the_textbook_sd() -> None:
    # Edge of length L between two nodes: sd(L) = sqrt(2) s; the mean of two edges that
    # share no node: s; the ratio of two poses: sqrt(2) s / L. 0.25 mm on 15 mm: 2.36 %.
    sd = np.full(4, SD_MM)
    covariance = propagate(CELL, CELL, sd, sd)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(np.sqrt(2.0) * SD_MM / 15.0, rel=1e-6)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(np.sqrt(2.0) * SD_MM / 15.0, rel=1e-6)
    # Edges along and across meet at right angles: their errors are not correlated.
    assert covariance[0, 1] == pytest.approx(0.0, abs=1e-9)


def test_jacobian_of_a_linear_function_is_exact() -> None:
    weights = np.random.default_rng(1).normal(size=(2, 4, 2))

    def linear(reference: np.ndarray, deformed: np.ndarray) -> np.ndarray:
        return np.stack([(weights[0] * reference).sum() + (weights[1] * deformed).sum()])

    np.testing.assert_allclose(jacobian(linear, CELL, CELL)[0], weights, atol=1e-9)


def test_fieller_covers_the_true_ratio_in_95_percent() -> None:
    rng = np.random.default_rng(11)
    covariance = 0.024**2 * np.array([[1.0, 0.3], [0.3, 1.0]])
    truth = np.array([0.08, 0.20])
    drawn = rng.multivariate_normal(truth, covariance, size=20_000)
    interval = fieller(
        drawn[:, 0],
        drawn[:, 1],
        np.full(len(drawn), covariance[0, 0]),
        np.full(len(drawn), covariance[1, 1]),
        np.full(len(drawn), covariance[0, 1]),
    )
    assert interval.bounded.all()
    inside = (interval.low <= 0.4) & (interval.high >= 0.4)
    assert inside.mean() == pytest.approx(0.95, abs=FIELLER_COVERAGE)


def test_fieller_is_unbounded_when_the_denominator_may_be_zero() -> None:
    variance = np.full(2, 0.024**2)
    interval = fieller(
        np.array([0.01, 0.01]), np.array([0.046, 0.048]), variance, variance, np.zeros(2)
    )
    # 1.96 sd = 0.047.
    assert interval.bounded.tolist() == [False, True]
    assert np.isnan(interval.low[0])
    assert np.isnan(interval.high[0])
    assert interval.low[1] < interval.value[1] < interval.high[1]


def test_fieller_without_uncertainty_is_the_ratio() -> None:
    zero = np.zeros(1)
    interval = fieller(np.array([0.1]), np.array([0.25]), zero, zero, zero)
    np.testing.assert_allclose([interval.low[0], interval.high[0]], 0.4)
