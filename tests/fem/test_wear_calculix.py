"""The worn patch on a plane against CalculiX on the same mesh."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from flat_patch_witness import pull_patch
from tolerances import WEAR_CALCULIX_STRAIN

from kiribench.fem.gauge import cell_stretches
from kiribench.fem.surface_map import Plane
from kiribench.fem.wear import WearSpec, wear_patch
from kiribench.fem.wear_measures import site_means
from kiribench.fem.wear_mesh import mesh_patch
from kiribench.lattice import CutMap


@pytest.mark.slow
@pytest.mark.calculix
@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs Debian's calculix-ccx")
def test_strains_are_those_of_calculix(tmp_path: Path) -> None:
    a, b = np.random.default_rng(1).uniform(0.35, 0.85, (2, 3, 2))
    cut_map = CutMap(a, b, 15.0)
    worn = wear_patch(cut_map, Plane(1.0, 1.3), (0.0, 0.0), WearSpec(10))
    mesh = mesh_patch(cut_map, 10, 2)
    witness = pull_patch(mesh, tmp_path, stretch=1.3, steps=5)
    theirs = cell_stretches(site_means(mesh, witness.x_mm)[::2, ::2], 15.0)
    assert np.abs(worn.longitudinal_stretch - theirs.longitudinal).max() < WEAR_CALCULIX_STRAIN
    assert np.abs(worn.lateral_stretch - theirs.lateral).max() < WEAR_CALCULIX_STRAIN
    assert np.ptp(theirs.longitudinal) > 0.05
