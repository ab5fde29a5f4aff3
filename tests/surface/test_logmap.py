from __future__ import annotations

import numpy as np
import pytest
from geodesic_oracles import BENCHMARK, at_vertices, inside_faces, read_obj, sheet, terrain
from tolerances import GEODESIC_MM

from kiribench.errors import NodesError
from kiribench.surface.geodesic import geodesic_distances
from kiribench.surface.logmap import log_map, tangent_frame
from kiribench.surface.mesh import Mesh, SurfacePoints


def one(face: int, weights: list[float]) -> SurfacePoints:
    return SurfacePoints(np.array([face], np.int32), np.array([weights]))


def bent(mesh: Mesh, angle: float) -> Mesh:
    """The half x > 2 of a sheet turned up about the line x = 2."""
    over = np.maximum(mesh.vertices_mm[:, 0] - 2.0, 0.0)
    x = np.minimum(mesh.vertices_mm[:, 0], 2.0) + over * np.cos(angle)
    return Mesh(np.stack([x, mesh.vertices_mm[:, 1], over * np.sin(angle)], axis=1), mesh.faces)


CENTRES = {"inside": [0.2, 0.3, 0.5], "edge": [0.4, 0.6, 0.0], "vertex": [1.0, 0.0, 0.0]}


@pytest.mark.parametrize("where", sorted(CENTRES))
def test_flat_surface_is_its_own_map(where: str) -> None:
    mesh = sheet(6, 6)
    centre = one(21, CENTRES[where])
    points = inside_faces(mesh, 40, np.random.default_rng(0))
    flat = log_map(mesh, centre, points, x_hint_mm=[1.0, 0.0, 0.0])
    expected = points.positions_mm(mesh) - centre.positions_mm(mesh)
    np.testing.assert_allclose(flat, expected[:, :2], rtol=0, atol=GEODESIC_MM)


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0])
def test_a_folded_sheet_unfolds_from_a_centre_on_the_fold(angle: float) -> None:
    flat_mesh = sheet(5, 5)
    mesh = bent(flat_mesh, angle)
    points = inside_faces(mesh, 30, np.random.default_rng(1))
    on_fold = np.flatnonzero(np.ptp(flat_mesh.corners_mm[:, :, 0], axis=1) == 1.0)
    for face in on_fold:
        at_fold = flat_mesh.corners_mm[face][:, 0] == 2.0
        if at_fold.sum() == 2 and flat_mesh.corners_mm[face][:, 0].min() == 1.0:
            weights = np.where(at_fold, 0.5, 0.0)
            break
    for chosen in (weights, at_fold / 1.0 * (np.cumsum(at_fold) == 1)):  # edge, then a vertex
        centre = one(int(face), chosen.tolist())
        flat = log_map(mesh, centre, points, x_hint_mm=[1.0, 0.0, 0.0])
        expected = points.positions_mm(flat_mesh) - centre.positions_mm(flat_mesh)
        np.testing.assert_allclose(flat, expected[:, :2], rtol=0, atol=GEODESIC_MM)


def test_lengths_are_geodesic_distances() -> None:
    mesh = terrain(2, 200, 1.0)
    rng = np.random.default_rng(0)
    points = inside_faces(mesh, 30, rng)
    for centre in (one(50, CENTRES["inside"]), one(50, CENTRES["edge"]), one(50, [0, 1.0, 0])):
        flat = log_map(mesh, centre, points)
        repeated = centre[np.zeros(len(points), np.intp)]
        exact = geodesic_distances(mesh, repeated, points)
        np.testing.assert_allclose(np.linalg.norm(flat, axis=1), exact, rtol=0, atol=GEODESIC_MM)


def test_angles_at_a_cone_tip_are_scaled_to_a_full_turn() -> None:
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    index = np.arange(n, dtype=np.int32)
    faces = np.stack([np.full(n, n, np.int32), index, (index + 1) % n], 1).astype(np.int32)
    mesh = Mesh(np.concatenate([rim, [[0.0, 0, 1]]]), faces)
    flat = log_map(
        mesh, one(0, [1.0, 0.0, 0.0]), at_vertices(mesh, index), x_hint_mm=rim[0] - [0, 0, 1]
    )
    np.testing.assert_allclose(np.linalg.norm(flat, axis=1), np.sqrt(2), atol=GEODESIC_MM)
    turned = np.unwrap(np.arctan2(flat[:, 1], flat[:, 0]))
    np.testing.assert_allclose(turned, angle, atol=1e-12)


def test_sphere_directions_and_lengths() -> None:
    """Near the centre the map is the sphere's: great circles at their azimuth."""
    mesh = read_obj(BENCHMARK / "sphere_R50.obj")
    centre = one(100, [0.3, 0.3, 0.4])
    p = centre.positions_mm(mesh)[0]
    frame = tangent_frame(mesh, centre, [0.3, 1.0, 0.2])
    points = at_vertices(mesh, np.arange(0, len(mesh.vertices_mm), 25))
    q = points.positions_mm(mesh)
    flat = log_map(mesh, centre, points, x_hint_mm=[0.3, 1.0, 0.2])
    arc = 50 * np.arccos(np.clip(q @ p / 50 / np.linalg.norm(p), -1, 1))
    near = arc < 60
    np.testing.assert_allclose(np.linalg.norm(flat, axis=1)[near], arc[near], rtol=3e-3)
    azimuth = np.arctan2(q @ frame[1], q @ frame[0])
    difference = np.angle(np.exp(1j * (np.arctan2(flat[:, 1], flat[:, 0]) - azimuth)))
    assert np.abs(difference[near]).max() < 0.04  # rad: facets of 2 degrees about the centre


def test_tangent_frame() -> None:
    mesh = terrain(1, 60, 1.0)
    frame = tangent_frame(mesh, one(7, CENTRES["inside"]), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    np.testing.assert_allclose(frame[2], mesh.face_normals[7], atol=1e-14)
    assert frame[0] @ [1.0, 2.0, 3.0] > 0
    with pytest.raises(NodesError, match="x axis"):
        tangent_frame(mesh, one(7, CENTRES["inside"]), 2.0 * mesh.face_normals[7])


def test_one_centre_only() -> None:
    mesh = sheet(3, 3)
    with pytest.raises(ValueError, match="one centre"):
        log_map(mesh, at_vertices(mesh, np.array([0, 1])), at_vertices(mesh, np.array([2])))
