"""Folds of whole groups: the honest headline, repeated."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable, IntArray


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """Each repeat deals the shuffled groups to the folds in turn, so their counts differ by one.

    Where groups differ in size the largest are dealt first, among equals by chance.
    """
    result: list[Fold] = []
    count = min(settings.folds, table.groups)
    for repeat in range(settings.repeats):
        label = deal(
            table.group, table.groups, count, np.random.default_rng([settings.seed, repeat])
        )
        result += folds_of_labels(label, repeat=repeat)
    return tuple(result)


def deal(group: IntArray, groups: int, folds: int, rng: np.random.Generator) -> IntArray:
    """The fold of each row, (n,), groups kept whole.

    Args:
        group: (n,) group of each row, 0 to ``groups`` - 1.
        groups: their number.
        folds: how many.
        rng: the chance.
    """
    size = np.bincount(group, minlength=groups)
    order = rng.permutation(groups)
    if size.max() == size.min():
        fold_of_group = np.empty(groups, dtype=np.int64)
        fold_of_group[order] = np.arange(groups) % folds
        return fold_of_group[group]
    order = order[np.argsort(-size[order], kind="stable")]
    fold_of_group = np.zeros(groups, dtype=np.int64)
    rows = np.zeros(folds)
    for one in order:  # the emptiest fold takes the next group
        fold_of_group[one] = int(np.argmin(rows))
        rows[fold_of_group[one]] += size[one]
    return fold_of_group[group]
