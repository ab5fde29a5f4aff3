from __future__ import annotations

import numpy as np
import pytest
from geodesic_oracles import at_vertices, inside_faces, mmp, sheet, terrain, with_points_as_vertices
from tolerances import GEODESIC_MM

from kiribench.surface.geodesic import geodesic_distances, snapped
from kiribench.surface.geodesic_flat import straight_is_shortest
from kiribench.surface.geodesic_kernels import scratch
from kiribench.surface.geodesic_pairs import faces_at
from kiribench.surface.geodesic_strip import shorten, walk_strip
from kiribench.surface.mesh import Mesh, SurfacePoints
from kiribench.surface.topology import topology


def lines(mesh: Mesh, start: SurfacePoints, end: SurfacePoints) -> tuple[np.ndarray, np.ndarray]:
    """Length of each pair's straight line in a strip (nan: none), and whether it is proved."""
    table = topology(mesh)
    xyz, faces, twins = mesh.vertices_mm, table.faces, table.twins
    fans = (table.corner_offsets, table.corners)
    work = scratch(len(faces), len(xyz), 4096)
    sources, targets = snapped(table, start, "source"), snapped(table, end, "target")
    lengths, proved = np.full(len(start), np.nan), np.zeros(len(start), bool)
    places = start.positions_mm(mesh), end.positions_mm(mesh)
    for k in range(len(start)):
        s, t = places[0][k], places[1][k]
        s_held, s_place = faces_at(faces, twins, *fans, sources[0][k], sources[1][k])
        t_held, t_place = faces_at(faces, twins, *fans, targets[0][k], targets[1][k])
        work.target_stamp[t_held] = k + 1
        if (work.target_stamp[s_held] == k + 1).any():
            continue
        count, at = walk_strip(xyz, faces, twins, s, s_held, s_place, t, k + 1, work)
        if count <= 0:
            continue
        count, bends, bound = shorten(xyz, faces, twins, s_place[at], s, t, count, work)
        if bends or count <= 0:
            continue
        lengths[k] = bound
        proved[k] = straight_is_shortest(
            xyz, faces, twins, *fans, s, s_place[at], s_held[at], t, t_held, t_place,
            bound, count, k + 1, work,
        )  # fmt: skip
    return lengths, proved


@pytest.mark.parametrize("height", [0.003, 0.02, 0.1, 0.4])
def test_every_proved_line_equals_mmp(height: float) -> None:
    """From nearly flat, where most lines are proved, to rough, where few may be."""
    proofs = wrong_lines = 0
    for seed in range(3):
        mesh = terrain(seed, 200, height)
        rng = np.random.default_rng(seed)
        free = inside_faces(mesh, 20, rng)
        split, number = with_points_as_vertices(mesh, free)
        vertices = rng.choice(np.unique(mesh.faces), 20, replace=False)
        fixed = at_vertices(mesh, vertices)
        both = SurfacePoints(
            np.concatenate([free.faces, fixed.faces]),
            np.concatenate([free.barycentric, fixed.barycentric]),
        )
        number = np.concatenate([number, vertices])
        one = np.repeat(rng.permutation(40)[:10], 40)
        two = np.tile(np.arange(40), 10)
        lengths, proved = lines(mesh, both[one], both[two])
        exact = mmp(split, number[one], number[two])
        np.testing.assert_allclose(lengths[proved], exact[proved], rtol=0, atol=GEODESIC_MM)
        proofs += int(proved.sum())
        wrong_lines += int((lengths > exact + GEODESIC_MM).sum())
    assert proofs > {0.003: 500, 0.02: 250, 0.1: 60, 0.4: 10}[height]
    if height >= 0.1:
        assert wrong_lines > 0  # lines that only look shortest occur, and none was proved


def test_lines_on_a_plate_are_proved() -> None:
    mesh = sheet(41, 41, 0.25)
    rng = np.random.default_rng(1)
    start, end = inside_faces(mesh, 60, rng), inside_faces(mesh, 60, rng)
    lengths, proved = lines(mesh, start, end)
    gap = np.linalg.norm(start.positions_mm(mesh) - end.positions_mm(mesh), axis=1)
    found = np.isfinite(lengths)
    assert found.sum() > 50
    np.testing.assert_allclose(lengths[found], gap[found], rtol=0, atol=GEODESIC_MM)
    assert proved[found].all()


def test_a_shorter_way_over_another_sheet_is_not_overlooked() -> None:
    """A bent sheet, and a plank that touches it at its two ends only, at one vertex each."""
    bent = sheet(41, 41, 0.25)
    x = bent.vertices_mm[:, 0]
    vertices = np.column_stack([bent.vertices_mm[:, :2], 0.05 * x * (10.0 - x)])
    a, b = 4 * 41 + 20, 36 * 41 + 20
    n = len(vertices)
    plank = np.array([[5.0, 4.9, vertices[a, 2]], [5.0, 5.1, vertices[a, 2]]])
    more = np.array([[a, n, n + 1], [b, n + 1, n]], np.int32)
    mesh = Mesh(np.concatenate([vertices, plank]), np.concatenate([bent.faces, more]))
    first = np.flatnonzero((bent.faces == a).any(axis=1))[:1]
    last = np.flatnonzero((bent.faces == b).any(axis=1))[:1]
    start = SurfacePoints(first.astype(np.int32), (mesh.faces[first] == a).astype(float))
    end = SurfacePoints(last.astype(np.int32), (mesh.faces[last] == b).astype(float))
    alone, without = lines(Mesh(vertices, bent.faces), start, end)
    assert alone[0] > 8.0 + 0.1
    assert without.all()
    assert not lines(mesh, start, end)[1].any()
    length = geodesic_distances(mesh, start, end)[0]
    assert length == pytest.approx(8.0, abs=GEODESIC_MM)


def test_a_cylinder_is_proved_although_it_is_curved() -> None:
    flat = sheet(60, 60, 0.5)
    angle = flat.vertices_mm[:, 0] / 20.0
    vertices = np.column_stack([20 * np.sin(angle), flat.vertices_mm[:, 1], 20 * np.cos(angle)])
    mesh = Mesh(vertices, flat.faces)
    rng = np.random.default_rng(0)
    start, end = inside_faces(mesh, 60, rng), inside_faces(mesh, 60, rng)
    lengths, proved = lines(mesh, start, end)
    assert proved[np.isfinite(lengths)].mean() > 0.9
