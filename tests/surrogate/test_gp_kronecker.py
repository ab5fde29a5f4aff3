"""What the Kronecker GP decides by itself: warp, spread, where the search starts."""

from __future__ import annotations

import numpy as np
import pytest
from stand_in import FloatArray

from kiribench.errors import UsageError
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.leave_out import leave_folds_out
from kiribench.surrogate.registry import make

RATE_AT_END = 10.0


def steep_table(steep: bool) -> tuple[FloatArray, FloatArray]:
    """81 designs x 8 strains: waves over a and b, along b either even or ever faster."""
    levels = np.linspace(0.0, 1.0, 9)
    a, b, e = (x.ravel() for x in np.meshgrid(levels, levels, np.linspace(0, 1, 8), indexing="ij"))
    along = b + 0.5 * np.exp(RATE_AT_END * (b - 1.0)) if steep else b
    return np.column_stack([a, b, e]), np.sin(3 * a + 5 * along) * (1.0 + e)


@pytest.mark.parametrize("steep", [False, True])
def test_the_warp_is_what_left_out_designs_want(steep: bool) -> None:
    X, y = steep_table(steep)
    never, always, model = (
        KroneckerGP(max_evaluations=60, warp=warp).fit(X, y) for warp in ("never", "always", "auto")
    )
    label = np.random.default_rng(0).permutation(81) % 10  # as the model divides its designs
    folds = [np.flatnonzero(label[np.repeat(np.arange(81), 8)] == k) for k in range(10)]
    squared = [
        sum(np.sum((y[one.rows] - one.mean) ** 2) for one in leave_folds_out(fitted, folds))
        for fitted in (never, always)
    ]
    best = (never, always)[int(squared[1] < squared[0])]
    assert not never.hyperparameters_.warp
    assert always.hyperparameters_.warp
    assert model.hyperparameters_ == best.hyperparameters_
    if steep:
        assert best is always


def test_the_spread_makes_intervals_of_left_out_designs_hold_95_percent() -> None:
    rng = np.random.default_rng(3)
    X, y = steep_table(False)
    # Each design has an error of its own, and heavy tails: no noise that the model knows.
    y = y + np.repeat(0.02 * rng.standard_t(2, 81), 8)
    model = KroneckerGP(max_evaluations=60, warp="never", curve_noise=False).fit(X, y)
    plain = KroneckerGP(max_evaluations=60, warp="never", curve_noise=False, calibrate=False)
    plain.fit(X, y)
    spread = model.hyperparameters_.spread
    assert plain.hyperparameters_.spread == 1.0
    assert spread != pytest.approx(1.0, abs=0.05)
    mean, sd = model.predict(X[:9] + 0.01, return_std=True)
    plain_mean, plain_sd = plain.predict(X[:9] + 0.01, return_std=True)
    np.testing.assert_array_equal(mean, plain_mean)
    np.testing.assert_allclose(sd, spread * plain_sd, rtol=1e-12)
    new = rng.random((400, 3))
    new_y = np.sin(3 * new[:, 0] + 5 * new[:, 1]) * (1 + new[:, 2]) + 0.02 * rng.standard_t(2, 400)
    covered = [
        np.mean(np.abs(new_y - m) < 1.96 * s)
        for m, s in (one.predict(new, return_std=True) for one in (model, plain))
    ]
    assert abs(covered[0] - 0.95) < 0.03
    assert abs(covered[0] - 0.95) < abs(covered[1] - 0.95)


def test_an_error_of_each_design_is_learnt_and_not_believed_away() -> None:
    rng = np.random.default_rng(5)
    X, y = steep_table(False)
    y = y + np.repeat(0.05 * rng.standard_normal(81), 8) * (1.0 + X[:, 2])
    model = KroneckerGP(max_evaluations=60, warp="never", calibrate=False).fit(X, y)
    learnt = model.hyperparameters_
    common = np.sqrt(learnt.signal_variance * learnt.curve_noise) * learnt.target_scale
    assert common == pytest.approx(0.05 * 1.5, rel=0.3)  # the factor's mean over strain
    assert model.predict(X, return_std=True)[1].min() > 0.04


def test_predictions_are_smooth_at_training_designs() -> None:
    X, y = steep_table(False)
    y = y + np.repeat(0.05 * np.random.default_rng(5).standard_normal(81), 8)
    model = KroneckerGP(max_evaluations=40).fit(X, y)
    on, beside = X[100:101], X[100:101] + np.array([1e-7, 0.0, 0.0])
    assert model.predict(on)[0] == pytest.approx(model.predict(beside)[0], abs=1e-5)


def test_noise_is_not_all_that_is_found_in_many_inputs() -> None:
    """Ten inputs at the usual start are all far apart: the search ended in white noise."""
    rng = np.random.default_rng(0)
    X = rng.random((200, 10))
    y = X @ np.arange(10.0) + 0.5 * rng.standard_normal(200)
    for name in ("gp", "gp_kronecker", "svgp"):
        model = make(name, max_evaluations=60).fit(X[:150], y[:150])
        left = y[150:] - model.predict(X[150:])
        assert np.sqrt(np.mean(left**2)) < 0.3 * y.std(), name


def test_an_unknown_warp_is_refused() -> None:
    with pytest.raises(UsageError, match="warp"):
        KroneckerGP(warp="sometimes").fit(*steep_table(False))
