"""Leave one level of a or of b out: a whole line of the design lattice, ends included."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds_a(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """One fold a value of a; the first and the last extrapolate."""
    return _folds(table, 0, "a")


def folds_b(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """One fold a value of b; the first and the last extrapolate."""
    return _folds(table, 1, "b")


def _folds(table: CvTable, column: int, name: str) -> tuple[Fold, ...]:
    levels, label = np.unique(table.X[:, column], return_inverse=True)
    names = tuple(f"{name} = {level:g} %" for level in levels)
    return folds_of_labels(label.ravel().astype(np.int64), names=names)
