"""One row a design: the other way to read "10 folds using the 441 samples"."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """A random row of each design, and these rows in shuffled folds; all others are not used."""
    rng = np.random.default_rng([settings.seed, 3000])
    order = rng.permutation(len(table.y))
    _, first = np.unique(table.group[order], return_index=True)
    chosen = rng.permutation(np.sort(order[first]))
    count = min(settings.folds, len(chosen))
    label = np.arange(len(chosen)) % count
    return tuple(
        Fold(
            0,
            index,
            f"fold {index + 1}",
            np.sort(chosen[label != index]).astype(np.int64),
            np.sort(chosen[label == index]).astype(np.int64),
        )
        for index in range(count)
    )
