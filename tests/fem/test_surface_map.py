"""Maps of the skin: nodes, derivatives, curvature, orientation."""

from __future__ import annotations

import numpy as np
import pytest
from curved_skins import Quadric, Sphere, sphere_nodes
from tolerances import SPLINE_CURVATURE

from kiribench.errors import NodesError
from kiribench.fem.surface_map import Cylinder, NodeSpline, Plane, SurfaceMap

PITCH = 15.0


def _polynomial(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A bicubic surface: not-a-knot splines reproduce it."""
    a, b = u / 60, v / 60
    return np.stack(
        [60 * a + 3 * a**3 * b, 60 * b - 2 * a * b**3 + b**2, 4 * a**3 * b**3 + 9 * a * b], axis=-1
    )


def _polynomial_spline() -> NodeSpline:
    u, v = np.meshgrid(PITCH * np.arange(6), PITCH * np.arange(8))
    return NodeSpline.of(_polynomial(u, v), PITCH)


def test_a_spline_goes_through_its_nodes_and_reproduces_cubics() -> None:
    spline = _polynomial_spline()
    q = np.random.default_rng(0).uniform([0, 0], [75, 105], (200, 2))
    np.testing.assert_allclose(spline.at(q).x, _polynomial(*q.T), atol=1e-10)
    u, v = np.meshgrid(PITCH * np.arange(6), PITCH * np.arange(8))
    nodes = np.column_stack([u.ravel(), v.ravel()])
    np.testing.assert_allclose(spline.at(nodes).x, _polynomial(*nodes.T), atol=1e-11)


@pytest.mark.parametrize(
    "surface",
    [
        Plane(1.1, 1.3, 0.2),
        Cylinder(40.0, 1.1, 1.3),
        Sphere(50.0),
        Quadric(0.01, -0.02, 1.1, 0.015),
        _polynomial_spline(),
    ],
)
def test_derivatives_are_those_of_the_places_inside_and_outside(surface: SurfaceMap) -> None:
    q = np.random.default_rng(1).uniform(-40, 130, (60, 2))
    # Not within the step of a grid line, where third derivatives jump.
    q = q[np.abs(q / PITCH - np.round(q / PITCH)).min(axis=1) > 0.01]
    jet = surface.at(q)
    step = 1e-4
    for axis, unit in enumerate(np.eye(2)):
        more, less = surface.at(q + step * unit), surface.at(q - step * unit)
        np.testing.assert_allclose(
            jet.first[:, axis], (more.x - less.x) / (2 * step), rtol=0, atol=1e-7
        )
        for other, entry in ((0, axis), (1, axis + 1)):
            np.testing.assert_allclose(
                jet.second[:, entry],
                (more.first[:, other] - less.first[:, other]) / (2 * step),
                rtol=0,
                atol=1e-7,
            )


def test_the_continuation_keeps_two_derivatives_and_has_no_third() -> None:
    spline = _polynomial_spline()
    inside, outside = (spline.at(np.array([[75 + side, 40.0]])) for side in (-1e-9, 1e-9))
    for name in ("x", "first", "second"):
        np.testing.assert_allclose(getattr(inside, name), getattr(outside, name), atol=1e-7)
    far = spline.at(np.array([[80.0, 40.0], [100.0, 40.0], [120.0, 40.0]]))
    np.testing.assert_allclose(far.second[0, 0], far.second[2, 0], atol=1e-12)
    assert np.abs(spline.at(np.array([[70.0, 40.0]])).second - far.second[:1]).max() > 1e-5


def test_gauss_curvature_of_plane_cylinder_and_sphere() -> None:
    q = np.random.default_rng(2).uniform(-20, 20, (20, 2))
    assert np.abs(Plane(1.2, 0.9, 0.1).at(q).gauss_curvature).max() == 0
    assert np.abs(Cylinder(30.0).at(q).gauss_curvature).max() < 1e-15
    np.testing.assert_allclose(Sphere(50.0).at(q).gauss_curvature, 50.0**-2, rtol=1e-12)
    # Of a twisted graph z(x, y): (z_xx z_yy - z_xy^2) / (1 + |grad z|^2)^2.
    x, y = 1.1 * q.T
    slope = (0.01 * x + 0.015 * y) ** 2 + (-0.02 * y + 0.015 * x) ** 2
    np.testing.assert_allclose(
        Quadric(0.01, -0.02, 1.1, 0.015).at(q).gauss_curvature,
        (-0.01 * 0.02 - 0.015**2) / (1 + slope) ** 2,
        rtol=1e-12,
    )
    nodes = sphere_nodes(50.0, 9, 9, 10.0)
    spline = NodeSpline.of(nodes, 10.0).at(q + 40)
    np.testing.assert_allclose(spline.gauss_curvature, 50.0**-2, rtol=SPLINE_CURVATURE)


def test_outward_is_away_from_the_body_for_either_hand() -> None:
    nodes = sphere_nodes(50.0, 9, 9, 10.0)
    for grid in (nodes, nodes[:, ::-1]):
        spline = NodeSpline.of(grid, 10.0)
        jet = spline.at(np.array([[40.0, 40.0]]))
        normal = jet.normal(spline.outward)
        np.testing.assert_allclose(normal, jet.x / 50.0, atol=1e-3)
    # Of a cylinder about the y axis the axis is inside.
    round_it = Cylinder(40.0)
    jet = round_it.at(np.array([[13.0, 5.0]]))
    radial = jet.x * [1, 0, 1] / 40.0
    np.testing.assert_allclose(jet.normal(round_it.outward), radial, atol=1e-12)


def test_nodes_that_make_no_spline_are_refused() -> None:
    nodes = sphere_nodes(50.0, 5, 5, 10.0)
    with pytest.raises(NodesError, match="spline-too-small"):
        NodeSpline.of(nodes[:3], 10.0)
    nodes[2, 1] = np.nan
    with pytest.raises(NodesError, match=r"spline-missing-node.*row 2, column 1"):
        NodeSpline.of(nodes, 10.0)
