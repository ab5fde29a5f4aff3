"""Residual and tangent of the worn patch by finite differences; its mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from curved_skins import Quadric, Sphere

from kiribench.fem import wear_system
from kiribench.fem.surface_map import Cylinder, Plane, SurfaceMap
from kiribench.fem.wear import WearSpec, wear_patch
from kiribench.fem.wear_friction import Drag
from kiribench.fem.wear_mesh import PatchMesh, facet_points, facet_template, mesh_patch
from kiribench.fem.wear_system import WearSystem, relax
from kiribench.lattice import CutMap

MU = 0.207


def _map(seed: int = 0) -> CutMap:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0.2, 0.8, (2, 2, 2))
    a[0, 1] = 0.0
    return CutMap(a, b, 15.0)


def _system(
    surface: SurfaceMap, intervals: int, order: int
) -> tuple[WearSystem, PatchMesh, np.ndarray]:
    """A patch with held ends and nodes astray, far from equilibrium."""
    mesh = mesh_patch(_map(), intervals, order)
    y = mesh.points_mm[:, 1]
    held = (y < 1e-9) | (y > 30 - 1e-9)
    system = WearSystem(mesh, surface, np.repeat(held[:, None], 2, axis=1), MU)
    rng = np.random.default_rng(3)
    q = mesh.points_mm * [1.02, 1.1] + [5.0, 12.0] + 0.02 * rng.normal(size=mesh.points_mm.shape)
    return system, mesh, q


# On a sphere and a plane no normal force does work along the mixed second derivative; on a
# twisted skin it does.
CASES = [
    (Sphere(40.0), 6, 2),
    (Sphere(40.0), 4, 1),
    (Plane(1.1, 1.2, 0.1), 6, 2),
    (Quadric(1 / 50, -1 / 70, 1.1, 1 / 60), 6, 2),
]


@pytest.mark.parametrize(("surface", "intervals", "order"), CASES)
def test_the_residual_is_the_gradient_of_the_energy(
    surface: SurfaceMap, intervals: int, order: int
) -> None:
    system, _, q = _system(surface, intervals, order)
    jet = system.jet(q)
    residual = system.residual(jet, system.forces(jet))
    rng = np.random.default_rng(4)
    for _ in range(3):
        way = np.where(system.fixed, 0.0, rng.normal(size=q.shape))
        step = 1e-6
        difference = (system.energy(q + step * way) - system.energy(q - step * way)) / (2 * step)
        np.testing.assert_allclose(np.sum(residual * way), difference, rtol=1e-6)


@pytest.mark.parametrize(("surface", "intervals", "order"), CASES)
@pytest.mark.parametrize("with_drag", [False, True])
def test_the_condensed_solution_inverts_the_derivative_of_the_residual(
    surface: SurfaceMap, intervals: int, order: int, with_drag: bool
) -> None:
    system, _, q = _system(surface, intervals, order)
    # Where the tangent is positive definite: near equilibrium.
    q = relax(system, q).q + np.where(system.fixed, 0.0, 1e-4)
    rng = np.random.default_rng(5)
    drag = Drag(q - 0.03, rng.uniform(0, 0.01, len(q)), system.jet(q).metric)

    def residual(at: np.ndarray) -> np.ndarray:
        jet = system.jet(at)
        total = system.residual(jet, system.forces(jet))
        return total + np.where(system.fixed, 0.0, drag.gradient(at)) if with_drag else total

    way = np.where(system.fixed, 0.0, rng.normal(size=q.shape))
    step = 1e-6
    pushed = (residual(q + step * way) - residual(q - step * way)) / (2 * step)
    _, definite = system.linearise(system.jet(q), extra=drag.stiffness(q) if with_drag else None)
    assert definite
    np.testing.assert_allclose(system.solve(pushed), way, rtol=0, atol=2e-6)


def test_friction_is_the_gradient_of_its_potential() -> None:
    rng = np.random.default_rng(6)
    metric = np.einsum("nij,nkj->nik", *[rng.normal(size=(7, 2, 2))] * 2) + np.eye(2)
    drag = Drag(rng.normal(size=(7, 2)), rng.uniform(1, 2, 7), metric)
    q, way = rng.normal(size=(2, 7, 2))
    step = 1e-6
    slope = (drag.energy(q + step * way) - drag.energy(q - step * way)) / (2 * step)
    np.testing.assert_allclose(np.sum(drag.gradient(q) * way), slope, rtol=1e-7)
    bent = (drag.gradient(q + step * way) - drag.gradient(q - step * way)) / (2 * step)
    product = np.einsum("nab,nb->na", drag.stiffness(q).reshape(-1, 2, 2), way)
    np.testing.assert_allclose(product, bent, atol=1e-7)
    # Far beyond the creep the drag is Coulomb's limit, against the slip.
    far = Drag(np.zeros((1, 2)), np.array([2.0]), np.eye(2)[None])
    np.testing.assert_allclose(far.gradient(np.array([[30.0, 40.0]])), [[1.2, 1.6]], rtol=1e-5)
    # At a twentieth of a millimetre it is the limit over the root of two.
    near = far.gradient(np.array([[0.03, 0.04]]))
    np.testing.assert_allclose(near, np.array([[1.2, 1.6]]) / np.sqrt(2), rtol=1e-12)


def test_a_tangent_made_positive_goes_downhill_from_afar() -> None:
    system, mesh, _ = _system(Sphere(40.0), 6, 2)
    # The ends are where they should be, the middle is squeezed to six tenths of its width.
    squeezed = mesh.points_mm * [1.0, 1.1] + [0.0, 10.0]
    squeezed[:, 0] *= 1 - 0.4 * np.sin(np.pi * mesh.points_mm[:, 1] / 30)
    jet = system.jet(squeezed)
    _, definite = system.linearise(jet)
    assert not definite
    force, definite = system.linearise(jet, projected=True)
    assert definite
    residual = system.residual(jet, force)
    assert np.sum(residual * system.solve(residual)) > 0
    found = relax(system, squeezed)
    assert found.reason is None


def test_a_patch_that_folds_or_does_not_converge_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    system, mesh, q = _system(Sphere(40.0), 6, 2)
    folded = mesh.points_mm * [-1.0, 1.0]
    assert relax(system, folded).reason == "the patch is folded where it starts"
    monkeypatch.setattr(wear_system, "_MOST_ITERATIONS", 1)
    found = relax(system, q)
    assert found.reason == "no equilibrium after 1 iterations"
    assert found.iterations == 1


@pytest.mark.parametrize(("intervals", "order"), [(6, 2), (10, 2), (16, 2), (5, 1), (10, 1)])
def test_no_facet_is_folded_whatever_its_cuts(intervals: int, order: int) -> None:
    template = facet_template(intervals, order)
    rng = np.random.default_rng(7)
    cuts = np.concatenate(
        [
            rng.uniform(0.02, 0.98, (300, 4)),
            np.array(np.meshgrid(*[[0.0, 0.02, 0.98]] * 4)).reshape(4, -1).T,
        ]
    )
    points, moved = facet_points(cuts, template)
    jacobian = np.einsum("fmai,qar->fmqir", points[:, template.elements], template.shapes)
    assert np.linalg.det(jacobian).min() > 0
    assert np.einsum("fmq,q->f", np.linalg.det(jacobian), template.weights) == pytest.approx(1)
    # Tips are on their nodes, half of the elements or more on the ligament; linear motion.
    tip = template.cut_nodes
    assert template.intervals - tip >= template.intervals / 2
    uncut = np.any(cuts == 0, axis=1)
    np.testing.assert_allclose(points[~uncut][:, template.edges[0, tip], 0], cuts[~uncut, 0])
    np.testing.assert_allclose(points[~uncut][:, template.edges[3, tip], 1], 1 - cuts[~uncut, 3])
    step = 0.01 * np.where(cuts > 0, 1.0, 0.0)
    more, _ = facet_points(cuts + step, template)
    np.testing.assert_allclose(more - points, np.einsum("feni,fe->fni", moved, step), atol=1e-14)


def test_faces_part_and_ligaments_hold() -> None:
    mesh = mesh_patch(CutMap.uniform(0.4, 0.6, 2, 3, 10.0), 6, 2)
    number, count = np.unique(mesh.nodes, return_counts=True)
    assert len(number) == len(mesh.points_mm)
    np.testing.assert_allclose(mesh.points_mm[mesh.nodes], mesh.facet_mm, atol=1e-12)
    # A site inside has two nodes, one on either face of its cut; each has two facets.
    x, y = mesh.points_mm.T
    for p in range(1, 6):
        for q in range(1, 4):
            here = np.flatnonzero((np.abs(x - 5 * p) < 1e-9) & (np.abs(y - 5 * q) < 1e-9))
            assert len(here) == 2
            np.testing.assert_array_equal(count[here], 2)
    # So has every place on a half-cut up to its tip; the tip and the ligament have one.
    cuts = mesh.cut_map.half_cuts()
    for (q, p), way, length in zip(cuts.site, cuts.direction, cuts.length_mm, strict=True):
        from_site = mesh.points_mm - 5.0 * np.array([q, p])
        ahead = from_site @ way
        on = np.abs(from_site - ahead[:, None] * way).max(axis=1) < 1e-9
        places, nodes = np.unique(np.round(ahead[on], 9), return_counts=True)
        inside = (places > 1e-9) & (places < 5 - 1e-9)
        expected = np.where(places < length - 1e-9, 2, 1)
        np.testing.assert_array_equal(nodes[inside], expected[inside])
        assert np.count_nonzero(inside & (expected == 2)) > 0


def test_what_the_condensation_hides_is_not_called_positive_definite() -> None:
    system, mesh, q = _system(Sphere(40.0), 6, 2)
    jet = system.jet(relax(system, q).q)
    inside = np.setdiff1d(mesh.nodes[5], mesh.nodes[5][np.unique(mesh.template.edges)])
    extra = np.zeros((len(q), 4))
    _, definite = system.linearise(jet, extra=extra)
    assert definite
    # A soft spring of negative stiffness on one node inside of a facet: with so much of it the
    # tangent and its eliminated block have one negative eigenvalue each, so the condensed
    # matrix has none, and its Cholesky factors exist.
    extra[inside[0], 0] = -1e3 * MU
    _, definite = system.linearise(jet, extra=extra)
    assert np.isfinite(system.solve_kept(np.ones(system.size))).all()
    assert not definite


def test_where_newton_gets_stuck_it_begins_again_with_shorter_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cuts = np.random.default_rng(3).uniform(0.3, 0.8, (2, 2, 2))
    design, skin = CutMap(cuts[0], cuts[1], 15.0), Cylinder(30.0, 1.05, 1.3)
    plain = wear_patch(design, skin, (0.0, 0.0), WearSpec(6))
    descend, tried, accepted = wear_system._descend, [], [0.0]

    def stuck(system: Any, start: Any, other: Any, longest: float) -> Any:
        found = descend(system, start, other, longest)
        tried.append((longest, found.iterations))
        if longest > accepted[0]:
            return replace(found, reason="no step lowers the energy; the largest residual is 1")
        return found

    monkeypatch.setattr(wear_system, "_descend", stuck)
    for shortest, parts in ((0.5, [1.0, 0.5]), (0.25, [1.0, 0.5, 0.25])):
        tried.clear()
        accepted[0] = shortest
        again = wear_patch(design, skin, (0.0, 0.0), WearSpec(6))
        assert again.status == "ok" and [part for part, _ in tried] == parts
        # Shorter steps are more of them, to the same equilibrium.
        assert [count for _, count in tried] == sorted(count for _, count in tried)
        assert again.newton_iterations == sum(count for _, count in tried)
        assert again.corner_q_mm == pytest.approx(plain.corner_q_mm, abs=1e-8)
    accepted[0] = 0.0
    lost = wear_patch(design, skin, (0.0, 0.0), WearSpec(6))
    assert lost.status == "not-converged" and "no step lowers" in str(lost.reason)
