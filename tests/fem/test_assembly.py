"""Forces, stiffness and solution of both systems: differences, patch test, objectivity."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import CONDENSED_SOLUTION, PATCH_TEST, TANGENT_DIFFERENCE

from kiribench.fem.assembly import AssembledSystem, quadrature
from kiribench.fem.cell import cell_equations, cell_mesh
from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import LoadStepper, Solved
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import Material, NeoHookean, Ogden
from kiribench.fem.sheet import SheetSpec, quarter_equations, quarter_mesh

LAWS: list[Material] = [NeoHookean(0.207), Ogden(0.112, 3.29)]


def _distorted(seed: int) -> tuple[np.ndarray, AssembledSystem, np.ndarray, dict]:
    """An uncut facet whose inner nodes, mid-side ones too, are moved at random."""
    mesh = cell_mesh(0.0, 0.0, 10.0, MeshSpec(0.3))
    equation, pattern, sides = cell_equations(mesh)
    points = mesh.points_mm.copy()
    inner = np.all((points > 1e-9) & (points < 5 - 1e-9), axis=1)
    points[inner] += 0.12 * np.random.default_rng(seed).uniform(-1, 1, (inner.sum(), 2))
    return pattern, AssembledSystem(points, mesh.triangles(), equation, NeoHookean()), points, sides


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_uncut_sheet_on_distorted_meshes_is_exact(law: Material) -> None:
    for seed in range(3):
        pattern, plain, points, sides = _distorted(seed)
        system = AssembledSystem(points, plain.triangles, plain.equation, law)
        stepper = LoadStepper(system, pattern, tolerance=1e-20)
        for stretch in (1.3, 2.0):
            solved = stepper.advance(stretch - 1)
            assert isinstance(solved, Solved)
            lateral = solved.x[sides["right"][0], 0] / 5
            assert -np.log(lateral) / np.log(stretch) == pytest.approx(0.5, abs=PATCH_TEST)
            k = 2 * law.mu_mpa / law.alpha
            stress = k * (stretch ** (law.alpha - 1) - stretch ** (-law.alpha / 2 - 1))
            energy = k / law.alpha * (stretch**law.alpha + 2 * stretch ** (-law.alpha / 2) - 3)
            pull = system.forces(solved.x)[sides["top"], 1].sum() / 5
            assert pull == pytest.approx(stress, abs=PATCH_TEST)
            assert system.energy(solved.x) / 25 == pytest.approx(energy, abs=PATCH_TEST)


def test_any_homogeneous_state_is_in_equilibrium_inside() -> None:
    _, system, points, _ = _distorted(7)
    inner = np.all((points > 1e-9) & (points < 5 - 1e-9), axis=1)
    force = system.forces(points @ np.array([[1.2, 0.3], [-0.4, 0.9]]))
    assert np.abs(force[inner]).max() < PATCH_TEST
    assert np.abs(force[~inner]).max() > 0.01


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_forces_and_stiffness_are_derivatives(law: Material) -> None:
    mesh = cell_mesh(0.35, 0.85, 10.0, MeshSpec(1.0, 1.0, 0.6))
    equation, pattern, _ = cell_equations(mesh)
    system = AssembledSystem(mesh.points_mm, mesh.triangles(), equation, law)
    rng = np.random.default_rng(0)
    x = mesh.points_mm + 0.1 * pattern
    moves = [rng.normal(size=system.size) for _ in range(3)]
    step = 1e-6
    for move in moves:
        nodal = np.where(equation >= 0, move[equation], 0.0)
        slope = (system.energy(x + step * nodal) - system.energy(x - step * nodal)) / (2 * step)
        assert system.reduce(system.forces(x)) @ move == pytest.approx(slope, abs=1e-7)
        curve = system.reduce(system.forces(x + step * nodal) - system.forces(x - step * nodal)) / (
            2 * step
        )
        stiffness = system.stiffness(x)
        np.testing.assert_allclose(
            stiffness @ move, curve, atol=TANGENT_DIFFERENCE * np.abs(curve).max()
        )
        assert abs(stiffness - stiffness.T).max() < 1e-12 * abs(stiffness).max()


def test_energy_is_objective_and_forces_turn_along() -> None:
    mesh = cell_mesh(0.6, 0.3, 10.0, MeshSpec())
    equation, pattern, _ = cell_equations(mesh)
    system = AssembledSystem(mesh.points_mm, mesh.triangles(), equation, NeoHookean())
    x = mesh.points_mm + 0.1 * pattern
    angle = 1.1
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = x @ turn.T + [3.0, -2.0]
    assert system.energy(moved) == pytest.approx(system.energy(x), rel=1e-11)
    np.testing.assert_allclose(system.forces(moved), system.forces(x) @ turn.T, atol=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("projected", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("design", [(0.35, 0.85), (0.9, 0.9)])
def test_condensed_system_gives_the_answers_of_the_whole_matrix(
    law: Material, projected: float, design: tuple[float, float]
) -> None:
    mesh = quarter_mesh(*design, SheetSpec(4, 4, 10.0, 10.0), MeshSpec(0.5, 0.8, 0.4))
    equation, _pattern, _ = quarter_equations(mesh)
    whole = AssembledSystem(mesh.points_mm, mesh.triangles(), equation, law)
    parts = CondensedSystem(mesh, equation, law)
    assert parts.condensed_size < 0.4 * parts.size
    rng = np.random.default_rng(1)
    noise = np.where(equation >= 0, rng.normal(size=mesh.points_mm.shape), 0.0)
    x = mesh.points_mm * [0.97, 1.05] + 0.0005 * noise
    assert parts.energy(x) == pytest.approx(whole.energy(x), rel=1e-12)
    np.testing.assert_allclose(parts.forces(x), whole.forces(x), atol=1e-12)
    one = whole.linearise(x, projected=projected)
    two = parts.linearise(x, projected=projected)
    np.testing.assert_allclose(one, two, atol=1e-12)
    for right in (one, rng.normal(size=whole.size)):
        expected = whole.solve(right)
        np.testing.assert_allclose(
            parts.solve(right), expected, atol=CONDENSED_SOLUTION * np.abs(expected).max()
        )


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_negative_modes_are_those_of_the_stiffness(law: Material) -> None:
    """Counted by eigenvalues of the dense matrix, in a sheet crushed until it buckles."""
    mesh = quarter_mesh(0.9, 0.9, SheetSpec(2, 2, 10.0, 0.0), MeshSpec(1.0, 2.0, 1.0))
    equation, _pattern, _ = quarter_equations(mesh)
    whole = AssembledSystem(mesh.points_mm, mesh.triangles(), equation, law)
    parts = CondensedSystem(mesh, equation, law)
    seen = set()
    for squeeze in (1.0, 0.7, 0.6, 0.55):
        x = mesh.points_mm * [squeeze, 1.0]
        eigenvalues = np.linalg.eigvalsh(whole.stiffness(x).toarray())
        assert np.abs(eigenvalues).min() > 1e-9
        for system in (whole, parts):
            system.linearise(x)
            assert system.negative_modes() == np.sum(eigenvalues < 0)
            system.linearise(x, projected=1.0)
            assert system.negative_modes() == 0
        seen.add(int(np.sum(eigenvalues < 0)))
    assert min(seen) == 0
    assert max(seen) > 2


def test_a_folded_mesh_is_refused() -> None:
    mesh = cell_mesh(0.5, 0.5, 10.0, MeshSpec())
    points = mesh.points_mm.copy()
    inner = np.flatnonzero(np.all((points > 0.5) & (points < 4.5), axis=1))
    points[inner[0]] = [20.0, 20.0]
    with pytest.raises(ValueError, match="folded"):
        quadrature(points, mesh.triangles())
