"""Strain measures as functions of a stretch."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.errors import UsageError
from kiribench.strain.measures import strain_of, strain_rate_of


def test_known_values() -> None:
    stretch = np.array([0.5, 1.0, 1.25])
    np.testing.assert_allclose(strain_of(stretch, "engineering"), [-0.5, 0.0, 0.25])
    np.testing.assert_allclose(strain_of(stretch, "green"), [-0.375, 0.0, 0.28125])
    np.testing.assert_allclose(strain_of(stretch, "log"), np.log(stretch))


@pytest.mark.parametrize("measure", ["engineering", "log", "green"])
def test_rate_is_the_derivative(measure: str) -> None:
    stretch = np.linspace(0.5, 2.0, 7)
    slope = (strain_of(stretch + 1e-6, measure) - strain_of(stretch - 1e-6, measure)) / 2e-6
    np.testing.assert_allclose(strain_rate_of(stretch, measure), slope, rtol=1e-8)


def test_unknown_measure_names_the_known_ones() -> None:
    with pytest.raises(UsageError, match="log, engineering, green"):
        strain_of(np.ones(1), "true")
