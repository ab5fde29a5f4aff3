"""Leave one rectangle of the (a, b) square out: a hole in the design space."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable

SIDE = 3  # blocks along a and along b


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """Nine blocks: the levels of a and of b are each cut into thirds of equal count."""
    parts, bounds = [], []
    for column in (0, 1):
        levels, rank = np.unique(table.X[:, column], return_inverse=True)
        part = rank.ravel() * SIDE // len(levels)
        parts.append(part)
        of_level = np.arange(len(levels)) * SIDE // len(levels)
        bounds.append([levels[of_level == k] for k in range(SIDE)])
    names = tuple(
        f"a {_span(bounds[0][i])}, b {_span(bounds[1][j])} %"
        for i in range(SIDE)
        for j in range(SIDE)
    )
    return folds_of_labels((parts[0] * SIDE + parts[1]).astype(np.int64), names=names)


def _span(levels: np.ndarray) -> str:
    return f"{levels.min():g} to {levels.max():g}" if len(levels) else "none"
