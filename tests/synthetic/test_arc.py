"""Geodesics by boundary value problems against great circles, helices, planes and meshes."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import cylinder, plane, sphere
from tolerances import GEODESIC_BVP_MM, MESH_ORDER

from kiribench.errors import NotConvergedError
from kiribench.schema.layout import Layout
from kiribench.synthetic.arc import geodesic_arcs
from kiribench.synthetic.knees import STORED
from kiribench.synthetic.smooth import SmoothSurface
from kiribench.synthetic.subject import grid_nodes


def _pairs(spread: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    start = rng.uniform(-spread, spread, (200, 2))
    return start, start + rng.uniform(-reach, reach, (200, 2))


def test_great_circles() -> None:
    radius = 30.0
    surface, (start, end) = sphere(radius), _pairs(18.0, 12.0)
    a, b = surface.points_mm(start), surface.points_mm(end)
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    expected = radius * np.arctan2(sine, np.einsum("ij,ij->i", a, b))
    arcs = geodesic_arcs(surface, start, end)
    np.testing.assert_allclose(arcs.length_mm, expected, atol=GEODESIC_BVP_MM)
    # Every point of the path lies in the plane of the great circle.
    pole = np.cross(a, b) / sine[:, None]
    off_plane = np.einsum("kx,knx->kn", pole, surface.points_mm(arcs.sampled(20)))
    assert np.abs(off_plane).max() < 10 * GEODESIC_BVP_MM


def test_helices() -> None:
    start, end = _pairs(40.0, 15.0)
    arcs = geodesic_arcs(cylinder(50.0, 1.2, 0.9), start, end)
    expected = np.hypot(1.2 * (end - start)[:, 0], 0.9 * (end - start)[:, 1])
    np.testing.assert_allclose(arcs.length_mm, expected, atol=GEODESIC_BVP_MM)


def test_straight_lines_of_a_plane_in_curved_coordinates() -> None:
    surface, (start, end) = plane(), _pairs(40.0, 12.0)
    expected = np.linalg.norm(surface.points_mm(end) - surface.points_mm(start), axis=1)
    arcs = geodesic_arcs(surface, start, end)
    np.testing.assert_allclose(arcs.length_mm, expected, atol=GEODESIC_BVP_MM)


@pytest.mark.parametrize("name", STORED)
def test_more_collocation_points_change_no_length_on_the_knees(name: str) -> None:
    nodes = grid_nodes(Layout.of())
    start, end = nodes[:-1].reshape(-1, 2), nodes[1:].reshape(-1, 2)
    surface = STORED[name].build.flexed()
    coarse = geodesic_arcs(surface, start, end).length_mm
    fine = geodesic_arcs(surface, start, end, points=28).length_mm
    np.testing.assert_allclose(coarse, fine, atol=GEODESIC_BVP_MM)


def _mesh_distance(surface: SmoothSurface, start: np.ndarray, end: np.ndarray, n: int) -> float:
    """MMP's exact distance on a mesh whose vertices include both points."""
    import pygeodesic.geodesic

    line = np.linspace(-0.5, 1.5, 2 * n + 1)
    direction = end - start
    across = np.array([-direction[1], direction[0]])
    s, t = np.meshgrid(line, np.linspace(-0.5, 0.5, n + 1), indexing="ij")
    vertices = surface.points_mm(start + s[..., None] * direction + t[..., None] * across)
    index = np.arange(s.size).reshape(s.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    solver = pygeodesic.geodesic.PyGeodesicAlgorithmExact(vertices.reshape(-1, 3), faces)
    distance, _ = solver.geodesicDistance(
        int(index[n // 2, n // 2]), int(index[-1 - n // 2, n // 2])
    )
    return float(distance)


def test_exact_distances_on_finer_meshes_converge_to_it_at_second_order() -> None:
    # Over the patella of the bent slim knee, where the curvature is largest.
    surface = STORED["S1"].build.flexed()
    start = np.array([[-15.0, -7.5], [0.0, -15.0], [7.5, 0.0], [-7.5, 0.0]])
    end = np.array([[0.0, 7.5], [0.0, 0.0], [-7.5, 15.0], [7.5, -7.5]])
    truth = geodesic_arcs(surface, start, end).length_mm
    pieces = (8, 16, 32)
    errors = [
        np.array([_mesh_distance(surface, *pair, n) for pair in zip(start, end, strict=True)])
        / truth
        - 1.0
        for n in pieces
    ]
    sizes = [np.sqrt(np.mean(error**2)) for error in errors]
    order = -np.polyfit(np.log(pieces), np.log(sizes), 1)[0]
    assert order == pytest.approx(2.0, abs=MESH_ORDER)
    # A mesh inscribed in a bump is shorter; what is left at the end goes on to vanish.
    assert sizes[-1] < 1e-4


def test_an_arc_round_half_the_globe_is_refused() -> None:
    with pytest.raises(NotConvergedError, match="geodesic-not-converged"):
        geodesic_arcs(sphere(10.0), np.array([[-14.0, 10.0]]), np.array([[14.0, 11.0]]))
