"""Curves of many lengths: no common grid holds them, so the process takes the rows themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from stand_in import FloatArray, stand_in_poisson, stand_in_table
from tolerances import GP_CLOSED_FORM

from kiribench.errors import DataError
from kiribench.schema.design_space import DesignSpace
from kiribench.surrogate import exact_gp, fit_table, load, save
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.grid import resample, thinned
from kiribench.surrogate.leave_out import leave_folds_out

DESIGNS, STEPS = 49, 12
DESIGN = np.repeat(np.arange(DESIGNS), STEPS)


def table() -> tuple[FloatArray, FloatArray]:
    """49 designs, each with 12 strains that end anywhere between 0.3 and 0.8."""
    X, _ = stand_in_table(7, np.linspace(0.0, 1.0, STEPS))
    X[:, 2] = 0.05 + X[:, 2] * np.random.default_rng(0).uniform(0.25, 0.75, DESIGNS)[DESIGN]
    return X, stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])


def folds() -> list[FloatArray]:
    label = np.random.default_rng(1).permutation(DESIGNS) % 7
    return [np.flatnonzero(label[DESIGN] == k) for k in range(7)]


def left_out_rms(model: KroneckerGP, y: FloatArray) -> float:
    left = leave_folds_out(model, folds())
    return float(np.sqrt(np.mean(np.concatenate([y[one.rows] - one.mean for one in left]) ** 2)))


def test_the_longest_curves_are_not_cut_to_the_shortest(monkeypatch: pytest.MonkeyPatch) -> None:
    X, y = table()
    assert resample(X, y).lost > 0.2
    model = KroneckerGP(max_evaluations=30).fit(X, y)
    assert model.structure_ == "dense"
    assert model.hyperparameters_.path == ()
    monkeypatch.setattr(exact_gp, "MOST_LOST", 1.0)
    cut = KroneckerGP(max_evaluations=30).fit(X, y)
    assert cut.structure_ == "resampled"
    assert left_out_rms(model, y) < 0.5 * left_out_rms(cut, y)


@pytest.mark.parametrize("most", [4000, 300])
def test_closed_form_is_the_refit(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact_gp, "MOST_CONDITIONED", most)
    X, y = table()
    model = KroneckerGP(max_evaluations=10).fit(X, y)
    assert len(model._state.kept) == (len(X) if most > len(X) else 6 * DESIGNS)
    fold = folds()[0]
    (left,) = leave_folds_out(model, [fold])
    rest = np.setdiff1d(np.arange(len(X)), fold)
    # As many rows a curve as in the whole table.
    monkeypatch.setattr(exact_gp, "MOST_CONDITIONED", most * 42 // 49)
    refit = KroneckerGP(hyperparameters=model.hyperparameters_, optimise=False)
    mean, sd = refit.fit(X[rest], y[rest]).predict(X[fold], return_std=True)
    np.testing.assert_allclose(left.mean, mean, rtol=0, atol=GP_CLOSED_FORM)
    np.testing.assert_allclose(left.sd, sd, rtol=0, atol=GP_CLOSED_FORM)
    if most < len(X):
        with pytest.raises(DataError) as caught:
            leave_folds_out(model, [np.array([0, 1])])
        assert caught.value.code == "leave-out-cuts-resampled-curve"


def test_thinned_rows_come_back_from_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exact_gp, "MOST_CONDITIONED", 300)
    X, y = table()
    space = DesignSpace(
        file=Path(__file__),
        a_percent=X[:, 0],
        b_percent=X[:, 1],
        longitudinal_strain=X[:, 2],
        poisson_ratio=y,
        design=DESIGN,
        design_names=tuple(map(str, range(DESIGNS))),
        measure="log",
    )
    kept = fit_table(space, "gp_kronecker", max_evaluations=5)
    save(kept, tmp_path / "m.safetensors")
    again = load(tmp_path / "m.safetensors")
    points = (np.linspace(5, 95, 7), 30.0, 0.2)
    np.testing.assert_allclose(
        kept.predict(*points).mean, again.predict(*points).mean, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(kept.predict(*points).sd, again.predict(*points).sd, rtol=1e-6)


def test_thinning_keeps_the_ends_and_a_fair_share_of_each_curve() -> None:
    X, _ = table()
    shuffled = np.random.default_rng(2).permutation(len(X))
    kept = thinned(X[shuffled], 300)
    assert (np.diff(kept) > 0).all()
    for design in range(DESIGNS):
        whole = X[design == DESIGN, 2]
        own = X[shuffled][kept][design == DESIGN[shuffled][kept], 2]
        assert len(own) == 6
        assert own.min() == whole.min()
        assert own.max() == whole.max()
    np.testing.assert_array_equal(thinned(X, len(X)), np.arange(len(X)))
