"""Folds left out in closed form equal refits at fixed hyperparameters, for every GP."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tolerances import GP_CLOSED_FORM

from kiribench.errors import DataError, UsageError
from kiribench.surrogate.leave_out import leave_folds_out
from kiribench.surrogate.registry import make
from kiribench.surrogate.svgp import SparseVariationalGP

FloatArray = np.ndarray


def grouped(X: FloatArray, count: int) -> list[FloatArray]:
    _, design = np.unique(X[:, :2], axis=0, return_inverse=True)
    label = np.random.default_rng(0).permutation(design.max() + 1) % count
    return [np.flatnonzero(label[design] == k) for k in range(count)]


def shuffled(X: FloatArray, count: int) -> list[FloatArray]:
    return np.array_split(np.random.default_rng(1).permutation(len(X)), count)


def check(model: Any, X: FloatArray, y: FloatArray, folds: list[FloatArray], **fixed: Any) -> None:
    for left_out in leave_folds_out(model, folds):
        rest = np.setdiff1d(np.arange(len(X)), left_out.rows)
        settings = model.get_params() | {
            "hyperparameters": model.hyperparameters_,
            "optimise": False,
        }
        refit = type(model)(**(settings | fixed)).fit(X[rest], y[rest])
        mean, sd = refit.predict(X[left_out.rows], return_std=True)
        np.testing.assert_allclose(left_out.mean, mean, rtol=0, atol=GP_CLOSED_FORM)
        np.testing.assert_allclose(left_out.sd, sd, rtol=0, atol=GP_CLOSED_FORM)


@pytest.mark.parametrize("split", [grouped, shuffled])
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("gp", {}),
        ("gp", {"solver": "dense"}),
        ("gp:shared-sigma", {}),
        ("gp_kronecker", {}),
        ("gp_kronecker", {"max_missing": -1, "resampling": "never"}),
    ],
)
def test_exact_gps(
    name: str, settings: dict[str, Any], split: Any, curves: tuple[FloatArray, FloatArray]
) -> None:
    X, y = curves
    y = y + 0.005 * np.random.default_rng(2).standard_normal(len(y))
    model = make(name, max_evaluations=10, **settings).fit(X, y)
    check(model, X, y, split(X, 5))


def test_grid_with_holes(curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    keep = np.sort(np.random.default_rng(7).permutation(len(X))[:-25])
    X, y = X[keep], y[keep]
    model = make("gp_kronecker", max_evaluations=10).fit(X, y)
    assert model.structure_ == "grid"
    check(model, X, y, grouped(X, 5))


def test_sparse_gp(curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    model = SparseVariationalGP(inducing=40, max_evaluations=10).fit(X, y)
    check(model, X, y, grouped(X, 4), inducing_points=model.inducing_points_)


def test_resampled_curves_leave_whole_designs_out(
    sheet_curves: tuple[FloatArray, FloatArray],
) -> None:
    X, y = sheet_curves
    model = make("gp_kronecker", max_evaluations=20).fit(X, y)
    assert model.structure_ == "resampled"
    folds = grouped(X, 6)
    left_out = leave_folds_out(model, folds)
    for one in left_out:
        # The refit chooses its own strain grid, so it differs by the cost of resampling.
        rest = np.setdiff1d(np.arange(len(X)), one.rows)
        refit = make("gp_kronecker", hyperparameters=model.hyperparameters_, optimise=False).fit(
            X[rest], y[rest]
        )
        np.testing.assert_allclose(one.mean, refit.predict(X[one.rows]), rtol=0, atol=5e-3)
    with pytest.raises(DataError) as caught:
        leave_folds_out(model, [np.array([0, 1])])
    assert caught.value.code == "leave-out-cuts-resampled-curve"


@pytest.mark.parametrize("fold", [[], [0, 0], [-1], [10**6], [0.5], list(range(225))], ids=str)
def test_bad_folds_are_refused(fold: list[Any], curves: tuple[FloatArray, FloatArray]) -> None:
    X, y = curves
    model = make("gp", max_evaluations=2).fit(X, y)
    with pytest.raises(UsageError) as caught:
        leave_folds_out(model, [fold])
    assert caught.value.code == "leave-out-bad-fold"


def test_other_models_are_refused(curves: tuple[FloatArray, FloatArray]) -> None:
    with pytest.raises(UsageError, match="Refit"):
        leave_folds_out(make("polynomial").fit(*curves), [[0]])
