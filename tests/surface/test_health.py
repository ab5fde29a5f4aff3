"""The health report against meshes whose faults are counted by construction."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scan_shapes import on_cylinder, on_knee, parameter_mesh, surface_mesh
from scan_zoo import (
    inner_vertex,
    sound_mesh,
    two_pieces,
    unwelded,
    with_bow_tie,
    with_fin,
    with_hole,
    with_needle,
    with_speck,
    with_turned_faces,
)

from kiribench.surface.health import MeshHealth, check_mesh
from kiribench.surface.mesh import Mesh

SOUND = sound_mesh()


def codes(health: MeshHealth) -> list[str]:
    return [fault.code for fault in health.faults]


def test_sound_open_surface() -> None:
    """A cylinder patch: its border and area are those of the facets, close to the arc's."""
    radius, width, height = 57.0, 100.0, 80.0
    mesh = surface_mesh(on_cylinder(radius, width), width, height, 2.0)
    before = mesh.vertices_mm.copy(), mesh.faces.copy()
    health = check_mesh(mesh)
    assert codes(health) == []
    assert health.usable
    assert (health.components, health.borders, health.holes) == (1, 1, 0)
    # Chords are shorter than arcs by (2/57)^2 / 24 = 5e-5 at most.
    assert health.border_perimeter_mm == pytest.approx(2 * (width + height), rel=5.2e-5)
    assert health.area_mm2 == pytest.approx(width * height, rel=5.2e-5)
    assert health.bounds_mm is not None
    assert health.bounds_mm[0][2] == 0.0
    assert health.bounds_mm[1] == pytest.approx(
        (radius * np.sin(width / 2 / radius), radius, height), rel=1e-3
    )
    assert health.edge_mm is not None
    shortest, median, mean, longest = health.edge_mm
    assert shortest <= median <= longest and shortest < mean < longest
    assert np.array_equal(mesh.vertices_mm, before[0])
    assert np.array_equal(mesh.faces, before[1])


def test_edge_statistics_count_every_edge_once() -> None:
    xyz = np.array([[0, 0, 0], [30, 0, 0], [30, 40, 0], [0, 40, 0]], dtype=float)
    health = check_mesh(Mesh(xyz, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))
    assert health.edge_mm == (30.0, 40.0, 38.0, 50.0)  # 30, 40, 50, 30, 40
    assert health.area_mm2 == 1200.0
    assert health.border_perimeter_mm == 140.0


def test_closed_surface_has_no_border() -> None:
    import trimesh

    sphere = trimesh.creation.icosphere(3, 50)
    health = check_mesh(Mesh(np.array(sphere.vertices), sphere.faces.astype(np.int32)))
    assert (health.borders, health.holes, health.border_perimeter_mm) == (0, 0, 0.0)
    assert health.area_mm2 == pytest.approx(sphere.area, rel=1e-12)
    assert codes(health) == []


def test_hole_is_measured() -> None:
    vertex = inner_vertex(SOUND)
    around = SOUND.faces[(SOUND.faces == vertex).any(axis=1)]
    rim = [[v for v in face if v != vertex] for face in around]
    expected = sum(np.linalg.norm(np.subtract(*SOUND.vertices_mm[pair])) for pair in rim)
    health = check_mesh(with_hole(SOUND))
    assert health.holes == 1
    assert health.hole_perimeters_mm[0] == pytest.approx(expected, rel=1e-12)
    assert health.unreferenced_vertices == 1
    assert codes(health) == ["mesh-unreferenced", "mesh-holes"]


@pytest.mark.parametrize("dropped", [1, 7])
def test_duplicates_and_degenerates_are_counted(dropped: int) -> None:
    doubled = SOUND.faces[:dropped][:, [1, 2, 0]]
    turned = SOUND.faces[20:23][:, ::-1]
    folded = SOUND.faces[:dropped][:, [0, 0, 1]]
    mesh = replace(SOUND, faces=np.concatenate([SOUND.faces, doubled, turned, folded]))
    health = check_mesh(mesh)
    assert health.duplicate_faces == dropped + 3
    assert health.degenerate_faces == dropped
    assert health.nonmanifold_edges == 0


def test_needles_count_as_degenerate() -> None:
    assert check_mesh(with_needle(SOUND)).degenerate_faces == 1


def test_unwelded_vertices_are_counted() -> None:
    loose = unwelded(SOUND)
    health = check_mesh(loose)
    used = len(np.unique(SOUND.faces))
    # The scan's corner vertices in one face only are not repeated.
    assert health.unwelded_vertices == len(loose.vertices_mm) - used
    assert health.components == 1
    assert health.borders == 1
    assert codes(health) == ["mesh-unwelded"]


def test_rounding_does_not_keep_vertices_apart() -> None:
    loose = unwelded(SOUND)
    rng = np.random.default_rng(0)
    shaken = replace(
        loose, vertices_mm=loose.vertices_mm + rng.uniform(-1e-4, 1e-4, loose.vertices_mm.shape)
    )
    health = check_mesh(shaken)
    assert health.components == 1
    assert health.unwelded_vertices == check_mesh(loose).unwelded_vertices


def test_pieces_specks_and_bow_ties() -> None:
    assert check_mesh(with_speck(SOUND)).components == 2
    health = check_mesh(two_pieces(SOUND))
    assert health.components == 2
    assert health.borders == 2
    assert health.holes == 0
    assert check_mesh(with_bow_tie(SOUND)).bowtie_vertices == 1


def test_fins_are_counted_and_are_an_error() -> None:
    around = (SOUND.faces == inner_vertex(SOUND)).any(axis=1).sum()
    health = check_mesh(with_fin(SOUND))
    assert health.nonmanifold_edges == around
    assert not health.usable


def test_turned_faces_are_counted_by_edges() -> None:
    mesh = with_turned_faces(SOUND)
    turned = np.zeros(len(mesh.faces), dtype=bool)
    turned[::10] = True
    owner: dict[tuple[int, int], list[int]] = {}
    for face, row in enumerate(mesh.faces.tolist()):
        for a, b in zip(row, row[1:] + row[:1], strict=True):
            owner.setdefault((min(a, b), max(a, b)), []).append(face)
    expected = sum(len(f) == 2 and turned[f[0]] != turned[f[1]] for f in owner.values())
    assert check_mesh(mesh).inconsistent_edges == expected


def test_all_faults_at_once() -> None:
    """One scan with six faults reports six faults."""
    mesh = with_speck(with_bow_tie(with_turned_faces(SOUND)))
    mesh = replace(
        mesh, faces=np.concatenate([mesh.faces, mesh.faces[:2], mesh.faces[:1, [0, 0, 1]]])
    )
    found = set(codes(check_mesh(mesh, file="scan.obj")))
    assert found >= {
        "mesh-duplicate-faces",
        "mesh-degenerate-faces",
        "mesh-specks",
        "mesh-winding",
        "mesh-bow-ties",
        "mesh-holes",
    }


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_hub_of_high_valence_is_no_trap(turns: int) -> None:
    """A fan of 60,000 faces around one vertex: linear time, whatever the vertex order."""
    count = 60_000
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    ring = 50 * np.column_stack([np.cos(angle), np.sin(angle), 0.01 * np.sin(9 * angle)])
    xyz = np.concatenate([[[0.0, 0.0, 10.0]], ring])
    around = 1 + np.arange(count)
    faces = np.column_stack([np.zeros(count, int), around, np.roll(around, -1)])
    mesh = Mesh(xyz, np.roll(faces, turns, axis=1).astype(np.int32))
    start = time.process_time()
    assert check_mesh(mesh).components == 1
    assert time.process_time() - start < 5.0


def test_million_faces_take_less_than_two_seconds() -> None:
    """Measured on 250,000 faces, a quarter of the limit; the loops are linear (see above)."""
    uv, faces = parameter_mesh(130.0, 240.0, 5.0)
    check_mesh(Mesh(on_knee(130, 240)(uv), faces))  # compile
    side = 354
    s, t = np.meshgrid(np.linspace(0, 130, side), np.linspace(0, 240, side), indexing="ij")
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    xyz = on_knee(130, 240)(np.column_stack([s.ravel(), t.ravel()]))
    mesh = Mesh(xyz, np.concatenate(quads).astype(np.int32))
    start = time.process_time()
    assert check_mesh(mesh).components == 1
    assert time.process_time() - start < 0.5 * len(mesh.faces) / 250_000
