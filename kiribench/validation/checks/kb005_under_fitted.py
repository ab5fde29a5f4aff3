"""KB005: a baseline that does not even fit its training rows."""

from __future__ import annotations

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

TRAIN_R2 = 0.95
GAP = 0.02


def look(evidence: Evidence) -> Found:
    """Fires where R2 on training rows is below .95 and far below what another model reaches."""
    models = evidence.summaries.get("grouped", {})
    train = {
        name: one.scores["train_r2"].mean
        for name, one in models.items()
        if one.scores["train_r2"].mean is not None
    }
    test = [
        one.scores["r2"].pooled for one in models.values() if one.scores["r2"].pooled is not None
    ]
    if not train or not test:
        return not_applicable("The grouped protocol gave no scores on training rows.")
    best = max(test)
    poor = {
        name: value
        for name, value in train.items()
        if value is not None and value < TRAIN_R2 and value < best - GAP
    }
    if not poor:
        return passed("Every model fits its training rows, or none does better on test rows.")
    listed = ", ".join(f"{name} ({value:.3f})" for name, value in sorted(poor.items()))
    return fired(
        f"R2 on their own training rows: {listed}; another model reaches {best:.3f} on rows that "
        "it has not seen. Beating these says nothing about a model, only about their settings."
    )


CHECK = Check(
    "KB005",
    "Under-fitted baseline",
    "warning",
    "Give the baseline settings that can fit (deeper trees, more of them), or tune it "
    "(NAME:tuned).",
    look,
)
