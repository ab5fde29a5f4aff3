"""How the error falls with the number of designs (or groups) that were simulated."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable, IntArray

SHARES = (0.05, 0.1, 0.2, 0.4, 0.8)  # of all groups
TEST_SHARE = 0.2
DRAWS = 3
LEAST_GROUPS = 5


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """Three draws; each tests on a fifth of the groups, and trains on nested parts of the rest."""
    result: list[Fold] = []
    held = max(1, round(TEST_SHARE * table.groups))
    sizes = sorted({min(round(share * table.groups), table.groups - held) for share in SHARES})
    for draw in range(DRAWS):
        order = np.random.default_rng([settings.seed, 1000 + draw]).permutation(table.groups)
        test = _rows(table, order[:held])
        for index, size in enumerate(size for size in sizes if size >= LEAST_GROUPS):
            train = _rows(table, order[held : held + size])
            label = f"{size} {table.group_word}s"
            result.append(Fold(draw, index, label, train, test, size))
    return tuple(result)


def _rows(table: CvTable, groups: IntArray) -> IntArray:
    return np.flatnonzero(np.isin(table.group, groups)).astype(np.int64)
