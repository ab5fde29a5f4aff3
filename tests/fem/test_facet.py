"""Facet meshes: valid, conforming, graded, for every design of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.fem.facet import FacetMesh, MeshSpec, mesh_facet

LEVELS = [0.01, 0.05, 0.35, 0.5, 0.65, 0.95, 0.99]


def _areas(mesh: FacetMesh) -> np.ndarray:
    corners = mesh.points[mesh.triangles[:, :3]]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])


@pytest.mark.parametrize("a", LEVELS)
@pytest.mark.parametrize("b", LEVELS)
def test_triangles_fill_the_square_once(a: float, b: float) -> None:
    mesh = mesh_facet((a, b, a, b), MeshSpec())
    areas = _areas(mesh)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(1.0, abs=1e-12)
    assert len(np.unique(np.round(mesh.points, 12), axis=0)) == len(mesh.points)
    sides = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, count = np.unique(sides, axis=0, return_counts=True)
    outline = sum((len(edge) - 1) // 2 for edge in mesh.edges)
    assert count.max() == 2
    assert (count == 1).sum() == outline


@pytest.mark.parametrize("cuts", [(0.35, 0.85, 0.6, 0.2), (0.9, 0.9, 0.9, 0.9), (0.0, 0.4, 0, 0.4)])
def test_tips_are_nodes_and_edges_are_walked_in_order(cuts: tuple[float, ...]) -> None:
    mesh = mesh_facet((cuts[0], cuts[1], cuts[2], cuts[3]), MeshSpec())
    starts = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    for edge, cut in enumerate(cuts):
        start, end = starts[edge], starts[(edge + 1) % 4]
        along = (mesh.points[mesh.edges[edge]] - start) @ (end - start)
        assert np.all(np.diff(along) > 0)
        assert along[0] == 0
        assert along[-1] == 1
        if cut > 0:
            tip = mesh.points[mesh.ligament(edge)[0]]
            np.testing.assert_allclose(tip, start + cut * (end - start), atol=1e-14)
            assert mesh.cut_face(edge)[-1] == mesh.ligament(edge)[0]
        else:
            assert len(mesh.cut_face(edge)) == 0


def test_ligament_nodes_depend_on_their_own_cut_alone() -> None:
    one = mesh_facet((0.35, 0.85, 0.6, 0.2), MeshSpec())
    two = mesh_facet((0.35, 0.10, 0.9, 0.99), MeshSpec())
    np.testing.assert_array_equal(one.points[one.ligament(0)], two.points[two.ligament(0)])


def test_quarter_points_at_wide_ligaments_only() -> None:
    for cut, part in ((0.5, 0.25), (0.95, 0.5)):
        mesh = mesh_facet((cut, cut, cut, cut), MeshSpec())
        tip, middle, corner = mesh.points[mesh.ligament(0)[:3]]
        assert np.linalg.norm(middle - tip) / np.linalg.norm(corner - tip) == pytest.approx(part)


def test_finer_specs_have_more_nodes_and_finer_tips() -> None:
    counts = [
        len(mesh_facet((0.6, 0.7, 0.6, 0.7), MeshSpec().scaled(factor)).points)
        for factor in (1.6, 1.0, 0.6, 0.3)
    ]
    assert counts == sorted(counts)
    assert counts[-1] > 4 * counts[0]
    assert MeshSpec.of_edge(2.5, 10.0) == MeshSpec()


@pytest.mark.parametrize("wrong", [(0.0, 0.5, 0.3), (0.5, -1.0, 0.3), (0.5, 0.5, 2.0)])
def test_senseless_specs_are_refused(wrong: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="a mesh needs"):
        MeshSpec(*wrong)
