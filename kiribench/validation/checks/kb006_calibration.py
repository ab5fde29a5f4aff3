"""KB006: stated uncertainty that does not hold."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

LOW, HIGH = 0.93, 0.97
STANDARD_ERRORS = 2.0


def look(evidence: Evidence) -> Found:
    """Fires where the 95 % interval covers less than 93 or more than 97 % under grouped folds.

    Chance is allowed for by the groups: the standard error of the coverage is that of the
    groups' own coverages, two of which the excess must exceed.
    """
    models = evidence.summaries.get("grouped", {})
    table = evidence.table
    bad: list[str] = []
    good: list[str] = []
    for name, one in models.items():
        if one.sd is None or not len(one.rows):
            continue
        inside = np.abs(table.y[one.rows] - one.mean) <= norm.ppf(0.975) * one.sd
        coverage = float(inside.mean())
        group = table.group[one.rows]
        counts = np.bincount(group, minlength=table.groups)
        hits = np.bincount(group, weights=inside, minlength=table.groups)
        share = hits[counts > 0] / counts[counts > 0]
        error = float(share.std(ddof=1) / np.sqrt(len(share))) if len(share) > 1 else 1.0
        beyond = max(LOW - coverage, coverage - HIGH)
        said = f"{name} {100 * coverage:.1f} %"
        (bad if beyond > STANDARD_ERRORS * error else good).append(said)
    if not bad and not good:
        return not_applicable("No model with uncertainty was run under the grouped protocol.")
    if not bad:
        return passed(f"95 % intervals cover: {', '.join(good)}.")
    return fired(f"95 % intervals cover {', '.join(bad)} of the test rows, beyond chance.")


CHECK = Check(
    "KB006",
    "Mis-calibrated uncertainty",
    "warning",
    "Do not use these intervals for decisions; see the calibration curve, and prefer a model "
    "with a better CRPS and coverage.",
    look,
)
