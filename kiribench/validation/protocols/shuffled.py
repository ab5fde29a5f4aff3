"""Shuffled rows, whatever they belong to: leaky where rows come in groups."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """Rows dealt to the folds by chance; a design's neighbouring strains are on both sides."""
    rows = len(table.y)
    label = np.empty(rows, dtype=np.int64)
    order = np.random.default_rng([settings.seed, 2000]).permutation(rows)
    label[order] = np.arange(rows) % min(settings.folds, rows)
    return folds_of_labels(label)
