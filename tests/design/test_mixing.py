"""Targets read in the wrong strain measure: the response is the true one of the other measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_toys import drawn_problem, surrogates
from tolerances import DIFFERENCE_SLOPE

from kiribench.design.cells import cells_of
from kiribench.design.limits import Limits
from kiribench.design.mixing import MISTAKEN, misread, mixed_up
from kiribench.design.options import DesignOptions
from kiribench.design.surrogates import Surrogates
from kiribench.strain.measures import strain_of

STRETCH_OF = {
    "log": np.exp,
    "engineering": lambda e: 1 + e,
    "green": lambda e: np.sqrt(1 + 2 * e),
}


@pytest.mark.parametrize("measure", list(MISTAKEN))
def test_the_other_measures_ratio_with_its_derivatives(measure: str) -> None:
    # The same model, said to be in another measure: the conversion must follow what is said.
    models = Surrogates(replace(surrogates().poisson, measure=measure))
    asked = replace(drawn_problem(1)[0], strain_measure=measure)
    cells = cells_of(asked, models, Limits(0.1, 0.0, 95.0), DesignOptions())
    other = MISTAKEN[measure]
    response = misread(cells, other)
    number = asked.longitudinal_strain.ravel()
    stretch = STRETCH_OF[other](number)
    own = strain_of(stretch, measure)
    inside = own <= models.poisson.high[2]
    points = np.random.default_rng(0).uniform(0.1, 0.8, (20, 2))
    nu = models.poisson.predict(100 * points[:, 0], 100 * points[:, 1], own).mean
    lateral = STRETCH_OF[measure](-nu * own)
    expected = -strain_of(lateral, other) / number
    at = response.jet(points)
    np.testing.assert_allclose(at.value[inside], expected[inside], atol=1e-9)
    step = 1e-4
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead, behind = response.jet(points + shift), response.jet(points - shift)
        for numeric, exact in (
            ((ahead.value - behind.value) / (2 * step), at.slope[:, axis]),
            ((ahead.slope - behind.slope) / (2 * step), at.curvature[:, axis]),
        ):
            assert np.abs(numeric - exact).max() < 10 * DIFFERENCE_SLOPE * np.abs(exact).max()
    ticks = np.array([0.2, 0.6])
    grid = response.on_grid(ticks, ticks)
    np.testing.assert_allclose(
        grid[3, 0, 1], response.jet(np.array([[0.2, 0.6]]), np.array([3])).value[0], atol=1e-12
    )


def test_mixing_costs_accuracy_and_the_right_way_does_not() -> None:
    asked, _ = drawn_problem(2)
    cells = cells_of(asked, surrogates(), Limits(0.1, 0.0, 95.0), DesignOptions())
    mixed = mixed_up(cells)
    assert mixed.read_as == "engineering"
    assert np.abs(mixed.right_error).max() <= 0.005 + 1e-9
    assert np.sqrt(np.mean(mixed.error**2)) > 2 * np.sqrt(np.mean(mixed.right_error**2))
