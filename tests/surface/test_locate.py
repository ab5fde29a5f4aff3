from __future__ import annotations

import numpy as np
import pytest
import trimesh
from geodesic_oracles import polyhedron, sheet, terrain
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import LOCATE_MM

from kiribench.errors import MeshError, NodesError
from kiribench.surface.face_grid import face_grid
from kiribench.surface.locate import locate, project_along
from kiribench.surface.mesh import Mesh


def brute_force(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Distance to the closest of all faces, by trimesh's routine for single triangles."""
    out = []
    for p in points:
        closest = trimesh.triangles.closest_point(
            mesh.corners_mm, np.broadcast_to(p, (len(mesh.faces), 3))
        )
        out.append(np.linalg.norm(closest - p, axis=1).min())
    return np.array(out)


def mixed_sizes(seed: int) -> Mesh:
    """Fine faces beside one that spans everything: centroids mislead here."""
    fine = terrain(seed, 300, 0.2)
    n = len(fine.vertices_mm)
    far = np.array([[-200.0, -150.0, 5.0], [300.0, -180.0, 4.0], [20.0, 400.0, -3.0]])
    faces = np.concatenate([fine.faces, [[n, n + 1, n + 2]]]).astype(np.int32)
    return Mesh(np.concatenate([fine.vertices_mm, far]), faces)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), kind=st.sampled_from(["rough", "ball", "mixed", "flat"]))
def test_closest_point_equals_brute_force(seed: int, kind: str) -> None:
    mesh = {
        "rough": lambda: terrain(seed, 150, 2.0),
        "ball": lambda: polyhedron(seed, 80, (5.0, 1.0, 20.0)),
        "mixed": lambda: mixed_sizes(seed),
        "flat": lambda: sheet(9, 7),
    }[kind]()
    rng = np.random.default_rng(seed)
    near = mesh.vertices_mm[rng.integers(0, len(mesh.vertices_mm), 10)]
    points = np.concatenate(
        [near, near + rng.normal(0, 1, near.shape), rng.normal(0, 300, (5, 3)), [[0, 0, 0]]]
    )
    found = locate(mesh, points)
    np.testing.assert_allclose(found.distance_mm, brute_force(mesh, points), rtol=0, atol=LOCATE_MM)
    gap = np.linalg.norm(found.points.positions_mm(mesh) - points, axis=1)
    np.testing.assert_allclose(gap, found.distance_mm, rtol=0, atol=LOCATE_MM)
    assert (found.points.barycentric >= 0).all()
    np.testing.assert_allclose(found.points.barycentric.sum(axis=1), 1.0, atol=1e-15)
    assert found.hit.all()


def test_points_on_the_mesh_come_back() -> None:
    mesh = terrain(3, 200, 1.0)
    rng = np.random.default_rng(0)
    faces = rng.integers(0, len(mesh.faces), 100)
    weights = rng.dirichlet(np.ones(3), 100)
    there = np.einsum("kc,kcx->kx", weights, mesh.corners_mm[faces])
    found = locate(mesh, there)
    assert found.distance_mm.max() < LOCATE_MM
    np.testing.assert_allclose(found.points.positions_mm(mesh), there, atol=LOCATE_MM)


def test_a_shared_grid_changes_nothing() -> None:
    mesh = terrain(4, 200, 1.0)
    points = np.random.default_rng(0).uniform(0, 10, (40, 3))
    alone, shared = locate(mesh, points), locate(mesh, points, grid=face_grid(mesh))
    np.testing.assert_array_equal(alone.points.faces, shared.points.faces)
    np.testing.assert_array_equal(alone.distance_mm, shared.distance_mm)


def test_degenerate_faces_do_not_disturb() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [9, 9, 9]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [4, 4, 4]], np.int32)
    found = locate(
        Mesh(vertices, faces), np.array([[0.25, 0.25, 2.0], [0.5, -1.0, 0.0], [9, 9, 8]])
    )
    np.testing.assert_allclose(found.distance_mm, [2.0, 1.0, 1.0], atol=LOCATE_MM)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_projection_equals_all_planes(seed: int) -> None:
    """Against the plain solution of p + t d = a + w1 (b - a) + w2 (c - a) for every face."""
    mesh = mixed_sizes(seed) if seed % 2 else terrain(seed, 150, 1.0)
    rng = np.random.default_rng(seed)
    points = rng.uniform(-2, 12, (12, 3)) * [1, 1, 0.3]
    directions = rng.normal(size=(12, 3))
    limit = 4.0
    found = project_along(mesh, points, directions, limit, allow_miss=True)
    a, b, c = np.moveaxis(mesh.corners_mm, 1, 0)
    for k in range(12):
        unit = directions[k] / np.linalg.norm(directions[k])
        matrix = np.stack([b - a, c - a, np.broadcast_to(-unit, a.shape)], axis=2)
        w1, w2, t = np.linalg.solve(matrix, (points[k] - a)[:, :, None])[:, :, 0].T
        inside = (w1 >= -1e-9) & (w2 >= -1e-9) & (w1 + w2 <= 1 + 1e-9) & (np.abs(t) <= limit)
        assert found.hit[k] == inside.any()
        if inside.any():
            nearest = t[inside][np.argmin(np.abs(t[inside]))]
            assert found.distance_mm[k] == pytest.approx(nearest, abs=1e-8)
            there = points[k] + found.distance_mm[k] * unit
            np.testing.assert_allclose(
                found.points[k : k + 1].positions_mm(mesh)[0], there, atol=1e-8
            )
        else:
            assert found.points.faces[k] == -1
            assert np.isinf(found.distance_mm[k])


def test_projection_takes_the_nearer_side_and_crosses_edges() -> None:
    flat = sheet(5, 5)
    both = Mesh(
        np.concatenate([flat.vertices_mm, flat.vertices_mm + np.array([0, 0, 3.0])]),
        np.concatenate([flat.faces, flat.faces + 25]).astype(np.int32),
    )
    points = np.array(
        [[2.0, 2.0, 1.0], [2.5, 2.5, 2.0], [2.0, 1.5, -0.5]]
    )  # vertex, diagonal, edge
    found = project_along(both, points, np.array([0.0, 0.0, -2.0]), 10.0)
    np.testing.assert_allclose(found.distance_mm, [1.0, -1.0, -0.5], atol=LOCATE_MM)
    np.testing.assert_allclose(
        found.points.positions_mm(both)[:, 2], [0.0, 3.0, 0.0], atol=LOCATE_MM
    )


def test_misses_are_named() -> None:
    mesh = sheet(4, 4)
    points = np.array([[1.0, 1.0, 0.5], [8.0, 1.0, 0.5], [1.0, 1.0, 7.0]])
    with pytest.raises(NodesError, match=r"2 of 3 lines meet no surface \(points 1, 2\)") as caught:
        project_along(mesh, points, np.array([0.0, 0.0, 1.0]), 2.0)
    assert caught.value.code == "projection-miss"


def test_bad_input_is_refused() -> None:
    mesh = sheet(3, 3)
    with pytest.raises(NodesError, match="not finite"):
        locate(mesh, np.array([[0.0, np.nan, 0.0]]))
    with pytest.raises(NodesError, match="no length"):
        project_along(mesh, np.zeros((1, 3)), np.zeros((1, 3)), 1.0)
    with pytest.raises(MeshError, match="no faces"):
        locate(Mesh(mesh.vertices_mm, mesh.faces[:0]), np.zeros((1, 3)))
    vertices = mesh.vertices_mm.copy()
    vertices[0] = np.nan
    with pytest.raises(MeshError, match="not finite"):
        locate(Mesh(vertices, mesh.faces), np.zeros((1, 3)))
