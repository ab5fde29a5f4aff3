"""Tables of the closed-form stand-in (tests/stand_in.py) for the surrogates."""

from __future__ import annotations

import numpy as np
import pytest
from stand_in import FloatArray, stand_in_poisson, stand_in_table


@pytest.fixture(scope="session")
def curves() -> tuple[FloatArray, FloatArray]:
    """25 designs x 9 common strains."""
    return stand_in_table(5, np.linspace(0.05, 0.75, 9))


@pytest.fixture(scope="session")
def sheet_curves() -> tuple[FloatArray, FloatArray]:
    """36 designs with 12 strains of their own each, as a sheet pulled by displacement gives."""
    X, _ = stand_in_table(6, np.linspace(0.05, 0.75, 12))
    stretchier = 1.0 + 0.06 * (X[:, 0] / 100) ** 1.2 * (1.0 - 0.5 * X[:, 1] / 100)
    X = X.copy()
    X[:, 2] *= stretchier
    return X, stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
