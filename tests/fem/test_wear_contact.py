"""Contact of a worn patch: pressure against membrane theory, crack faces against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from curved_skins import Quadric, Sphere, knee
from tolerances import WEAR_PRESSURE, WEAR_PRESSURE_ISOMETRY, WEAR_SLIT

from kiribench.fem.surface_map import Cylinder, Plane, SurfaceJet, SurfaceMap
from kiribench.fem.wear import WearSpec, solve_worn, wear_patch
from kiribench.fem.wear_contact import face_overlap, weight_mpa
from kiribench.fem.wear_mesh import mesh_patch
from kiribench.lattice import CutMap

MU = 0.207
ORIGIN = (20.0, 30.0)


def _uncut(rows: int, columns: int) -> CutMap:
    return CutMap.uniform(0.0, 0.0, rows, columns, 15.0)


def test_pressure_of_a_stretched_sleeve_and_lift_off_of_a_hollow() -> None:
    radius, lateral, along, thickness = 40.0, 1.2, 1.1, 2.0
    spec = WearSpec(10, friction=np.inf, thickness_mm=thickness)
    skin = Cylinder(radius, lateral, along)
    worn = wear_patch(_uncut(4, 4), skin, ORIGIN, spec)
    cauchy = MU * (lateral**2 - 1 / (lateral * along) ** 2)
    pressure = cauchy / radius * thickness / (lateral * along)
    # Border facets share nodes with nobody: their border is left out.
    np.testing.assert_allclose(worn.contact_pressure_mpa[1:-1, 1:-1], pressure, rtol=WEAR_PRESSURE)

    class Hollow:
        """The same skin seen from inside: it is a hollow, and holds nothing."""

        outward = -1.0

        def at(self, q: np.ndarray) -> SurfaceJet:
            return skin.at(q)

    lifted = wear_patch(_uncut(4, 4), Hollow(), ORIGIN, spec).contact_pressure_mpa
    np.testing.assert_allclose(lifted, -worn.contact_pressure_mpa, rtol=1e-12)


def _laplace(surface: SurfaceMap, q: np.ndarray, thickness: float) -> np.ndarray:
    """(n,) membrane stress times curvature of a sheet that sticks to a skin: pressure, MPa."""
    jet = surface.at(q)
    metric = jet.metric
    inverse = np.linalg.inv(metric)
    determinant = np.linalg.det(metric)
    stress = MU * (np.eye(2) - inverse / determinant[:, None, None])
    second = jet.second[:, [0, 1, 1, 2]].reshape(-1, 2, 2, 3)
    bent = -np.einsum("nabd,nd->nab", second, jet.normal(surface.outward))
    area = np.sqrt(determinant)
    return np.asarray(thickness * np.einsum("nab,nab->n", stress, bent) / area)


@pytest.mark.parametrize(
    ("surface", "middle"),
    [
        # Equal curvatures: 2 T / R. A saddle of equal ones: none. Unequal: the larger one decides.
        (Quadric(1 / 60, 1 / 60, 1.2), 2.0),
        (Quadric(-1 / 60, -1 / 60, 1.2), -2.0),
        (Quadric(1 / 60, -1 / 60, 1.2), 0.0),
        (Quadric(1 / 60, -2 / 60, 1.2), -1.0),
        (Quadric(1 / 60, 0.0, 1.2, 1 / 60), 1.0),
    ],
)
def test_pressure_on_domes_hollows_and_saddles(surface: Quadric, middle: float) -> None:
    stretch, thickness = surface.stretch, 1.5
    tension = thickness * MU * (stretch**2 - stretch**-4) / stretch**2
    apex = _laplace(surface, np.zeros((1, 2)), thickness)[0]
    assert apex == pytest.approx(middle * tension / 60, abs=1e-12)
    spec = WearSpec(10, friction=np.inf, thickness_mm=thickness)
    worn = wear_patch(_uncut(4, 4), surface, (-30.0, -30.0), spec)
    grid = -30 + 7.5 * np.arange(8)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    place = (grid[:, None] + 3.75 * (1 + nodes)).ravel()
    u, v = np.meshgrid(place, place)
    q = np.column_stack([u.ravel(), v.ravel()])
    area = np.sqrt(np.linalg.det(surface.at(q).metric))
    both = np.outer(np.tile(weights, 8), np.tile(weights, 8))

    def facets(values: np.ndarray) -> np.ndarray:
        weighted = both * values.reshape(32, 32)
        return np.asarray(weighted.reshape(8, 4, 8, 4).sum(axis=(1, 3)))

    expected = facets(_laplace(surface, q, thickness) * area) / facets(area)
    inside = (slice(1, -1), slice(1, -1))
    np.testing.assert_allclose(
        worn.contact_pressure_mpa[inside], expected[inside], atol=WEAR_PRESSURE * tension / 60
    )
    np.testing.assert_allclose(worn.contact_area_mm2, 7.5**2 / 4 * facets(area), rtol=WEAR_PRESSURE)


class Stretched:
    """A skin whose material is stretched alike both ways before it is bent."""

    outward = 1.0

    def __init__(self, surface: SurfaceMap, stretch: float) -> None:
        self.surface, self.stretch = surface, stretch

    def at(self, q: np.ndarray) -> SurfaceJet:
        jet = self.surface.at(self.stretch * q)
        return SurfaceJet(jet.x, self.stretch * jet.first, self.stretch**2 * jet.second)


def test_pressure_tends_to_the_membranes_as_the_mesh_is_refined() -> None:
    stretched = Stretched(Sphere(50.0), 1.2)
    errors = []
    for elements in (6, 12):
        spec = WearSpec(elements, friction=np.inf)
        worn = wear_patch(_uncut(2, 2), stretched, (-15.0, -15.0), spec)
        nodes, weights = np.polynomial.legendre.leggauss(6)
        u, v = np.meshgrid(-7.5 + 3.75 * (1 + nodes), -7.5 + 3.75 * (1 + nodes))
        q = np.column_stack([u.ravel(), v.ravel()])
        area = np.sqrt(np.linalg.det(stretched.at(q).metric)) * np.outer(weights, weights).ravel()
        expected = np.sum(_laplace(stretched, q, 2.0) * area) / np.sum(area)
        errors.append(abs(worn.contact_pressure_mpa[1, 1] / expected - 1))
    assert errors[1] < errors[0] / 3
    assert errors[1] < WEAR_PRESSURE


def test_a_patch_on_a_cylinder_pulls_where_it_is_pressed_across() -> None:
    # A cylinder is bent across only, and bending it changes no length: the flat patch's lateral
    # tension / radius is the pressure, whatever the radius. Held at its ends, a sheet that
    # widens is compressed there, and the skin has to pull.
    cut_map = CutMap.uniform(0.8, 0.8, 6, 3, 15.0)
    spec = WearSpec(8)
    near, far = (
        wear_patch(cut_map, Cylinder(radius, 1.0, 1.25), ORIGIN, spec).contact_pressure_mpa * radius
        for radius in (40.0, 80.0)
    )
    np.testing.assert_allclose(near, far, atol=WEAR_PRESSURE_ISOMETRY * np.abs(far).max())
    assert far[1:3, 2:4].max() < 0
    assert far[-3:-1, 2:4].max() < 0
    # The same facets carry the sheet where it would narrow.
    narrow = wear_patch(_uncut(6, 3), Cylinder(40.0, 1.0, 1.25), ORIGIN, spec)
    assert narrow.contact_pressure_mpa[1:3, 2:4].min() > 0


def test_contact_and_straps_balance() -> None:
    solution = solve_worn(
        CutMap.uniform(0.6, 0.6, 12, 6, 15.0), knee("S1"), (45.0, 30.0), WearSpec(6), None
    )
    force = solution.equilibrium.force
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * np.abs(force).sum()
    # Free nodes are held by normal forces alone.
    system = solution.system
    jet = system.jet(solution.equilibrium.q)
    normal = jet.normal(1.0)
    tangential = force - np.einsum("na,na->n", force, normal)[:, None] * normal
    free = ~system.fixed.any(axis=1)
    assert np.abs(tangential[free]).max() < 1e-9
    assert np.abs(force[free]).max() > 1e-4


def test_the_weight_of_the_sheet() -> None:
    # Two millimetres of Dragon Skin: 2.16 kg on a square metre.
    assert weight_mpa(2.0) == pytest.approx(2.16 * 9.81e-6, rel=1e-12)


def test_crack_faces_that_pass_through_each_other_are_measured() -> None:
    # Squeezed across by sticking to a skin that shrinks: nothing overlaps. Then one lip is
    # pushed by hand through the other.
    cut_map = CutMap.uniform(0.6, 0.3, 1, 1, 15.0)
    mesh = mesh_patch(cut_map, 8, 2)
    for surface in (Plane(1.0, 0.8), Plane(-1.0, 0.8)):
        assert face_overlap(mesh, surface.at(mesh.points_mm)).max() == 0.0
    q = mesh.points_mm.copy()
    x, y = q.T
    # The cut in the middle runs across; its distal lip belongs to the facets of the second row.
    lip = np.unique(mesh.nodes[2:])
    on_cut = lip[(np.abs(y[lip] - 7.5) < 1e-9) & (np.abs(x[lip] - 7.5) < 3.0)]
    only = np.setdiff1d(on_cut, np.unique(mesh.nodes[:2]))
    q[only, 1] -= 0.25
    for surface in (Plane(), Plane(-1.0, 1.0), Cylinder(40.0)):
        jet = surface.at(q)
        assert face_overlap(mesh, jet).max() == pytest.approx(0.25, rel=0.01)


def test_a_slit_that_turns_shut_overlaps_where_it_does() -> None:
    # The flank of one notch at the free edge is turned about the notch's tip, rigidly: a node at
    # distance r then lies r sin(angle) behind the other flank.
    cut_map = CutMap.uniform(0.6, 0.3, 3, 2, 15.0)
    mesh = mesh_patch(cut_map, 8, 2)
    angle = np.deg2rad(4.0)
    below, above = 1 * 4 + 3, 2 * 4 + 3  # facets beside the first notch of the right edge
    flank = np.setdiff1d(mesh.nodes[above], mesh.nodes[below])
    y = mesh.points_mm[:, 1]
    flank = flank[np.abs(y[flank] - 15) < 1e-9]
    tip = np.array([30 - 0.6 * 7.5, 15.0])
    q = mesh.points_mm.copy()
    cos, sin = np.cos(angle), np.sin(angle)
    q[flank] = (q[flank] - tip) @ np.array([[cos, -sin], [sin, cos]]) + tip
    depth = face_overlap(mesh, Plane().at(q))
    expected = 0.6 * 7.5 * np.sin(angle)
    assert depth.max() == pytest.approx(expected, rel=0.01)
    # It is told of the two facets beside the notch, and of no other.
    shut = np.zeros((6, 4), dtype=bool)
    shut[[1, 2], 3] = True
    np.testing.assert_array_equal(depth > 0.01, shut)
    # Turned the other way the notch opens.
    q[flank] = (mesh.points_mm[flank] - tip) @ np.array([[cos, sin], [-sin, cos]]) + tip
    assert face_overlap(mesh, Plane().at(q)).max() == 0.0


def test_every_cut_is_watched_by_the_two_facets_beside_it() -> None:
    # One face of one half-cut after the other is pushed through the opposite one, on a skin
    # whose axes are not at right angles: the depth is told across the cut.
    cut_map = CutMap.uniform(0.6, 0.5, 2, 2, 15.0)
    mesh = mesh_patch(cut_map, 8, 2)
    slant, push = 0.4, 0.2
    cuts = cut_map.half_cuts()
    for (q, p), way, length in zip(cuts.site, cuts.direction, cuts.length_mm, strict=True):
        if way[0] != 0:
            column = q if way[0] > 0 else q - 1
            beside, into, depth = [(p - 1, column), (p, column)], [0.0, -push], push
        else:
            row = p if way[1] > 0 else p - 1
            beside, into = [(row, q - 1), (row, q)], [-push, 0.0]
            depth = push / np.hypot(1, slant)
        one, other = (mesh.nodes[4 * i + j] for i, j in beside)
        face = np.setdiff1d(other, one)
        from_site = mesh.points_mm[face] - 7.5 * np.array([q, p])
        ahead = from_site @ way
        aside = np.abs(from_site - ahead[:, None] * way).max(axis=1)
        face = face[(aside < 1e-9) & (ahead > 1e-9) & (ahead < length - 1e-9)]
        moved = mesh.points_mm.copy()
        moved[face] += into
        found = face_overlap(mesh, Plane(1.0, 1.0, slant).at(moved))
        told = np.zeros((4, 4))
        told[tuple(np.transpose(beside))] = depth
        np.testing.assert_allclose(found, told, atol=0.01 * push)


def test_a_slit_under_compression_overlaps_by_what_it_opens_under_tension() -> None:
    # A slit of length 2c in a sheet opens by 4 c sigma / E in its middle (Westergaard), and
    # overlaps by as much under compression, where nothing holds its faces apart.
    a = np.zeros((3, 3))
    a[1, 1] = 0.3
    cut_map = CutMap(a, np.zeros((3, 3)), 15.0)
    strain = 2e-3
    solved = {}
    for stretch in (1 - strain, 1 + strain):
        # The straps hold the width that the sheet wants: it is in uniaxial stress throughout.
        plane = Plane(stretch**-0.5, stretch)
        solved[stretch] = solve_worn(cut_map, plane, (0.0, 0.0), WearSpec(16), None)
    jets = [one.system.jet(one.equilibrium.q) for one in solved.values()]
    mesh = solved[1 - strain].system.mesh
    shut, opened = (face_overlap(mesh, jet) for jet in jets)
    assert opened.max() == 0.0
    assert shut[2:4, 2:4].max() == shut.max()
    middle = np.flatnonzero(np.abs(mesh.points_mm - 22.5).max(axis=1) < 1e-9)
    assert len(middle) == 2
    gap = np.abs(np.diff(jets[1].x[middle, 1]))[0]
    assert shut.max() == pytest.approx(gap, rel=WEAR_SLIT)
    assert gap == pytest.approx(4 * (0.3 * 7.5) * strain, rel=WEAR_SLIT)
