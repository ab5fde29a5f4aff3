"""Rows to a grid: found, resampled, never extrapolated."""

from __future__ import annotations

import numpy as np
import pytest
from stand_in import stand_in_poisson
from tolerances import SPLINE_RESAMPLING

from kiribench.errors import DataError
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.grid import are_curves, common_strains, find_grid, resample

FloatArray = np.ndarray


def test_a_shuffled_grid_is_found(curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    order = np.random.default_rng(0).permutation(len(X))
    grid = find_grid(X[order], y[order])
    assert grid is not None
    assert grid.values.shape == (25, 9)
    assert grid.observed.all()
    np.testing.assert_array_equal(grid.values[grid.row_design, grid.row_curve], y[order])
    np.testing.assert_array_equal(grid.designs[grid.row_design], X[order, :2])


def test_missing_rows_are_marked(curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    grid = find_grid(X[3:], y[3:])
    assert grid is not None
    np.testing.assert_array_equal(grid.missing, [0, 1, 2])


def test_rounded_strains_are_one_strain(curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    X = X.copy()
    X[:, 2] *= 1.0 + 1e-12 * np.random.default_rng(0).standard_normal(len(X))
    grid = find_grid(X, y)
    assert grid is not None
    assert len(grid.curve) == 9


def test_no_grid_in_scattered_repeated_or_one_column_rows(
    curves: tuple[FloatArray, FloatArray],
) -> None:
    X, y = curves
    assert find_grid(np.random.default_rng(0).random((50, 3)), np.zeros(50)) is None
    assert find_grid(np.vstack([X, X[:1]]), np.append(y, y[0])) is None
    assert find_grid(X[:, 2:], y) is None
    assert not are_curves(np.vstack([X, X[:1]]))


def test_resampling_costs_little_and_says_how_much(
    sheet_curves: tuple[FloatArray, FloatArray],
) -> None:
    X, y = sheet_curves
    assert find_grid(X, y) is None
    assert are_curves(X)
    grid = resample(X, y)
    percent, strain = grid.designs[:, :, None] / 100.0, grid.curve[None, :]
    truth = stand_in_poisson(percent[:, 0], percent[:, 1], strain)
    error = (grid.values - truth)[grid.observed]
    assert np.sqrt(np.mean(error**2)) < SPLINE_RESAMPLING
    # The reported estimate is neither flattery nor scare.
    assert grid.resampling_rms == pytest.approx(np.sqrt(np.mean(error**2)), rel=1.0)


def test_resampling_never_extrapolates(sheet_curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = sheet_curves
    short = X[:, 0] == X[0, 0]
    cut = ~short | (X[:, 2] < 0.4)
    grid = resample(X[cut], y[cut])
    for design in range(len(grid.designs)):
        own = X[cut][grid.row_design == design, 2]
        outside = (grid.curve < own.min() - 1e-9) | (grid.curve > own.max() + 1e-9)
        assert not grid.observed[design, outside].any()
        assert grid.observed[design, ~outside].all()
    assert len(grid.missing) > 0


def test_common_strains_lie_where_nearly_all_curves_do(
    sheet_curves: tuple[FloatArray, FloatArray],
) -> None:
    X, _ = sheet_curves
    _, design = np.unique(X[:, :2], axis=0, return_inverse=True)
    strains = common_strains(X[:, 2], design)
    assert len(strains) == 12
    assert (np.diff(strains) > 0).all()
    first = np.array([X[design == d, 2].min() for d in range(36)])
    last = np.array([X[design == d, 2].max() for d in range(36)])
    assert np.mean(first <= strains[0]) >= 0.85
    assert np.mean(last >= strains[-1]) >= 0.85


def test_holey_curves_predict_as_the_dense_gp_does(
    sheet_curves: tuple[FloatArray, FloatArray],
) -> None:
    X, y = sheet_curves
    cut = (X[:, 0] != X[0, 0]) | (X[:, 2] < 0.4)
    X, y = X[cut], y[cut]
    grid = KroneckerGP().fit(X, y)
    assert grid.structure_ == "resampled"
    dense = KroneckerGP(
        resampling="never", hyperparameters=grid.hyperparameters_, optimise=False
    ).fit(X, y)
    points = X[::5] + np.array([2.0, -2.0, 0.01])
    difference = grid.predict(points) - dense.predict(points)
    assert np.sqrt(np.mean(difference**2)) < 10 * SPLINE_RESAMPLING


def test_too_many_scattered_rows_are_refused_with_the_way_out() -> None:
    X = np.random.default_rng(0).random((60, 3))
    with pytest.raises(DataError, match="svgp") as caught:
        KroneckerGP(max_dense_rows=50).fit(X, X[:, 0])
    assert caught.value.code == "gp-too-many-scattered-rows"
