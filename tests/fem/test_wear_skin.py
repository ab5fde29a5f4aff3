"""The skin at rest: missing nodes, flatness, rest maps; and the way to the pose with friction."""

from __future__ import annotations

import numpy as np
import pytest
from curved_skins import knee_nodes, sphere_nodes
from tolerances import ANGLE_DEFECT, REST_SPHERE_MM, REST_STRAIN

from kiribench.errors import NodesError
from kiribench.fem.surface_map import Cylinder, NodeSpline, Plane
from kiribench.fem.wear import WearSpec, solve_worn, wear_patch
from kiribench.fem.wear_friction import skin_path
from kiribench.fem.wear_rest import rest_map, rest_of_skin
from kiribench.fem.wear_skin import fill_nodes, flatness
from kiribench.lattice import CutMap

PITCH = 10.0


def _nodes_of(surface: Plane | Cylinder, rows: int, columns: int) -> np.ndarray:
    u, v = np.meshgrid(PITCH * np.arange(columns), PITCH * np.arange(rows))
    q = np.column_stack([u.ravel(), v.ravel()])
    return surface.at(q).x.reshape(rows, columns, 3)


def test_missing_nodes_are_put_where_the_grid_bends_least() -> None:
    nodes = _nodes_of(Plane(1.1, 1.3, 0.2), 6, 7)
    gaps = nodes.copy()
    gaps[2, 3] = gaps[2, 4] = gaps[0, 0] = np.nan
    np.testing.assert_allclose(fill_nodes(gaps), nodes, atol=1e-10)
    assert np.isnan(gaps[2, 3]).all()
    round_it = _nodes_of(Cylinder(50.0), 6, 7)
    gaps = round_it.copy()
    gaps[2, 3] = np.nan
    assert np.abs(fill_nodes(gaps) - round_it).max() < 0.05
    gaps[:2] = np.nan
    with pytest.raises(NodesError, match="nodes-too-few"):
        fill_nodes(gaps)
    # Two rows do not say how the grid bends along.
    narrow = _nodes_of(Plane(), 2, 12)
    np.testing.assert_array_equal(fill_nodes(narrow), narrow)
    narrow[0, 5] = np.nan
    with pytest.raises(NodesError, match="nodes-too-few"):
        fill_nodes(narrow)


def test_flatness_of_plane_cylinder_and_sphere() -> None:
    flat = flatness(_nodes_of(Plane(), 6, 7), PITCH)
    assert flat.mismatch < 1e-14
    assert np.abs(flat.gauss_curvature).max() < 1e-14
    rolled = flatness(_nodes_of(Cylinder(50.0), 6, 7), PITCH)
    # Chords are short by (h / r)^2 / 24; a developable grid of quads has no angle defect.
    np.testing.assert_allclose(rolled.across_mismatch, -(0.2**2) / 24, rtol=0.01)
    assert np.abs(rolled.gauss_curvature).max() < 1e-12
    assert rolled.flat
    ball = flatness(sphere_nodes(60.0, 9, 9, PITCH), PITCH)
    np.testing.assert_allclose(ball.gauss_curvature, 60.0**-2, rtol=ANGLE_DEFECT)
    # Gauss and Bonnet: the inner nodes stand for a square of 7 x 7 cells on the sphere.
    width, height = 2 * 35.0 / 60, 35.0 / 60
    assert ball.total_curvature == pytest.approx(width * 2 * np.sin(height), rel=ANGLE_DEFECT)
    assert not ball.flat
    stretched = flatness(_nodes_of(Plane(1.05, 1.0, 0.1), 6, 7), PITCH)
    np.testing.assert_allclose(stretched.across_mismatch, 0.05, rtol=1e-10)
    np.testing.assert_allclose(stretched.shear, 0.1 / np.hypot(1, 0.1), rtol=1e-10)


def test_a_rest_map_lays_a_patch_flat_on_skin_that_its_grid_misstates() -> None:
    # The drawn grid is 5 % too wide: the patch of 10 mm cells covers less of it.
    cut_map = CutMap.uniform(0.5, 0.5, 2, 2, PITCH)
    skin = NodeSpline.of(_nodes_of(Plane(1.05, 1.0), 6, 6), PITCH)
    laid = rest_map(skin, cut_map, (12.0, 11.0))
    points = np.random.default_rng(0).uniform(0, 20, (30, 2))
    expected = (points - 10) / [1.05, 1.0] + [22.0, 21.0]
    np.testing.assert_allclose(laid.at(points), expected, atol=1e-6)
    assert laid.largest_strain < 1e-8
    # Worn at rest it is then without stress; laid by the grid it is not.
    by_map = wear_patch(cut_map, skin, (12.0, 11.0), WearSpec(6), rest=laid)
    by_grid = wear_patch(cut_map, skin, (12.0, 11.0), WearSpec(6))
    assert by_map.energy_mj < 1e-10 < 1e-4 < by_grid.energy_mj


def test_the_largest_strain_of_a_rest_map_is_that_of_the_map() -> None:
    cut_map = CutMap.uniform(0.5, 0.5, 2, 2, PITCH)
    skin = NodeSpline.of(sphere_nodes(60.0, 9, 9, PITCH), PITCH)
    laid = rest_map(skin, cut_map, (30.0, 30.0))
    # From places on the skin alone, by differences, at a grid of points.
    along = np.linspace(0, 20, 41)
    points = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    ways = [
        (skin.at(laid.at(points + way)).x - skin.at(laid.at(points - way)).x) / 2e-4
        for way in 1e-4 * np.eye(2)
    ]
    stretch = np.linalg.svd(np.stack(ways, axis=-1), compute_uv=False)
    assert laid.largest_strain == pytest.approx(np.abs(stretch - 1).max(), rel=REST_STRAIN)


def test_which_skin_needs_a_rest_map_and_which_is_refused() -> None:
    cut_map = CutMap.uniform(0.5, 0.5, 4, 4, PITCH)
    assert rest_of_skin(_nodes_of(Cylinder(50.0), 7, 7), PITCH, cut_map, (10, 10)) is None
    ball = sphere_nodes(40.0, 7, 7, PITCH)
    # Only what lies under the patch counts: a flatter ball, or a smaller patch, needs none.
    assert rest_of_skin(sphere_nodes(60.0, 7, 7, PITCH), PITCH, cut_map, (10.0, 10.0)) is None
    small = CutMap.uniform(0.5, 0.5, 2, 2, PITCH)
    assert rest_of_skin(ball, PITCH, small, (20.0, 20.0)) is None
    laid = rest_of_skin(ball, PITCH, cut_map, (10.0, 10.0))
    assert laid is not None
    assert 0.01 < laid.largest_strain < 0.2
    # By symmetry the centre and the mid-lines stay; least energy spreads the corners.
    np.testing.assert_allclose(laid.sites_q_mm[4, 4], 30.0, atol=REST_SPHERE_MM)
    np.testing.assert_allclose(laid.sites_q_mm[:, 4, 0], 30.0, atol=REST_SPHERE_MM)
    with pytest.raises(NodesError, match=r"skin-not-flat.*Gauss curvature under the patch is \d"):
        rest_of_skin(sphere_nodes(20.0, 7, 7, PITCH), PITCH, cut_map, (10.0, 10.0))
    for participant in ("S1", "S2", "S3"):
        assert flatness(knee_nodes(participant, "flex000"), 15.0).flat


def test_the_way_of_the_skin_is_isometric_where_the_pose_only_bends() -> None:
    rest = _nodes_of(Plane(), 6, 10)
    # Rolled to three quarters of a circle: straight lines between nodes would shrink it.
    radius = 90.0 / (1.5 * np.pi)
    pose = _nodes_of(Cylinder(radius), 6, 10)
    path = skin_path(rest, pose, PITCH, steps=4)
    q = np.column_stack([PITCH * np.tile(np.arange(10), 6), PITCH * np.repeat(np.arange(6), 10)])
    chord = 2 * radius * np.sin(PITCH / radius / 2)
    for step, skin in enumerate(path, 1):
        nodes = skin.at(q).x.reshape(6, 10, 3)
        across = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
        expected = PITCH + step / 4 * (chord - PITCH)
        np.testing.assert_allclose(across, expected, rtol=0.01)
        np.testing.assert_allclose(np.linalg.norm(np.diff(nodes, axis=0), axis=2), PITCH, rtol=0.01)
    last = path[-1].at(q).x
    np.testing.assert_allclose(
        np.linalg.norm(last[:, None] - last[None], axis=2),
        np.linalg.norm(pose.reshape(-1, 3)[:, None] - pose.reshape(-1, 3)[None], axis=2),
        atol=1e-9,
    )


def test_the_way_of_the_skin_stretches_and_turns_evenly() -> None:
    rest = _nodes_of(Plane(), 5, 6)
    pose = _nodes_of(Plane(1.2, 1.6), 5, 6)
    for step, skin in enumerate(skin_path(rest, pose, PITCH, steps=4), 1):
        nodes = skin.at(rest.reshape(-1, 3)[:, :2]).x.reshape(5, 6, 3)
        across, along = (np.linalg.norm(np.diff(nodes, axis=k), axis=2) for k in (1, 0))
        np.testing.assert_allclose(across, PITCH * (1 + 0.05 * step), rtol=1e-9)
        np.testing.assert_allclose(along, PITCH * (1 + 0.15 * step), rtol=1e-9)
    # A plane that is rolled has a curvature that grows evenly.
    path = skin_path(rest, _nodes_of(Cylinder(40.0), 5, 6), PITCH, steps=4)
    for step, skin in enumerate(path, 1):
        nodes = skin.at(rest.reshape(-1, 3)[:, :2]).x.reshape(5, 6, 3)
        edges = np.diff(nodes[2], axis=0)
        edges /= np.linalg.norm(edges, axis=1, keepdims=True)
        turns = np.arccos(np.sum(edges[1:] * edges[:-1], axis=1))
        assert turns.mean() == pytest.approx(step / 4 * PITCH / 40.0, rel=0.01)


def test_friction_holds_every_node_within_coulombs_cone() -> None:
    cut_map = CutMap.uniform(0.6, 0.6, 3, 2, PITCH)
    rest = _nodes_of(Cylinder(30.0), 6, 6)
    path = skin_path(rest, _nodes_of(Cylinder(30.0, 1.1, 1.3), 6, 6), PITCH, steps=4)
    origin, friction = (15.0, 10.0), 0.3
    energy = {}
    for mu in (0.0, friction, np.inf):
        spec = WearSpec(6, friction=mu)
        solution = solve_worn(cut_map, path[-1], origin, spec, None, None, path)
        energy[mu] = solution.equilibrium.energy
        if mu == friction:
            dragged = solution
    # Sliding freely is the least energy, sticking gives none of it away.
    assert energy[0.0] < energy[friction] < energy[np.inf]
    system, found = dragged.system, dragged.equilibrium
    jet = system.jet(found.q)
    normal = jet.normal(path[-1].outward)
    pressed = np.einsum("na,na->n", found.force, normal)
    tangential = np.linalg.norm(found.force - pressed[:, None] * normal, axis=1)
    free = ~system.fixed.any(axis=1)
    carried = free & (pressed > 0.02 * pressed[free].max())
    assert carried.sum() > 50
    # The normal force is that of the round before: it has settled to a few per cent.
    ratio = tangential[carried] / (friction * pressed[carried])
    assert ratio.max() < 1.05
    assert np.median(ratio) > 0.8
    # Nothing drags where nothing presses.
    assert tangential[free & (pressed < 0)].max(initial=0) < 0.02 * tangential[carried].max()


def test_friction_remembers_the_way() -> None:
    # Bent too far and back, the skin ends where it does when it is bent at once; the patch does
    # not, for it slid on the way and is held where it slid to.
    cut_map = CutMap.uniform(0.6, 0.6, 3, 2, PITCH)
    way = [_nodes_of(Cylinder(30.0, 1 + part / 3, 1 + part), 6, 6) for part in (0.1, 0.2, 0.5)]
    near, middle, far = (NodeSpline.of(nodes, PITCH) for nodes in way)
    spec = WearSpec(6, friction=0.5)
    straight, back = (
        wear_patch(cut_map, middle, (15.0, 10.0), spec, path=path)
        for path in ([near, middle], [near, middle, far, middle])
    )
    assert straight.reason is None
    assert back.reason is None
    apart = np.abs(back.corner_q_mm - straight.corner_q_mm).max()
    assert apart > 0.01


def test_friction_lies_between_sliding_and_sticking() -> None:
    cut_map = CutMap.uniform(0.6, 0.6, 3, 2, PITCH)
    rest = _nodes_of(Cylinder(30.0), 6, 6)
    pose = _nodes_of(Cylinder(30.0, 1.1, 1.3), 6, 6)
    path = skin_path(rest, pose, PITCH, steps=4)
    origin = (15.0, 10.0)

    def corners(friction: float) -> np.ndarray:
        worn = wear_patch(cut_map, path[-1], origin, WearSpec(6, friction=friction), path=path)
        assert worn.reason is None
        return worn.corner_q_mm

    free, stuck = corners(0.0), corners(np.inf)
    x, y = np.meshgrid(PITCH * np.arange(3), PITCH * np.arange(4))
    np.testing.assert_allclose(stuck, np.stack([x, y], axis=-1) + origin, atol=1e-12)
    away = [np.abs(corners(mu) - free).max() for mu in (1e-4, 0.5, 2.0)]
    whole = np.abs(stuck - free).max()
    assert away[0] < 0.01 * whole
    assert away[0] < away[1] < away[2] < whole
