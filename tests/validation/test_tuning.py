"""Nested tuning: what is chosen never sees the test rows."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.validation import tuning
from kiribench.validation.run import cross_validate
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable
from kiribench.validation.tuning import fit_tuned, grid_of


def test_the_choice_is_the_best_of_the_inner_folds() -> None:
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, size=(200, 1))
    y = X[:, 0] ** 2 - X[:, 0] ** 3
    tuned = fit_tuned("polynomial", X, y, np.arange(200), seed=0, device="cpu")
    assert tuned.settings == {"degree": 3} or tuned.inner_rmse < 1e-12
    assert tuned.model.predict(X) == pytest.approx(y, abs=1e-10)


def test_inner_folds_keep_groups_whole_and_never_see_the_test_rows(
    table: CvTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[set[tuple[float, ...]]] = []
    real = tuning.make

    class Spy:
        def __init__(self, inner):
            self.inner = inner

        def fit(self, X, y):
            seen.append({tuple(row) for row in X})
            self.inner.fit(X, y)
            return self

        def predict(self, X):
            design = {tuple(row[:2]) for row in X}
            assert not design & {row[:2] for row in seen[-1]} or len(X) > 200
            return self.inner.predict(X)

    monkeypatch.setattr(tuning, "make", lambda *a, **k: Spy(real(*a, **k)))
    train = np.flatnonzero(table.group % 4 != 0)
    test = {tuple(row) for row in table.X[table.group % 4 == 0]}
    fit_tuned(
        "polynomial", table.X[train], table.y[train], table.group[train], seed=0, device="cpu"
    )
    assert len(seen) == 4 * len(grid_of("polynomial")) + 1
    assert not any(rows & test for rows in seen)


def test_tuned_models_take_part(table: CvTable) -> None:
    settings = CvSettings(
        models=("polynomial", "polynomial:tuned"), protocols=("grouped",), folds=4
    )
    models = cross_validate(table, settings).summaries["grouped"]
    assert models["polynomial:tuned"].notes["chosen"]["degree"] > 3
    cubic, tuned = (models[name].scores["rmse"].pooled for name in settings.models)
    assert tuned < cubic
