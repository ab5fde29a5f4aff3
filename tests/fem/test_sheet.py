"""The tensile sheet: symmetry, gauge, the paper's own numbers."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import MIRRORED_MESH, POISSON_PAPER

from kiribench.errors import DataError
from kiribench.fem.facet import MeshSpec
from kiribench.fem.gauge import FacePairs, site_positions
from kiribench.fem.material import NeoHookean, uniaxial_stress
from kiribench.fem.patch import patch_mesh, simulate_patch
from kiribench.fem.sheet import SheetSpec, quarter_mesh, simulate_sheet
from kiribench.lattice import CutMap

COARSE = MeshSpec(0.5, 0.8, 0.3)
SMALL = SheetSpec(rows=6, columns=4, cell_mm=10.0, grip_mm=10.0)


def test_quarter_is_the_whole_sheet() -> None:
    displacements = [4.0, 12.0, 24.0]
    quarter = simulate_sheet(
        0.35, 0.85, displacements, sheet=SMALL, mesh=COARSE, estimate_error=False
    )
    whole = simulate_patch(
        CutMap.uniform(0.35, 0.85, 6, 4, 10.0), displacements, grip_mm=10.0, mesh=COARSE
    )
    np.testing.assert_allclose(
        whole.longitudinal_stretch[:, 2:4, 1:3].mean(axis=(1, 2)),
        quarter.longitudinal_stretch,
        atol=MIRRORED_MESH,
    )
    np.testing.assert_allclose(
        whole.lateral_stretch[:, 2:4, 1:3].mean(axis=(1, 2)),
        quarter.lateral_stretch,
        atol=MIRRORED_MESH,
    )
    np.testing.assert_allclose(
        whole.path.nominal_stress_mpa, quarter.nominal_stress_mpa, rtol=MIRRORED_MESH
    )
    np.testing.assert_allclose(whole.path.energy_mpa, quarter.energy_mpa, rtol=MIRRORED_MESH)
    np.testing.assert_allclose(whole.path.face_overlap_mm, quarter.face_overlap_mm, atol=0.01)


def test_energy_is_the_work_of_the_grip() -> None:
    at = np.linspace(0, 24, 25)
    path = simulate_sheet(0.6, 0.6, at[1:], sheet=SMALL, mesh=COARSE, estimate_error=False)
    force = np.append(0.0, path.nominal_stress_mpa) * 40.0
    work = np.sum((force[2:] + 4 * force[1:-1] + force[:-2])[::2]) * (at[1] - at[0]) / 3
    assert path.energy_mpa[-1] * 40.0 * 80.0 == pytest.approx(work, rel=1e-4)


def test_a_long_uncut_strip_is_in_uniaxial_tension() -> None:
    strip = SheetSpec(rows=24, columns=2, cell_mm=10.0, grip_mm=0.0)
    path = simulate_sheet(0.0, 0.0, [60.0, 240.0], sheet=strip, estimate_error=False)
    np.testing.assert_allclose(path.poisson(), 0.5, atol=2e-3)
    np.testing.assert_allclose(
        path.nominal_stress_mpa,
        uniaxial_stress(NeoHookean(), path.longitudinal_stretch),
        rtol=2e-3,
    )


def test_mesh_error_is_given_and_honest() -> None:
    displacements = [8.0, 16.0]
    path = simulate_sheet(0.35, 0.85, displacements, sheet=SMALL, mesh=COARSE)
    fine = simulate_sheet(
        0.35, 0.85, displacements, sheet=SMALL, mesh=COARSE.scaled(0.4), estimate_error=False
    )
    true = np.abs(path.poisson() - fine.poisson())
    # Estimated with the periodic cell: right to half of itself.
    np.testing.assert_allclose(path.mesh_error_poisson, true, atol=0.5 * true.max())


@pytest.mark.slow
def test_the_papers_range_of_90_90() -> None:
    # 30 CPU s: the whole sheet at 20 displacements.
    path = simulate_sheet(0.9, 0.9, np.arange(10.0, 201.0, 10.0), mesh=COARSE, estimate_error=False)
    nu = path.require_converged().poisson()
    assert nu[0] == pytest.approx(-0.93, abs=POISSON_PAPER)
    assert nu[-1] == pytest.approx(-0.32, abs=POISSON_PAPER)
    assert np.all(np.diff(nu) > 0)


def test_sites_are_the_means_of_both_faces() -> None:
    cut_map = CutMap.uniform(0.6, 0.6, 2, 2, 10.0)
    mesh = patch_mesh(cut_map, COARSE)
    x = mesh.points_mm.copy()
    centre = mesh.corners[1, 1]  # facet below and right of the centre site (2, 2)
    above = mesh.corners[1, 1, 2]
    below = mesh.corners[2, 2, 0]
    assert above != below
    np.testing.assert_allclose(x[above], x[below], atol=1e-12)
    np.testing.assert_allclose(x[centre[2]], [10.0, 10.0])
    x[above] += [0.0, -1.0]
    x[below] += [0.5, 3.0]
    np.testing.assert_allclose(site_positions(mesh, x)[2, 2], [10.25, 11.0])


def test_seams_are_split_and_ligaments_are_shared() -> None:
    mesh = patch_mesh(CutMap.uniform(0.35, 0.85, 4, 2, 10.0), COARSE)
    _, count = np.unique(np.round(mesh.points_mm, 9), axis=0, return_counts=True)
    assert set(count.tolist()) == {1, 2}
    faces = mesh.cut_faces()
    for left, right in faces:
        assert left[-1] == right[-1]  # one tip
        assert not set(left[:-1].tolist()) & set(right[:-1].tolist())
    # Two nodes at every inner node of a cut, mouth included.
    doubled = {node for pair in faces for side in pair for node in side[:-1].tolist()}
    assert (count == 2).sum() * 2 == len(doubled)


def test_overlap_of_crack_faces_is_its_depth() -> None:
    mesh = patch_mesh(CutMap.uniform(0.6, 0.6, 2, 2, 10.0), COARSE)
    pairs = FacePairs.of(mesh)
    assert pairs.overlap_mm(mesh.points_mm) == 0.0
    for left, right in mesh.cut_faces():
        along = mesh.points_mm[left[-1]] - mesh.points_mm[left[0]]
        to_left = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        x = mesh.points_mm.copy()
        x[left[1:-1]] += 0.3 * to_left
        assert pairs.overlap_mm(x) == 0.0  # opened
        x = mesh.points_mm.copy()
        x[right[1:-1]] += 0.3 * to_left
        assert pairs.overlap_mm(x) == pytest.approx(0.3, rel=0.05)


def test_sheet_area_is_that_of_the_specimen() -> None:
    mesh = quarter_mesh(0.35, 0.85, SheetSpec(), COARSE)
    assert mesh.x_mm[-1] == 60.0
    assert mesh.y_mm[-1] == 110.0


@pytest.mark.parametrize("wrong", [{"rows": 5}, {"columns": 0}, {"cell_mm": -1.0}])
def test_sheets_without_a_quarter_are_refused(wrong: dict) -> None:
    with pytest.raises(DataError) as caught:
        SheetSpec(**wrong)
    assert caught.value.code == "sheet-shape"
