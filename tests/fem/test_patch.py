"""Heterogeneous patches: symmetry, ends, equilibrium between the cells."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.fem import equilibrium
from kiribench.fem.facet import MeshSpec
from kiribench.fem.patch import simulate_patch
from kiribench.lattice import CutMap

COARSE = MeshSpec(0.5, 0.8, 0.4)


def _map(seed: int = 0) -> CutMap:
    rng = np.random.default_rng(seed)
    return CutMap(rng.uniform(0.3, 0.8, (3, 2)), rng.uniform(0.3, 0.8, (3, 2)), 15.0)


def test_a_mirrored_map_gives_mirrored_cells() -> None:
    cut_map = _map()
    mirrored = CutMap(cut_map.a[:, ::-1], cut_map.b[:, ::-1], 15.0)
    turned = CutMap(cut_map.a[::-1], cut_map.b[::-1], 15.0)
    one = simulate_patch(cut_map, [10.0], grip_mm=10.0, mesh=COARSE)
    two = simulate_patch(mirrored, [10.0], grip_mm=10.0, mesh=COARSE)
    three = simulate_patch(turned, [10.0], grip_mm=10.0, mesh=COARSE)
    # Facets are meshed in one orientation, so mirrored patches have other triangles.
    for name in ("longitudinal_stretch", "lateral_stretch"):
        cells = getattr(one, name)[0]
        np.testing.assert_allclose(getattr(two, name)[0], cells[:, ::-1], atol=2e-3)
        np.testing.assert_allclose(getattr(three, name)[0], cells[::-1], atol=2e-3)
    assert np.ptp(one.longitudinal_stretch) > 0.05


def test_soft_cells_stretch_more_than_stiff_ones_in_series() -> None:
    a = np.array([[0.2, 0.2], [0.85, 0.85], [0.2, 0.2]])
    path = simulate_patch(CutMap(a, np.full((3, 2), 0.5), 15.0), [8.0], mesh=COARSE)
    rows = path.longitudinal_stretch[0].mean(axis=1)
    assert rows[1] > 1.5 * rows[0] - 0.5
    assert rows[1] == rows.max()
    # The corner rows are held by the prescribed ends: the stretches add up to the displacement.
    sites = path.site_mm[0]
    np.testing.assert_allclose((sites[-1, :, 1] - sites[0, :, 1]).mean(), 45.0 + 8.0, atol=0.2)


def test_sliding_ends_narrow_and_held_ones_do_not() -> None:
    cut_map = CutMap.uniform(0.1, 0.1, 2, 2, 15.0)
    held = simulate_patch(cut_map, [9.0], mesh=COARSE)
    sliding = simulate_patch(cut_map, [9.0], ends="sliding", mesh=COARSE)
    assert np.ptp(held.site_mm[0, 0, :, 0]) > 29.99
    assert np.ptp(sliding.site_mm[0, 0, :, 0]) < 28.5
    assert held.path.nominal_stress_mpa[0] > sliding.path.nominal_stress_mpa[0]


def test_an_unreachable_step_leaves_gaps_not_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equilibrium, "_MOST_ITERATIONS", 2)
    monkeypatch.setattr(equilibrium, "_SMALLEST_STEP", 1.0)
    path = simulate_patch(_map(), [0.001, 30.0], grip_mm=5.0, mesh=COARSE)
    assert path.path.status == ("ok", "not-converged")
    assert np.isfinite(path.lateral_stretch[0]).all()
    assert np.isnan(path.lateral_stretch[1]).all()
    assert np.isnan(path.site_mm[1]).all()
