"""Contiguous unshuffled folds: what ``KFold`` does where nobody asks for shuffling."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """The table's rows in its order, cut into equal stretches: strips along a in a sorted table."""
    rows = len(table.y)
    count = min(settings.folds, rows)
    return folds_of_labels(np.arange(rows, dtype=np.int64) * count // rows)
