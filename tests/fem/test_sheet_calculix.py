"""A tensile sheet against CalculiX on the same mesh, supports written out anew."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from sheet_calculix import pull_in_calculix
from tolerances import POISSON_CALCULIX

from kiribench.fem.facet import MeshSpec
from kiribench.fem.sheet import SheetSpec, quarter_mesh, simulate_sheet

SMALL = SheetSpec(rows=4, columns=4, cell_mm=10.0, grip_mm=10.0)
COARSE = MeshSpec(1.0, 1.0, 0.6)


@pytest.mark.slow
@pytest.mark.calculix
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs Debian's calculix-ccx")
@pytest.mark.parametrize(("a", "b"), [(0.6, 0.75), (0.05, 0.95)])
def test_sheets_are_those_of_calculix(a: float, b: float, tmp_path: Path) -> None:
    """Auxetic, and long cuts along the pull, where grips and not cells decide.

    CalculiX is nearly incompressible (K/mu = 500), takes 30 increments, and solves in 3-D.
    """
    mesh = quarter_mesh(a, b, SMALL, COARSE)
    ran = pull_in_calculix(mesh, tmp_path, displacement_mm=24.0, steps=6)
    assert len(ran.displacement_mm) >= 6
    assert ran.displacement_mm[-1] == pytest.approx(24.0)
    ours = simulate_sheet(
        a, b, ran.displacement_mm, sheet=SMALL, mesh=COARSE, estimate_error=False
    ).require_converged()
    expected = -np.log(ran.lateral_stretch) / np.log(ran.longitudinal_stretch)
    assert np.ptp(expected) > 0.05
    np.testing.assert_allclose(ours.poisson(), expected, atol=POISSON_CALCULIX)
    np.testing.assert_allclose(ours.nominal_stress_mpa, ran.nominal_stress_mpa, rtol=0.01)
