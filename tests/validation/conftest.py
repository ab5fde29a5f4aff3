"""Small tables for the cross-validation."""

from __future__ import annotations

import numpy as np
import pytest
from stand_in import stand_in_poisson

from kiribench.validation.table import DESIGN_FEATURES, CvTable


def table_of(levels: int = 6, strains: int = 9, noise: float = 0.0) -> CvTable:
    """The stand-in on levels x levels designs from 5 to 95 %, in random row order of designs."""
    percent = np.linspace(5.0, 95.0, levels)
    a, b, e = (
        x.ravel()
        for x in np.meshgrid(percent, percent, np.linspace(0.05, 0.75, strains), indexing="ij")
    )
    y = stand_in_poisson(a / 100, b / 100, e)
    y = y + noise * np.random.default_rng(0).standard_normal(len(y))
    group = np.repeat(np.arange(levels * levels), strains)
    return CvTable(
        X=np.column_stack([a, b, e]),
        y=y,
        features=DESIGN_FEATURES,
        target="poisson_ratio",
        group=group,
        group_names=tuple(f"d{k}" for k in range(levels * levels)),
        group_word="design",
        mesh_error=np.full(len(y), 0.01),
        measure="log",
    )


@pytest.fixture(scope="session")
def table() -> CvTable:
    return table_of()
