"""The edge of the design space: the longest cuts, predicted from all shorter ones."""

from __future__ import annotations

import numpy as np

from kiribench.validation.fold import Fold, complement
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable

FROM_PERCENT = 95.0


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """One fold: every design with a or b of at least 95 %; none where there is no such design."""
    outer = (table.X[:, :2] >= FROM_PERCENT).any(axis=1)
    if not outer.any() or outer.all():
        return ()
    test = np.flatnonzero(outer).astype(np.int64)
    label = f"a or b >= {FROM_PERCENT:g} %"
    return (Fold(0, 0, label, complement(test, len(table.y)), test),)
