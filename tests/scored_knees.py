"""The committed synthetic subjects, measured and scored once a test session."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from kiribench.dataset import Dataset
from kiribench.regression.suite import Fresh, compute

SYNTHETIC = Path(__file__).parents[1] / "data" / "synthetic"


@cache
def scored_knee(label: str) -> Fresh:
    """S1, S2 or S3 with the default options."""
    return compute(Dataset.open(SYNTHETIC).subject(label))
