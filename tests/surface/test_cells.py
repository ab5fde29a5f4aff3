"""Cells flattened about their centres: distances, areas, curvature."""

from __future__ import annotations

import numpy as np
import pytest
from curved_surfaces import (
    Map,
    cell,
    cylinder_map,
    grid_uv,
    nodes_on,
    patch_mesh,
    sphere_map,
    spherical_overlap,
)
from tolerances import CURVATURE, FLAT_AREA

from kiribench.conformability.outlines import PIECES, flat_outlines
from kiribench.strain.gradient import signed_area
from kiribench.surface.cells import (
    cell_frames,
    equal_area,
    flat_corners,
    gauss_curvature,
    grid_sides,
)
from kiribench.surface.topology import topology


def corners_and_sides(surface: Map) -> tuple[np.ndarray, np.ndarray]:
    """Flattened corners of the middle cell of 3 x 3 and the lengths of its sides."""
    mesh = patch_mesh(surface, (30.0, 30.0), 0.8)
    nodes, table = nodes_on(mesh, surface(grid_uv(3, 3))), topology(mesh)
    sides = grid_sides(mesh, nodes, table)
    flat = flat_corners(mesh, nodes, cell_frames(mesh, nodes, table), table)[1, 1]
    lengths = np.array(
        [
            sides.lateral_mm[1, 1],
            sides.longitudinal_mm[1, 2],
            sides.lateral_mm[2, 1],
            sides.longitudinal_mm[1, 1],
        ]
    )
    return flat, lengths


@pytest.mark.parametrize("radius", [25.0, 40.0, 60.0])
def test_curvature_of_a_sphere(radius: float) -> None:
    found = gauss_curvature(*corners_and_sides(sphere_map(radius)))
    # The next term of the series: 2.6 % at R = 25 mm and half a diagonal of 10.6 mm.
    assert float(found) * radius**2 == pytest.approx(1.0, abs=CURVATURE)


def test_a_cylinder_has_none() -> None:
    found = gauss_curvature(*corners_and_sides(cylinder_map(25.0)))
    assert abs(float(found)) * 25.0**2 < 1e-3


def test_equal_area_is_lamberts_projection() -> None:
    # A cap of a sphere within geodesic radius r has the area 2 pi R^2 (1 - cos(r / R)).
    radius, r = 25.0, np.array([5.0, 10.0, 20.0])
    flat = np.stack([r * np.cos(0.7), r * np.sin(0.7)], axis=-1)
    kept = equal_area(flat, np.array(1.0 / radius**2))
    area = np.pi * (kept**2).sum(axis=-1)
    np.testing.assert_allclose(area, 2.0 * np.pi * radius**2 * (1.0 - np.cos(r / radius)))
    np.testing.assert_allclose(kept[:, 1] / kept[:, 0], np.tan(0.7))


def test_equal_area_on_a_saddle_and_on_a_plane() -> None:
    # A disc of the hyperbolic plane of curvature -1 / R^2: 2 pi R^2 (cosh(r / R) - 1).
    radius, r = 25.0, np.array([5.0, 10.0, 20.0])
    flat = np.stack([r, np.zeros(3)], axis=-1)
    kept = equal_area(flat, np.array(-1.0 / radius**2))
    area = np.pi * (kept**2).sum(axis=-1)
    np.testing.assert_allclose(area, 2.0 * np.pi * radius**2 * (np.cosh(r / radius) - 1.0))
    np.testing.assert_array_equal(equal_area(flat, np.array(0.0)), flat)
    np.testing.assert_array_equal(equal_area(np.zeros((1, 2)), np.array(1e-3)), np.zeros((1, 2)))


@pytest.mark.parametrize("radius", [25.0, 60.0])
def test_cell_areas_on_a_sphere(radius: float) -> None:
    surface = sphere_map(radius)
    mesh = patch_mesh(surface, (33.0, 33.0), 0.8)
    positions = surface(grid_uv(3, 3))
    nodes = nodes_on(mesh, positions)
    outlines = flat_outlines(mesh, nodes, nodes, topology(mesh))
    x, y = np.moveaxis(outlines.skin, -1, 0)
    area = 0.5 * np.abs((x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1)).sum(axis=-1))
    for r in range(3):
        for c in range(3):
            corners = cell(positions, r, c) / radius
            true = spherical_overlap(corners, corners)[0] * radius**2
            assert float(area[r, c]) == pytest.approx(true, rel=FLAT_AREA)
    # The frame: first axis distal, second medial, whatever the mesh.
    corners = outlines.skin[:, :, ::PIECES]
    assert (signed_area(corners) > 0.0).all()


def test_centres_on_edges_and_vertices_do_not_matter() -> None:
    # A regular mesh whose vertices are the nodes and whose cells' centres lie on edges.
    surface = cylinder_map(40.0)
    mesh = patch_mesh(surface, (30.0, 30.0), 1.5)
    nodes, table = nodes_on(mesh, surface(grid_uv(2, 2))), topology(mesh)
    flat = flat_corners(mesh, nodes, cell_frames(mesh, nodes, table), table)
    along = np.linalg.norm(flat[..., 3, :] - flat[..., 0, :], axis=-1)
    np.testing.assert_allclose(along, 15.0, atol=2e-3)
