"""KB003: an input that holds the target."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, passed

SAME = 1e-6  # of the target's range
RANK = 0.9999
FEWEST_VALUES = 10


def look(evidence: Evidence) -> Found:
    """Fires where one input, or a ratio, product, sum or difference of two, is the target."""
    from scipy.stats import spearmanr

    table = evidence.table
    y = table.y
    if len(np.unique(y)) < FEWEST_VALUES:
        return passed("The target has too few values for an input to give it away.")
    for column, name in enumerate(table.features):
        x = table.X[:, column]
        if len(np.unique(x)) >= FEWEST_VALUES and abs(float(spearmanr(x, y).statistic)) > RANK:
            return fired(f"The input {name} orders the rows exactly as the target does.")
    for i, j in combinations(range(table.X.shape[1]), 2):
        for words, values in _pairs(table.X[:, i], table.X[:, j]):
            if np.isfinite(values).all() and _is_affine(values, y):
                said = words.format(table.features[i], table.features[j])
                return fired(f"The target is {said}, but for a factor and a constant.")
    return passed("No input, and no simple combination of two, is the target.")


def _pairs(a: np.ndarray, b: np.ndarray) -> list[tuple[str, np.ndarray]]:
    with np.errstate(divide="ignore", invalid="ignore"):
        return [
            ("{0} / {1}", a / b),
            ("{1} / {0}", b / a),
            ("{0} x {1}", a * b),
            ("{0} + {1}", a + b),
            ("{0} - {1}", a - b),
        ]


def _is_affine(values: np.ndarray, y: np.ndarray) -> bool:
    if np.ptp(values) == 0.0:
        return False
    slope, offset = np.polyfit(values, y, 1)
    return bool(np.max(np.abs(slope * values + offset - y)) < SAME * np.ptp(y))


CHECK = Check(
    "KB003",
    "An input holds the target",
    "error",
    "Leave that column out of --features.",
    look,
)
