"""What is read off a worn patch, and how it is laid, against closed forms and virtual work."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from curved_skins import Sphere
from tolerances import WEAR_TIP_PLACE

from kiribench.fem.surface_map import Plane, SurfaceJet
from kiribench.fem.wear import WearSpec, lay, strapped_nodes, wear_patch
from kiribench.fem.wear_measures import cell_measures, tip_state
from kiribench.fem.wear_mesh import edge_nodes, facet_points, facet_template, lagrange, mesh_patch
from kiribench.fem.wear_rest import RestMap
from kiribench.fem.wear_skin import flatness
from kiribench.lattice import CutMap

MU = 0.207
CELL = 15.0


def test_cells_of_any_shape_are_measured_where_they_lie() -> None:
    # On a stretched and sheared plane the cells are quadrilaterals with straight edges.
    plane = Plane(1.1, 1.3, 0.2)
    x, y = np.meshgrid(CELL * np.arange(3), CELL * np.arange(4))
    corners = np.stack([x, y], axis=-1) + np.random.default_rng(0).uniform(-2, 2, (4, 3, 2))
    found = cell_measures(plane, corners, CELL)
    place = corners @ np.array([[1.1, 0.0], [0.2, 1.3]])
    for i in range(3):
        for j in range(2):
            near, right, top, far = (
                place[i + k, j + m] for k, m in ((0, 0), (0, 1), (1, 0), (1, 1))
            )
            along = np.linalg.norm([top - near, far - right], axis=1)
            across = np.linalg.norm([right - near, far - top], axis=1)
            assert found.longitudinal_stretch[i, j] == pytest.approx(along.mean() / CELL, rel=1e-12)
            assert found.lateral_stretch[i, j] == pytest.approx(across.mean() / CELL, rel=1e-12)
            # How far the right angle between the mid-lines has closed.
            up, side = (top + far - near - right) / 2, (right + far - near - top) / 2
            closed = np.pi / 2 - (np.arctan2(up[1], up[0]) - np.arctan2(side[1], side[0]))
            assert found.shear[i, j] == pytest.approx(np.tan(closed), rel=1e-12)


def test_a_slanting_cell_on_a_sphere_has_its_lengths_and_its_angle() -> None:
    radius, slant = 40.0, 0.4
    sphere = Sphere(radius)
    v = np.array([10.0, 25.0])
    corners = np.stack(
        [np.array([[0, CELL]] * 2) + slant * (v[:, None] - v[0]), np.tile(v[:, None], 2)], axis=-1
    )
    found = cell_measures(sphere, corners, CELL)
    # Lengths of fine chains of chords; parallels have a radius of their own.
    t = np.linspace(0, 1, 4001)[:, None]
    lengths = [
        np.linalg.norm(
            np.diff(sphere.at(start + t * (end - start)).x, axis=0),
            axis=1,
        ).sum()
        for start, end in zip(corners[0], corners[1], strict=True)
    ]
    assert found.longitudinal_stretch[0, 0] == pytest.approx(np.mean(lengths) / CELL, rel=1e-7)
    assert found.lateral_stretch[0, 0] == pytest.approx(np.cos(v / radius).mean(), rel=1e-12)
    # In the middle of the cell dx = cos(v / r) du and dy = dv are at right angles.
    assert found.shear[0, 0] == pytest.approx(slant * np.cos(v.mean() / radius), rel=1e-12)


def test_the_pull_on_the_distal_strap_is_the_energy_it_takes_to_move_it() -> None:
    # Nearer to the pole the patch is narrower: its straps pull unequally.
    cut_map = CutMap.uniform(0.5, 0.5, 2, 2, CELL)
    spec = WearSpec(6, strap_slip_mm=-4.0, thickness_mm=1.5)

    def worn(slip: float) -> tuple[float, float]:
        one = wear_patch(cut_map, Sphere(50.0), (-15.0, 8.0), replace(spec, strap_slip_mm=slip))
        assert one.status == "ok"
        return one.energy_mj, one.strap_force_n

    step = 1e-3
    work = (worn(-4.0 - step)[0] - worn(-4.0 + step)[0]) / (2 * step)
    assert worn(-4.0)[1] == pytest.approx(work, rel=1e-6)
    # Turned about, the same patch has its wide end at the other strap.
    about = wear_patch(cut_map, Sphere(50.0), (-15.0, -42.0), spec)
    assert abs(about.strap_force_n / work - 1) > 0.01


def test_sites_lie_where_the_skin_has_their_coordinates() -> None:
    worn = wear_patch(CutMap.uniform(0.5, 0.4, 2, 3, CELL), Sphere(50.0), (-30.0, 5.0), WearSpec(6))
    u, v = np.moveaxis(worn.site_q_mm, -1, 0) / 50.0
    place = 50.0 * np.stack([np.sin(u) * np.cos(v), np.sin(v), np.cos(u) * np.cos(v)], axis=-1)
    np.testing.assert_allclose(worn.site_mm, place, atol=1e-10)


def test_hoops_hold_the_outer_cells_at_both_ends_and_nothing_else() -> None:
    mesh = mesh_patch(CutMap.uniform(0.4, 0.4, 3, 4, CELL), 6, 2)
    for held, end in zip(strapped_nodes(mesh, "hoops"), (0.0, 45.0), strict=True):
        x, y = mesh.points_mm[held].T
        np.testing.assert_allclose(y, end, atol=1e-9)
        assert set(np.round(x[np.abs(x / 7.5 - np.round(x / 7.5)) < 1e-9], 9)) == {
            0.0, 7.5, 15.0, 45.0, 52.5, 60.0,
        }  # fmt: skip
        at_end = mesh.points_mm[np.abs(mesh.points_mm[:, 1] - end) < 1e-9]
        assert len(x) == np.count_nonzero(np.abs(at_end[:, 0] - 30) > 15 - 1e-9)
        assert not np.any(np.abs(x - 30) < 15 - 1e-9)


def test_a_patch_turns_about_where_the_rest_map_has_its_centre() -> None:
    cut_map = CutMap.uniform(0.5, 0.5, 2, 3, 10.0)
    x, y = np.meshgrid(5.0 * np.arange(7), 5.0 * np.arange(5))
    # A map that widens the patch by a tenth and does not keep its centre.
    sites = np.stack([1.1 * x + 40, y + 60], axis=-1)
    plain = flatness(np.concatenate([sites, np.zeros((5, 7, 1))], axis=2), 5.0)
    rest = RestMap(sites, 5.0, 0.1, plain)
    points = np.random.default_rng(1).uniform([0, 0], [30, 20], (20, 2))
    angle = np.deg2rad(30.0)
    away = (points - [15, 10]) * [1.1, 1.0]
    turned = np.column_stack(
        [
            np.cos(angle) * away[:, 0] - np.sin(angle) * away[:, 1],
            np.sin(angle) * away[:, 0] + np.cos(angle) * away[:, 1],
        ]
    )
    found = lay(points, cut_map, (2.0, 3.0), WearSpec(turn_deg=30.0, offset_mm=(0.5, -1.5)), rest)
    np.testing.assert_allclose(found, turned + np.array([57.0, 68.5]), atol=1e-9)


@pytest.mark.parametrize(
    ("across", "along", "intervals"), [(0.3, 0.95, 40), (0.95, 0.6, 40), (0.95, 0.3, 12)]
)
def test_the_rubber_is_judged_half_a_millimetre_before_the_tip(
    across: float, along: float, intervals: int
) -> None:
    # Stuck to a plane whose stretch grows along v: so a stretch tells a place.
    cut_map = CutMap(np.array([[across]]), np.array([[along]]), CELL)
    mesh = mesh_patch(cut_map, intervals, 2)
    u, v = mesh.points_mm.T
    zero, one = np.zeros_like(u), np.ones_like(u)
    first = np.stack(
        [np.column_stack([one, zero, zero]), np.column_stack([zero, 1.1 + 0.01 * v, zero])], axis=1
    )
    place = np.column_stack([u, 1.1 * v + 0.005 * v * v, zero])
    jet = SurfaceJet(place, first, np.zeros((len(u), 3, 3)))
    stretch, stress = tip_state(mesh, jet, MU)
    cuts = cut_map.half_cuts()
    ligament = 7.5 - cuts.length_mm
    # Of a ligament shorter than a millimetre it is the middle.
    assert ligament.min() < 1.0 < ligament.max()
    ahead = np.where(ligament < 1.0, ligament / 2, 0.5)
    # Beside a tip an element has 1, r^1/2 and r, and so -3/4 r^1/2 + 7/4 r for r^2 (r = 1 at its
    # end); farther on it takes r^2 as it is.
    size = ligament / (intervals / 4)
    root = np.sqrt(ahead / size)
    slope = np.where(root < 1, size * (-0.75 / root + 3.5) / 2, 2 * ahead)
    tip, way = cuts.tip_mm[:, 1], cuts.direction[:, 1]
    expected = 1.1 + 0.01 * tip + 0.005 * way * slope
    np.testing.assert_allclose(stretch, expected, atol=WEAR_TIP_PLACE)
    np.testing.assert_allclose(stress, MU * (expected**2 - expected**-2), atol=WEAR_TIP_PLACE)


@pytest.mark.parametrize("intervals", [6, 10, 16])
def test_elements_beside_a_tip_hold_the_root_of_the_distance(intervals: int) -> None:
    # A crack opens with the root of the distance from its tip: an element that is to follow it
    # has that function between its nodes, along the edge and inwards from the tip.
    template = facet_template(intervals, 2)
    tip = template.cut_nodes
    place, _ = edge_nodes(np.array([0.37]), template)
    local = np.linspace(-1, 1, 21)
    shapes, _ = lagrange(local, 2)
    points, _ = facet_points(np.array([[0.37, 0.6, 0.2, 0.8]]), template)
    wide = intervals + 1
    rows = [place[0, tip : tip + 3] - 0.37, 0.37 - place[0, tip - 2 : tip + 1][::-1]]
    for edge, inward in zip(template.edges, (wide, -1, -wide, 1), strict=True):
        line = points[0, edge[tip] + inward * np.arange(3)]
        rows.append(np.linalg.norm(line - line[0], axis=1))
    for distance in rows:
        between = shapes @ distance
        np.testing.assert_allclose(shapes @ np.sqrt(distance), np.sqrt(between.clip(0)), atol=1e-7)
        assert distance[2] > 0.01


def test_an_element_is_mapped_by_its_eight_outer_nodes() -> None:
    # Barsoum's elements have eight nodes: the ninth must not bend the map beside the tips.
    template = facet_template(10, 2)
    points, _ = facet_points(np.array([[0.37, 0.6, 0.2, 0.8]]), template)
    nodes = points[0][template.elements].reshape(-1, 3, 3, 2)
    xi, eta = np.random.default_rng(2).uniform(-1, 1, (2, 30))
    nine = np.einsum("pi,pj,eijd->epd", lagrange(eta, 2)[0], lagrange(xi, 2)[0], nodes)
    eight = np.zeros_like(nine)
    for i, y in enumerate((-1, 0, 1)):
        for j, x in enumerate((-1, 0, 1)):
            if x and y:
                shape = 0.25 * (1 + x * xi) * (1 + y * eta) * (x * xi + y * eta - 1)
            elif x:
                shape = 0.5 * (1 + x * xi) * (1 - eta**2)
            elif y:
                shape = 0.5 * (1 - xi**2) * (1 + y * eta)
            else:
                continue
            eight += shape[:, None] * nodes[:, None, i, j]
    np.testing.assert_allclose(nine, eight, atol=1e-13)
