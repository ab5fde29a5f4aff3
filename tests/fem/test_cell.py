"""The periodic cell: limits, energy, convergence, monotony and the published witness."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from facet_models import FacetModel, run_calculix, supported, uniform_quads, uniform_triangles
from scipy.integrate import simpson
from tolerances import (
    ENERGY_WORK,
    POISSON_CALCULIX,
    POISSON_CALCULIX_SAME_MESH,
    POISSON_MESH,
    SOLVED_POISSON,
)

from kiribench.errors import NotConvergedError
from kiribench.fem import equilibrium
from kiribench.fem.assembly import AssembledSystem
from kiribench.fem.cell import CELL_MESH, cell_mesh, simulate_cell
from kiribench.fem.equilibrium import LoadStepper, Solved
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import NeoHookean, Ogden

WITNESS = Path(__file__).parents[1] / "data" / "fea_witness" / "calculix_90_90.csv"


def _follow(model: FacetModel, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lateral stretch and nominal stress of a facet model at the longitudinal stretches."""
    system = AssembledSystem(model.points, model.elements, model.equation, NeoHookean())
    stepper = LoadStepper(system, model.pattern)
    lateral, stress = [], []
    for stretch in stretches:
        solved = stepper.advance(float(stretch) - 1)
        assert isinstance(solved, Solved)
        lateral.append(solved.x[model.right[0], 0] / 5)
        stress.append(system.forces(solved.x)[model.top, 1].sum() / 5)
    return np.array(lateral), np.array(stress)


def _engineering(lateral: np.ndarray, longitudinal: np.ndarray) -> np.ndarray:
    return -(lateral - 1) / (longitudinal - 1)


@pytest.mark.parametrize("law", [NeoHookean(0.207), Ogden(0.112, 3.29)], ids=str)
def test_uncut_cell_is_the_closed_form(law: NeoHookean | Ogden) -> None:
    stretches = np.array([0.8, 0.7])
    for part in (np.array([1.1, 1.6, 2.4]), stretches):
        path = simulate_cell(0.0, 0.0, part, material=law, estimate_error=False)
        k = 2 * law.mu_mpa / law.alpha
        np.testing.assert_allclose(path.poisson(), 0.5, atol=SOLVED_POISSON)
        np.testing.assert_allclose(
            path.nominal_stress_mpa,
            k * (part ** (law.alpha - 1) - part ** (-law.alpha / 2 - 1)),
            atol=SOLVED_POISSON * law.mu_mpa,
        )


def test_energy_is_the_work_of_the_reaction() -> None:
    stretches = 1 + np.linspace(0, 0.6, 41)
    path = simulate_cell(0.35, 0.85, stretches[1:], estimate_error=False)
    stress = np.append(0.0, path.nominal_stress_mpa)
    for last in (20, 40):
        work = simpson(stress[: last + 1], x=stretches[: last + 1])
        assert path.energy_mpa[last - 1] == pytest.approx(work, rel=ENERGY_WORK)


def test_poisson_does_not_depend_on_the_modulus_and_stress_scales_with_it() -> None:
    one = simulate_cell(0.5, 0.7, [1.1, 1.4], material=NeoHookean(0.207), estimate_error=False)
    two = simulate_cell(0.5, 0.7, [1.1, 1.4], material=NeoHookean(2.07), estimate_error=False)
    np.testing.assert_allclose(two.poisson(), one.poisson(), atol=1e-7)
    np.testing.assert_allclose(two.nominal_stress_mpa, 10 * one.nominal_stress_mpa, rtol=1e-7)


def test_cell_size_is_a_unit() -> None:
    one = simulate_cell(0.5, 0.7, [1.2], cell_mm=10.0, estimate_error=False)
    two = simulate_cell(0.5, 0.7, [1.2], cell_mm=15.0, estimate_error=False)
    np.testing.assert_allclose(two.poisson(), one.poisson(), atol=1e-9)
    np.testing.assert_allclose(two.nominal_stress_mpa, one.nominal_stress_mpa, rtol=1e-9)
    assert two.displacement_mm[0] == pytest.approx(3.0)


def test_rotating_squares_go_to_minus_one() -> None:
    # Published readings at strain .01 on meshes of their own (.8, .9, .95, .99).
    read = {0.8: -0.847, 0.9: -0.953, 0.95: -0.984, 0.99: -0.9987}
    found = [simulate_cell(cut, cut, [1.01]).poisson()[0] for cut in read]
    np.testing.assert_allclose(found, list(read.values()), atol=POISSON_MESH)
    assert np.all(np.diff(found) < 0)
    assert found[-1] > -1
    # The defect 1 + nu vanishes with the ligament.
    assert 1 + found[-1] < 0.06 * (1 + found[1])


def test_rotating_squares_lock_at_the_kinematic_limit() -> None:
    limit = np.sqrt(2)
    path = simulate_cell(0.99, 0.99, [1.2, 1.38, 1.40, 1.43, 1.46], estimate_error=False)
    # Rigid squares: both stretches are cos + sin of the turn, at most sqrt(2).
    np.testing.assert_allclose(path.lateral_stretch[:3], path.longitudinal_stretch[:3], atol=0.004)
    assert path.lateral_stretch.max() < limit
    stiffness = np.diff(path.nominal_stress_mpa) / np.diff(path.longitudinal_stretch)
    assert stiffness[-1] > 100 * stiffness[0]


@pytest.mark.parametrize(
    "design", [(0.01, 0.01), (0.35, 0.85), (0.85, 0.35), (0.6, 0.6), (0.9, 0.9), (0.05, 0.95)]
)
def test_poisson_rises_with_strain_and_faces_do_not_cross(design: tuple[float, float]) -> None:
    path = simulate_cell(*design, np.exp(np.linspace(0.04, 0.88, 25)))
    assert path.reason is None
    assert np.all(np.diff(path.poisson()) > 0)
    assert path.face_overlap_mm.max() < 1e-4
    assert path.mesh_error_poisson.max() < POISSON_MESH


@pytest.mark.parametrize("design", [(0.35, 0.85), (0.5, 0.5), (0.9, 0.9)])
def test_meshes_are_within_their_promise_of_a_very_fine_one(design: tuple[float, float]) -> None:
    stretches = [1.05, 1.2, 1.5, 2.0]
    fine = simulate_cell(*design, stretches, mesh=MeshSpec().scaled(0.3), estimate_error=False)
    sheet = simulate_cell(*design, stretches, mesh=MeshSpec(), estimate_error=False)
    cell = simulate_cell(*design, stretches)
    assert np.abs(sheet.poisson() - fine.poisson()).max() < POISSON_MESH
    error = np.abs(cell.poisson() - fine.poisson())
    assert error.max() < 0.4 * POISSON_MESH
    # The stated error is not smaller than the true one, but for noise far below the promise.
    assert np.all(error < cell.mesh_error_poisson + 0.1 * POISSON_MESH)


def test_graded_meshes_converge_twice_as_fast_as_uniform_ones() -> None:
    # A uniform mesh is held to first order by the root of the distance at the tips.
    at = np.array([1.05, 1.1])
    fine = simulate_cell(0.5, 0.5, at, mesh=MeshSpec(0.06, 0.06, 0.04), estimate_error=False)
    truth = fine.lateral_stretch[-1]
    counts = np.array([4, 8, 16])
    uniform = np.array([_follow(uniform_triangles(n, 0.5, 0.5), at)[0][-1] for n in counts])
    plain = np.polyfit(np.log(1 / counts), np.log(np.abs(uniform - truth)), 1)[0]
    assert 0.8 < plain < 1.3
    sizes = np.array([1.0, 0.7, 0.5, 0.35])
    paths = [
        simulate_cell(0.5, 0.5, at, mesh=MeshSpec().scaled(f), estimate_error=False) for f in sizes
    ]
    errors = np.abs([path.lateral_stretch[-1] - truth for path in paths])
    graded = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert graded > 1.4


def test_uniform_meshes_extrapolate_to_the_graded_answer() -> None:
    # Independent of grading and quarter points: first-order error, so 2 nu(h/2) - nu(h).
    at = np.array([1.05, 1.3])
    one, two = (_follow(uniform_triangles(n, 0.35, 0.85), at)[0] for n in (20, 40))
    limit = 2 * two - one
    graded = simulate_cell(0.35, 0.85, at).lateral_stretch
    nu, expected = -np.log(graded) / np.log(at), -np.log(limit) / np.log(at)
    np.testing.assert_allclose(nu, expected, atol=0.4 * POISSON_MESH)


def test_calculix_witness_of_90_90() -> None:
    with WITNESS.open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["element"].startswith("CPS8R")]
    strain = np.array([float(row["eps_long"]) for row in rows])
    witness = np.array([float(row["nu_ccx"]) for row in rows])
    # On the witness's element edge, .25 mm; its eight-node quads and our triangles differ.
    lateral, _ = _follow(uniform_triangles(20, 0.9, 0.9), 1 + strain)
    np.testing.assert_allclose(_engineering(lateral, 1 + strain), witness, atol=POISSON_CALCULIX)


@pytest.mark.calculix
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["graded", "quads"])
def test_fresh_calculix_run_of_60_40(kind: str, tmp_path: Path) -> None:
    a, b = 0.6, 0.4
    if kind == "graded":
        mesh = cell_mesh(a, b, 10.0, MeshSpec())
        model = supported(mesh.points_mm, mesh.triangles(), a, b)
        tolerance = POISSON_CALCULIX_SAME_MESH
    else:
        model, tolerance = uniform_quads(20, a, b), POISSON_CALCULIX
    ran = run_calculix(model, tmp_path, largest_strain=0.6, steps=8, bulk_over_mu=500.0)
    ours = model if kind == "graded" else uniform_triangles(20, a, b)
    lateral, stress = _follow(ours, ran.longitudinal_stretch)
    expected = _engineering(ran.lateral_stretch, ran.longitudinal_stretch)
    np.testing.assert_allclose(
        _engineering(lateral, ran.longitudinal_stretch), expected, atol=tolerance
    )
    np.testing.assert_allclose(stress, ran.nominal_stress_mpa, rtol=0.01)


def test_a_hopeless_step_is_a_status_with_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equilibrium, "_MOST_ITERATIONS", 2)
    monkeypatch.setattr(equilibrium, "_SMALLEST_STEP", 1.0)
    path = simulate_cell(0.9, 0.9, [1.0001, 1.5, 1.6])
    assert path.status == ("ok", "not-converged", "not-reached")
    assert np.isnan(path.lateral_stretch[1:]).all()
    assert np.isfinite(path.mesh_error_poisson[0])
    assert path.reason is not None
    assert "no convergence in 2 iterations" in path.reason
    with pytest.raises(NotConvergedError, match="step 2 of 3"):
        path.require_converged()


def test_a_converged_path_passes() -> None:
    good = simulate_cell(0.5, 0.5, [1.1], estimate_error=False)
    assert good.require_converged() is good
    assert good.status == ("ok",)


def test_default_mesh_of_a_cell_is_half_that_of_a_sheet() -> None:
    assert MeshSpec().scaled(0.5) == CELL_MESH
