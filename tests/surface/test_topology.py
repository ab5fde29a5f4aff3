from __future__ import annotations

import numpy as np
import pytest
from geodesic_oracles import polyhedron, sheet, terrain

from kiribench.errors import MeshError
from kiribench.surface.mesh import Mesh
from kiribench.surface.topology import topology


def by_dictionary(faces: np.ndarray) -> np.ndarray:
    """Neighbours the slow, plain way."""
    sides: dict[frozenset[int], list[tuple[int, int]]] = {}
    for f, face in enumerate(faces):
        for i in range(3):
            sides.setdefault(frozenset((int(face[i]), int(face[(i + 1) % 3]))), []).append((f, i))
    out = np.full((len(faces), 3), -1)
    for pair in sides.values():
        if len(pair) == 2:
            (f, i), (g, j) = pair
            out[f, i], out[g, j] = g, f
    return out


@pytest.mark.parametrize("seed", range(5))
def test_neighbours_equal_a_plain_search(seed: int) -> None:
    for mesh in (terrain(seed, 200, 1.0), polyhedron(seed, 100, (1.0, 1.0, 1.0))):
        rng = np.random.default_rng(seed)
        kept = mesh.faces[rng.random(len(mesh.faces)) < 0.8]  # ragged, with pinched vertices
        for faces in (mesh.faces, kept):
            table = topology(Mesh(mesh.vertices_mm, np.ascontiguousarray(faces)))
            np.testing.assert_array_equal(table.neighbours, by_dictionary(faces))


def test_twins_run_the_other_way() -> None:
    mesh = terrain(1, 100, 1.0)
    table = topology(mesh)
    halves = np.flatnonzero(table.twins.ravel() >= 0)
    twin = table.twins.ravel()[halves]
    np.testing.assert_array_equal(table.twins.ravel()[twin], halves)
    start = table.faces.ravel()
    end = table.faces[:, [1, 2, 0]].ravel()
    np.testing.assert_array_equal(start[halves], end[twin])
    np.testing.assert_array_equal(end[halves], start[twin])


def test_corners_are_grouped_by_vertex() -> None:
    mesh = terrain(2, 80, 1.0)
    table = topology(mesh)
    for v in range(len(mesh.vertices_mm)):
        group = table.corners[table.corner_offsets[v] : table.corner_offsets[v + 1]]
        np.testing.assert_array_equal(np.sort(group), np.flatnonzero(mesh.faces.ravel() == v))


def test_a_fan_of_many_faces() -> None:
    n = 500
    angle = 2 * np.pi * np.arange(n) / n
    vertices = np.concatenate([np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1), [[0, 0, 1]]])
    index = np.random.default_rng(0).permutation(n).astype(np.int32)
    faces = np.stack([np.full(n, n, np.int32), index, (index + 1) % n], 1).astype(np.int32)
    table = topology(Mesh(vertices, faces))
    np.testing.assert_array_equal(table.neighbours, by_dictionary(faces))


def test_mixed_winding_is_turned_in_the_tables_only() -> None:
    mesh = polyhedron(0, 80, (1.0, 1.0, 1.0))
    some = np.random.default_rng(0).random(len(mesh.faces)) < 0.5
    mixed = np.where(some[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
    table = topology(Mesh(mesh.vertices_mm, np.ascontiguousarray(mixed)))
    agree = table.reversed_faces == some
    assert agree.all() or not agree.any()
    np.testing.assert_array_equal(table.neighbours, by_dictionary(mixed))
    assert (table.twins >= 0).all()


def test_components_join_at_vertices() -> None:
    vertices = np.zeros((9, 3))
    vertices[:, 0] = np.arange(9)
    vertices[:, 1] = np.arange(9) ** 2
    faces = np.array([[0, 1, 2], [2, 3, 4], [5, 6, 7]], np.int32)
    piece = topology(Mesh(vertices, faces)).components
    assert piece[0] == piece[1] != piece[2]


def moebius() -> Mesh:
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1) * 10
    out = np.stack(
        [np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], 1
    )
    vertices = np.concatenate([ring - 2 * out, ring + 2 * out])
    faces = []
    for i in range(n):
        a, b, c, d = i, i + n, (i + 1) % n, (i + 1) % n + n
        if i == n - 1:
            c, d = d, c
        faces += [[a, c, d], [a, d, b]]
    return Mesh(vertices, np.array(faces, np.int32))


def broken(name: str) -> Mesh:
    good = sheet(4, 4)
    vertices, faces = good.vertices_mm.copy(), good.faces.copy()
    if name == "mesh-empty":
        faces = faces[:0]
    elif name == "mesh-index-range":
        faces[3, 1] = 16
    elif name == "mesh-nan-vertex":
        vertices[5, 2] = np.inf
    elif name == "mesh-degenerate-face":
        faces[2] = [0, 0, 5]
    elif name == "mesh-zero-edge":
        vertices[5] = vertices[6]
    elif name == "mesh-nonmanifold-edge":
        vertices = np.concatenate([vertices, [[0.5, 0.5, 3.0]]])
        faces = np.concatenate([faces, [[0, 5, 16]]]).astype(np.int32)
    elif name == "mesh-one-sided":
        return moebius()
    return Mesh(vertices, faces)


@pytest.mark.parametrize(
    "name",
    [
        "mesh-empty",
        "mesh-index-range",
        "mesh-nan-vertex",
        "mesh-degenerate-face",
        "mesh-zero-edge",
        "mesh-nonmanifold-edge",
        "mesh-one-sided",
    ],
)
def test_broken_meshes_are_refused_by_name(name: str) -> None:
    with pytest.raises(MeshError) as caught:
        topology(broken(name))
    assert name in {fault.code for fault in caught.value.faults}
    assert all(fault.remedy for fault in caught.value.faults)
