"""Radial basis functions where scipy's polynomial is singular."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from kiribench.surrogate.rbf import RadialBasis

FloatArray = np.ndarray


def binary_table(rows: int = 300) -> tuple[FloatArray, FloatArray]:
    """Two smooth inputs and one of two values whose effect is larger than theirs."""
    rng = np.random.default_rng(4)
    X = np.column_stack([rng.random((rows, 2)), np.arange(rows) % 2])
    X[:, 2] *= 50.0  # far apart: near neighbours all have the same value
    X[:, :2] *= 0.01
    return X, np.sin(300 * X[:, 0]) + X[:, 1] * 100 + X[:, 2] / 25


def test_neighbours_of_one_value_make_all_rows_take_part() -> None:
    X, y = binary_table()
    unit = (X - X.min(0)) / np.ptp(X, axis=0)
    with pytest.raises(np.linalg.LinAlgError):
        RBFInterpolator(unit[:200], y[:200], kernel="cubic", neighbors=20)(unit[200:])
    model = RadialBasis(neighbors=20).fit(X[:200], y[:200])
    left = model.predict(X[200:]) - y[200:]
    assert model.solved_by_ == "all rows"
    assert np.sqrt(np.mean(left**2)) < 0.05 * y.std()


def test_neighbours_of_one_value_among_too_many_rows_get_the_linear_kernel() -> None:
    X, y = binary_table()
    model = RadialBasis(neighbors=20, max_rows=100).fit(X[:200], y[:200])
    left = model.predict(X[200:]) - y[200:]
    assert model.solved_by_ == "linear kernel"
    assert np.sqrt(np.mean(left**2)) < 0.2 * y.std()


def test_ordinary_tables_are_scipys_neighbours() -> None:
    X, y = binary_table()
    X, y = X[:, :2], np.sin(300 * X[:, 0])
    model = RadialBasis(neighbors=30, smoothing=0.0).fit(X[:200], y[:200])
    unit = (X - X[:200].min(0)) / np.ptp(X[:200], axis=0)
    peer = RBFInterpolator(unit[:200], y[:200], kernel="cubic", neighbors=30)
    np.testing.assert_allclose(model.predict(X[200:]), peer(unit[200:]), atol=1e-9)
    assert model.solved_by_ == "neighbours"
