"""KB002: unshuffled folds of a sorted table."""

from __future__ import annotations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

SORTED_RHO = 0.9
CONTIGUOUS_SHARE = 0.95
PROTOCOLS = ("contiguous", "own-folds")


def look(evidence: Evidence) -> Found:
    """Fires where folds are stretches of a table whose order follows an input."""
    names = [name for name in PROTOCOLS if name in evidence.folds]
    stretches = [
        name
        for name in names
        if np.mean([_is_stretch(fold.test) for fold in evidence.folds[name]]) >= CONTIGUOUS_SHARE
    ]
    if not names:
        return not_applicable("No protocol that follows the table's order was run.")
    if not stretches:
        return passed("No protocol tests on stretches of the table.")
    table = evidence.table
    order = np.arange(len(table.y), dtype=np.float64)
    tied = {
        feature: abs(_correlation(table.X[:, column], order))
        for column, feature in enumerate(table.features)
    }
    name, strongest = max(tied.items(), key=lambda item: item[1])
    listed = ", ".join(stretches)
    if strongest < SORTED_RHO:
        return passed(
            f"Folds of {listed} are stretches, but the table follows none of its inputs "
            f"(largest rank correlation {strongest:.2f}, {name})."
        )
    return fired(
        f"Folds of {listed} are stretches of a table sorted by {name} (rank correlation "
        f"{strongest:.2f}): each fold tests values of {name} that it has not trained on.",
        "error" if "own-folds" in stretches else "note",
    )


def _is_stretch(test: np.ndarray) -> bool:
    return bool(len(test) > 1 and test[-1] - test[0] + 1 == len(test))


def _correlation(values: np.ndarray, order: np.ndarray) -> float:
    from scipy.stats import spearmanr

    if np.ptp(values) == 0.0:
        return 0.0
    return float(spearmanr(values, order).statistic)


CHECK = Check(
    "KB002",
    "Unshuffled folds of a sorted table",
    "warning",
    "Shuffle whole designs (the grouped protocol), or ask for extrapolation by name.",
    look,
)
