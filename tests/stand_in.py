"""A closed-form stand-in for the design space: smooth, rotating-squares-like, no simulation."""

from __future__ import annotations

import numpy as np

FloatArray = np.ndarray


def stand_in_poisson(a: FloatArray, b: FloatArray, strain: FloatArray) -> FloatArray:
    """A made-up Poisson's ratio: -1 for long cuts and small strain, +0.5 without cuts.

    It has the design space's looks (auxetic at first, rising with strain, steep towards
    full cuts) and none of its mechanics. a, b are fractions, strain is a log strain.
    """
    openness = (a * b) ** 1.5
    limit = 0.02 + 0.4 * openness * (1.0 + 0.3 * (a - b))
    turned = 1.0 / (1.0 + (strain / limit) ** 2)
    return 0.5 - 1.5 * openness * (0.25 + 0.75 * turned) - 0.2 * b * (1.0 - a) * turned


def stand_in_table(levels: int, strains: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3) rows a_percent, b_percent, strain and (n,) targets on a full lattice."""
    percent = np.linspace(5.0, 95.0, levels)
    a, b, e = np.meshgrid(percent, percent, strains, indexing="ij")
    X = np.column_stack([a.ravel(), b.ravel(), e.ravel()])
    return X, stand_in_poisson(X[:, 0] / 100, X[:, 1] / 100, X[:, 2])
