"""KB004: too few designs to say anything."""

from __future__ import annotations

from kiribench.validation.checks.check import Check, Evidence, Found, fired, passed

LEAST = 50
LEAST_IN_A_FOLD = 5


def look(evidence: Evidence) -> Found:
    """Fires below 50 groups, or where a headline fold tests on fewer than 5."""
    import numpy as np

    table = evidence.table
    headline = evidence.folds.get("grouped", ())
    fewest = min((len(np.unique(table.group[fold.test])) for fold in headline), default=None)
    word = table.group_word
    said = f"{table.groups} {word}s"
    if fewest is not None:
        said += f", {fewest} in the smallest test fold"
    if table.groups < LEAST or (fewest is not None and fewest < LEAST_IN_A_FOLD):
        return fired(
            f"{said}; below {LEAST} {word}s, or {LEAST_IN_A_FOLD} a fold, the spread over folds "
            "is mostly chance."
        )
    return passed(f"{said}.")


CHECK = Check(
    "KB004",
    "Too few designs",
    "warning",
    "Simulate more designs, or use fewer folds and more repeats.",
    look,
)
