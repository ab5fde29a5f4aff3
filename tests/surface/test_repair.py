"""Repair: what is mended equals the sound mesh, points go with it, the rest is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scan_shapes import on_knee, surface_mesh
from scan_zoo import (
    _stacked,
    inner_vertex,
    sound_mesh,
    two_pieces,
    unwelded,
    with_bow_tie,
    with_fin,
    with_needle,
    with_speck,
    with_turned_faces,
)

from kiribench.errors import MeshError
from kiribench.surface.geodesic import geodesic_distances
from kiribench.surface.mesh import Mesh, SurfacePoints
from kiribench.surface.repair import Repaired, repair_mesh
from kiribench.surface.topology import topology

SOUND = sound_mesh()


def random_points(mesh: Mesh, count: int, seed: int) -> SurfacePoints:
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, len(mesh.faces), count).astype(np.int32)
    return SurfacePoints(faces, rng.dirichlet((1.0, 1.0, 1.0), count))


def assert_maps_are_right(mesh: Mesh, repaired: Repaired) -> None:
    """Vertices and carried points lie where they lay."""
    now = repaired.mesh
    assert np.array_equal(now.vertices_mm, mesh.vertices_mm[repaired.vertex_map])
    points = random_points(mesh, 500, 1)
    carried, good = repaired.carry(points)
    before, after = points.positions_mm(mesh), carried.positions_mm(now)
    # Welding may move a corner by less than a thousandth of an edge.
    assert np.abs(before - after)[good].max() < 1e-2
    assert np.allclose(carried.barycentric.sum(axis=1), 1.0)


def test_sound_mesh_is_returned_itself() -> None:
    repaired = repair_mesh(SOUND)
    assert repaired.mesh is SOUND
    assert repaired.unchanged
    assert_maps_are_right(SOUND, repaired)


def test_welding_restores_the_connectivity() -> None:
    loose = unwelded(SOUND)
    repaired = repair_mesh(loose)
    assert len(repaired.mesh.vertices_mm) == len(np.unique(SOUND.faces))
    assert np.array_equal(repaired.mesh.corners_mm, SOUND.corners_mm)
    _, good = repaired.carry(random_points(loose, 99, 0))
    assert good.all()
    assert_maps_are_right(loose, repaired)
    # What an unwelded mesh does to a path: none is found. Welded, it has the sound length.
    ends = random_points(SOUND, 2, 5)
    first, second = ends[0:1], ends[1:2]
    right = geodesic_distances(SOUND, first, second)
    assert geodesic_distances(repaired.mesh, first, second) == pytest.approx(right, rel=1e-12)


def test_winding_is_made_that_of_the_majority() -> None:
    mesh = with_turned_faces(SOUND)
    repaired = repair_mesh(mesh)
    sign = np.einsum("ij,ij->i", repaired.mesh.face_normals, SOUND.face_normals)
    assert (sign > 0.99).all()
    turned = (len(SOUND.faces) + 9) // 10
    assert repaired.actions[0].startswith(f"{turned} of {len(SOUND.faces)} faces")
    assert_maps_are_right(mesh, repaired)


def test_inside_out_is_turned() -> None:
    mesh = replace(SOUND, faces=np.ascontiguousarray(SOUND.faces[:, ::-1]))
    repaired = repair_mesh(mesh)
    assert np.allclose(repaired.mesh.face_normals, SOUND.face_normals)
    assert_maps_are_right(mesh, repaired)


@pytest.mark.parametrize("mirror", [1, -1])
def test_saddle_and_plane_keep_their_winding(mirror: int) -> None:
    """Where outside cannot be told, nothing is turned."""
    mesh = surface_mesh(
        lambda uv: np.column_stack(
            [uv[:, 0] * mirror, uv[:, 1], (uv[:, 0] - 50) * (uv[:, 1] - 50) / 100]
        ),
        100,
        100,
        5,
    )
    assert repair_mesh(mesh).unchanged


def test_duplicates_are_carried_to_their_twins() -> None:
    faces = np.concatenate([SOUND.faces[5:9][:, [2, 0, 1]], SOUND.faces])
    mesh = replace(SOUND, faces=faces)
    repaired = repair_mesh(mesh)
    assert len(repaired.mesh.faces) == len(SOUND.faces)
    _, good = repaired.carry(random_points(mesh, 500, 2))
    assert good.all()
    assert_maps_are_right(mesh, repaired)


def test_speck_is_dropped_and_its_points_are_not_carried() -> None:
    mesh = with_speck(SOUND)
    repaired = repair_mesh(mesh)
    assert np.array_equal(repaired.mesh.faces, SOUND.faces)
    on_speck = SurfacePoints(
        np.array([len(mesh.faces) - 1], dtype=np.int32), np.full((1, 3), 1 / 3)
    )
    assert not repaired.carry(on_speck)[1].any()


def test_large_pieces_stay() -> None:
    mesh = two_pieces(SOUND)
    assert len(repair_mesh(mesh).mesh.faces) == 2 * len(SOUND.faces)


def test_bow_tie_is_parted_without_moving_anything() -> None:
    mesh = with_bow_tie(SOUND)
    repaired = repair_mesh(mesh)
    assert np.array_equal(repaired.mesh.corners_mm, mesh.corners_mm)
    used = len(np.unique(mesh.faces))
    assert len(repaired.mesh.vertices_mm) == used + 1
    topology(repaired.mesh)  # accepts no bow-tie, no three-face edge, no mixed winding
    assert_maps_are_right(mesh, repaired)


def test_flat_face_is_flipped_away_and_paths_stay() -> None:
    """A path across a face without area has the length on the sound mesh."""
    mesh = with_needle(SOUND)
    repaired = repair_mesh(mesh)
    assert repaired.mesh.face_areas_mm2.min() > 1e-3
    assert repaired.mesh.face_areas_mm2.sum() == pytest.approx(
        SOUND.face_areas_mm2.sum(), rel=1e-12
    )
    topology(repaired.mesh)
    points = random_points(mesh, 40, 3)
    _, good = repaired.carry(points)
    assert 0.9 < good.mean() <= 1.0
    assert_maps_are_right(mesh, repaired)


def test_short_side_is_collapsed() -> None:
    """A vertex doubled a nanometre away makes two needles; both go, nothing opens."""
    vertex = inner_vertex(SOUND)
    around = np.flatnonzero((SOUND.faces == vertex).any(axis=1))
    # Half of the fan moves to the copy; two needles fill the slit.
    ring = {f: [v for v in SOUND.faces[f] if v != vertex] for f in around}
    start = ring[around[0]][0]
    half, reached = [], start
    for _ in range(len(around) // 2):
        face = next(f for f in around if reached in ring[f] and f not in half)
        half.append(face)
        reached = next(v for v in ring[face] if v != reached)
    copy = len(SOUND.vertices_mm)
    faces = SOUND.faces.copy()
    for face in half:
        faces[face][faces[face] == vertex] = copy
    split = _stacked(
        replace(SOUND, faces=faces),
        SOUND.vertices_mm[vertex] + [1e-9, 0, 0],
        [[start, vertex, copy], [reached, copy, vertex]],
    )
    repaired = repair_mesh(split)
    assert len(repaired.mesh.faces) == len(SOUND.faces)
    assert len(repaired.mesh.vertices_mm) == len(SOUND.vertices_mm)


def test_texture_goes_with_the_faces() -> None:
    rng = np.random.default_rng(0)
    uv = rng.random((len(SOUND.vertices_mm), 2))
    mesh = with_turned_faces(replace(SOUND, uv=uv, face_uv=SOUND.faces))
    mesh = replace(mesh, face_uv=mesh.faces, colours=(255 * uv[:, [0, 1, 0]]).astype(np.uint8))
    mesh = replace(mesh, faces=mesh.faces[3:], face_uv=mesh.face_uv[3:])
    repaired = repair_mesh(mesh).mesh
    assert repaired.uv is not None and repaired.face_uv is not None
    assert repaired.colours is not None and mesh.colours is not None
    # Every corner still has the texture of its vertex.
    position = {tuple(x): tuple(t) for x, t in zip(SOUND.vertices_mm, uv, strict=True)}
    for face, corners in zip(repaired.faces[:200], repaired.face_uv[:200], strict=True):
        for v, t in zip(face, corners, strict=True):
            assert position[tuple(repaired.vertices_mm[v])] == tuple(repaired.uv[t])


def test_texture_of_a_flipped_face_is_interpolated() -> None:
    linear = SOUND.vertices_mm[:, [0, 2]] / 200
    mesh = with_needle(SOUND)
    uv = np.concatenate([linear, mesh.vertices_mm[-1:, [0, 2]] / 200])
    repaired = repair_mesh(replace(mesh, uv=uv, face_uv=mesh.faces)).mesh
    assert repaired.uv is not None and repaired.face_uv is not None
    got = repaired.uv[repaired.face_uv]
    assert np.allclose(got, repaired.corners_mm[:, :, [0, 2]] / 200, atol=1e-12)


def test_refusals_name_every_error() -> None:
    with pytest.raises(MeshError) as caught:
        repair_mesh(with_fin(SOUND), file="sub-S1/scan.obj")
    fault = caught.value.faults[0]
    assert fault.code == "mesh-nonmanifold"
    assert fault.file == "sub-S1/scan.obj"
    assert "mm" in fault.what


def test_nan_never_reaches_a_geodesic() -> None:
    xyz = SOUND.vertices_mm.copy()
    xyz[inner_vertex(SOUND)] = np.nan
    with pytest.raises(MeshError, match="mesh-nan-vertex"):
        repair_mesh(replace(SOUND, vertices_mm=xyz))


def test_everything_at_once_becomes_the_sound_surface() -> None:
    mesh = surface_mesh(on_knee(110, 150), 110, 150, 8.0, seed=1)
    broken = with_speck(with_turned_faces(mesh))
    broken = unwelded(broken)
    broken = replace(
        broken, faces=np.concatenate([broken.faces, broken.faces[:4], broken.faces[:2, [0, 0, 1]]])
    )
    repaired = repair_mesh(broken)
    assert len(repaired.actions) == 5
    key = lambda m: sorted(map(tuple, np.sort(m.corners_mm.round(9).reshape(len(m.faces), -1), 1)))  # noqa: E731
    assert key(repaired.mesh) == key(mesh)
    topology(repaired.mesh)
