"""KB001: rows of one design in train and test."""

from __future__ import annotations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

LABELLED_LEAKY = ("shuffled", "contiguous")


def look(evidence: Evidence) -> Found:
    """Fires where a protocol trains on rows of a group that it tests; worse if unlabelled."""
    table = evidence.table
    if table.group_word == "row":
        return not_applicable("No groups were declared: each row stands for itself.")
    split: dict[str, int] = {}
    for name, folds in evidence.folds.items():
        worst = max(
            len(np.intersect1d(table.group[fold.train], table.group[fold.test])) for fold in folds
        )
        if worst:
            split[name] = worst
    if not split:
        return passed(f"No {table.group_word} is in train and test of one fold.")
    listed = ", ".join(f"{name} (up to {count} in a fold)" for name, count in split.items())
    only_labelled = set(split) <= set(LABELLED_LEAKY)
    words = (
        "These are labelled leaky and are no headline."
        if only_labelled
        else "Scores of the folds that are not labelled leaky are too good as well."
    )
    return fired(
        f"{table.group_word.capitalize()}s on both sides under: {listed}. {words}",
        "note" if only_labelled else "error",
    )


CHECK = Check(
    "KB001",
    "Rows of one design in train and test",
    "error",
    "Quote the grouped protocol; give own folds that keep each design whole.",
    look,
)
