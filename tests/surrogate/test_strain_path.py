"""Strain along a design's path: found where ends are smooth, left alone where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from stand_in import FloatArray, stand_in_poisson, stand_in_table
from tolerances import GP_CLOSED_FORM

from kiribench.surrogate import exact_gp
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.leave_out import leave_folds_out
from kiribench.surrogate.strain_path import along, strain_path

LEVELS = 9


def pulled(last: FloatArray, first: FloatArray | float = 0.05) -> FloatArray:
    """(n, 3): 81 designs x 10 strains from the first to the last of each, (81,)."""
    X, _ = stand_in_table(LEVELS, np.linspace(0.0, 1.0, 10))
    design = np.repeat(np.arange(LEVELS**2), 10)
    start = np.broadcast_to(first, LEVELS**2)
    X[:, 2] = start[design] + (last - start)[design] * X[:, 2]
    return X


def cuts() -> tuple[FloatArray, FloatArray]:
    """(81,) a and b, fractions, of the designs of :func:`pulled`."""
    X, _ = stand_in_table(LEVELS, np.zeros(1))
    return X[:, 0] / 100, X[:, 1] / 100


def scaled(X: FloatArray) -> FloatArray:
    return np.asarray((X[:, :2] - 5.0) / 90.0)


def test_smooth_ends_become_0_and_1() -> None:
    a, b = cuts()
    X = pulled(0.7 + 0.1 * a**2 - 0.05 * a * b, 0.05 + 0.02 * b**3)
    path = strain_path(X)
    assert len(path) == 2
    fraction = np.tile(np.linspace(0.0, 1.0, 10), LEVELS**2)
    np.testing.assert_allclose(along(path, scaled(X), X[:, 2]), fraction, rtol=0, atol=1e-12)


def test_beyond_the_designs_the_nearest_path_is_taken() -> None:
    a, b = cuts()
    path = strain_path(pulled(0.7 + 0.1 * a**2 - 0.05 * a * b))
    inside, outside = np.array([[1.0, 0.4], [0.3, 0.0]]), np.array([[1.2, 0.4], [0.3, -0.1]])
    strain = np.array([0.3, 0.9])
    np.testing.assert_array_equal(along(path, inside, strain), along(path, outside, strain))


@pytest.mark.parametrize("case", ["random", "common", "few full"])
def test_no_path_where_ends_are_no_function_of_the_cuts(case: str) -> None:
    a, _ = cuts()
    rng = np.random.default_rng(0)
    ends = {"random": rng.uniform(0.4, 0.9, LEVELS**2), "common": np.full(LEVELS**2, 0.7)}
    X = pulled(ends.get(case, 0.7 + 0.1 * a))
    if case == "few full":
        steps = rng.integers(4, 11, LEVELS**2)
        X = X[np.tile(np.arange(10), LEVELS**2) < np.repeat(steps, 10)]
    assert strain_path(X) == ()


def test_designs_that_stopped_early_do_not_bend_the_path() -> None:
    a, _ = cuts()
    X = pulled(0.7 + 0.1 * a)
    stopped = np.repeat(np.arange(LEVELS**2) % 10 == 3, 10)
    early = X[~(stopped & (X[:, 2] > 0.4))]
    whole, cut = strain_path(X), strain_path(early)
    at = np.full(len(X), 0.5)
    np.testing.assert_allclose(
        along(cut, scaled(X), at), along(whole, scaled(X), at), rtol=0, atol=1e-12
    )


def test_what_lies_beyond_the_shortest_curve_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ends from 0.5 to 0.8: on a common grid most of the last rows are extrapolated."""
    a, b = cuts()
    X = pulled(0.5 + 0.25 * a + 0.05 * np.sin(2 * b))
    y = stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
    label = np.random.default_rng(1).permutation(LEVELS**2) % 9
    folds = [np.flatnonzero(label[np.repeat(np.arange(81), 10)] == k) for k in range(9)]
    rms, covered = {}, {}
    monkeypatch.setattr(exact_gp, "MOST_LOST", 1.0)  # else the rows themselves are taken
    for path in (True, False):
        model = KroneckerGP(max_evaluations=40, path=path).fit(X, y)
        assert bool(model.hyperparameters_.path) == path
        assert model.structure_ == "resampled"
        left = leave_folds_out(model, folds)
        error = np.concatenate([y[one.rows] - one.mean for one in left])
        sd = np.concatenate([one.sd for one in left])
        rms[path] = np.sqrt(np.mean(error**2))
        covered[path] = np.mean(np.abs(error) < 1.96 * sd)
    assert rms[True] < 0.5 * rms[False]
    assert 0.9 < covered[True] < 0.99


def test_closed_form_is_the_refit_on_the_same_paths() -> None:
    a, b = cuts()
    X = pulled(0.6 + 0.15 * a - 0.05 * a * b, 0.05 + 0.02 * a)  # exact: a grid along the paths
    y = stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
    model = KroneckerGP(max_evaluations=10).fit(X, y)
    assert model.structure_ == "grid"
    assert model.hyperparameters_.path
    fold = np.flatnonzero(np.isin(np.repeat(np.arange(81), 10), [3, 40, 77]))
    part = np.array([5, 100, 402])  # a fold that cuts through curves, too
    for rows in (fold, part):
        (left,) = leave_folds_out(model, [rows])
        rest = np.setdiff1d(np.arange(len(X)), rows)
        refit = KroneckerGP(hyperparameters=model.hyperparameters_, optimise=False)
        mean, sd = refit.fit(X[rest], y[rest]).predict(X[rows], return_std=True)
        np.testing.assert_allclose(left.mean, mean, rtol=0, atol=GP_CLOSED_FORM)
        np.testing.assert_allclose(left.sd, sd, rtol=0, atol=GP_CLOSED_FORM)


def test_designs_are_sought_on_the_same_mean() -> None:
    """At one strain such a mean is interpolated through the designs: off by next to nothing."""
    from kiribench.design.design_part import design_part

    a, b = cuts()
    X = pulled(0.6 + 0.15 * a - 0.05 * a * b, 0.05 + 0.02 * a)
    y = stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
    model = KroneckerGP(max_evaluations=20).fit(X, y)
    assert model.hyperparameters_.path
    rng = np.random.default_rng(4)
    percent, strain = rng.uniform(5.0, 95.0, (200, 2)), rng.uniform(0.07, 0.6, 200)
    part = design_part(model)
    found = part.jets(percent / 100.0, part.weights_at(strain), np.arange(200))[0]
    said, sd = model.predict(np.column_stack([percent, strain]), return_std=True)
    assert np.sqrt(np.mean((found - said) ** 2)) < 0.1 * np.sqrt(np.mean(sd**2))
    at_designs = part.jets(X[::10, :2] / 100.0, part.weights_at(np.full(81, 0.3)), np.arange(81))[0]
    there = model.predict(np.column_stack([X[::10, :2], np.full(81, 0.3)]))
    np.testing.assert_allclose(at_designs, there, rtol=0, atol=1e-7)


def test_hyperparameters_with_a_path_come_back_from_json() -> None:
    a, _ = cuts()
    X = pulled(0.6 + 0.15 * a)
    y = stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
    learnt = KroneckerGP(max_evaluations=3).fit(X, y).hyperparameters_
    assert Hyperparameters.from_dict(learnt.as_dict()) == learnt
    plain = X.copy()
    fraction = np.tile(np.linspace(0, 1, 10), 81)
    np.testing.assert_allclose(learnt.along_path(X)[:, 2], fraction, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(X, plain)
