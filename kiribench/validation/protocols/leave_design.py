"""Leave one design (or group) out."""

from __future__ import annotations

from kiribench.validation.fold import Fold, folds_of_labels
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable


def folds(table: CvTable, settings: CvSettings) -> tuple[Fold, ...]:
    """One fold a group."""
    return folds_of_labels(table.group, names=table.group_names)
