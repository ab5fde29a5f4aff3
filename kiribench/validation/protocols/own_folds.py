"""The user's own folds, from a column of the table."""

from __future__ import annotations

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """One fold a value of the column; none where the table has no such column."""
    if table.own_fold is None:
        return ()
    return folds_of_labels(table.own_fold, names=table.fold_names)
