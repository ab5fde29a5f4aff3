"""What the law changes in a cut cell: against the cell's own simulation and exact scalings."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import SAME_DISCRETE_MODEL

from kiribench.calibration.consequences import pull_cell
from kiribench.fem.cell import simulate_cell
from kiribench.fem.material import NeoHookean, Ogden

STRETCHES = (1.1, 1.3)


def test_it_is_the_simulated_cell() -> None:
    path = simulate_cell(0.9, 0.9, STRETCHES, material=Ogden(0.112, 3.29), estimate_error=False)
    found = pull_cell(0.9, 0.9, Ogden(0.112, 3.29), STRETCHES)
    np.testing.assert_allclose(found.poisson, path.poisson(), rtol=SAME_DISCRETE_MODEL)
    np.testing.assert_allclose(found.stress_mpa, path.nominal_stress_mpa, rtol=SAME_DISCRETE_MODEL)


def test_the_modulus_scales_every_stress_and_leaves_poissons_ratio() -> None:
    soft, stiff = (pull_cell(0.35, 0.85, NeoHookean(mu), STRETCHES) for mu in (0.1, 0.25))
    np.testing.assert_allclose(stiff.poisson, soft.poisson, rtol=0, atol=1e-8)
    np.testing.assert_allclose(stiff.stress_mpa / soft.stress_mpa, 2.5, rtol=1e-7)
    np.testing.assert_allclose(stiff.tip_stress_mpa / soft.tip_stress_mpa, 2.5, rtol=1e-7)
    np.testing.assert_allclose(stiff.tip_stretch, soft.tip_stretch, rtol=1e-8)


def test_the_exponent_changes_poissons_ratio_too() -> None:
    """Not only forces: said in the docs with its size."""
    one = pull_cell(0.35, 0.85, NeoHookean(0.207), (1.2, 1.5))
    two = pull_cell(0.35, 0.85, Ogden(0.112, 3.29), (1.2, 1.5))
    change = np.abs(two.poisson - one.poisson)
    assert 0.02 < change[0] < 0.04
    assert 0.04 < change[1] < 0.06


def test_tips_are_hotter_than_the_sheet_and_uncut_cells_have_none() -> None:
    found = pull_cell(0.5, 0.5, NeoHookean(0.2), STRETCHES)
    assert (found.tip_stress_mpa > 2 * found.stress_mpa).all()
    uncut = pull_cell(0.0, 0.0, NeoHookean(0.2), STRETCHES)
    assert np.isnan(uncut.tip_stress_mpa).all()
    assert uncut.stress_mpa[0] == pytest.approx(0.2 * (1.1 - 1.1**-2), rel=1e-8)
