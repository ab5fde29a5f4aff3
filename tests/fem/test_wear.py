"""The worn patch against closed forms, another element, and its own invariances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from curved_skins import Moved, Relabelled, Sphere, knee
from scipy.spatial.transform import Rotation
from tolerances import (
    WEAR_CYLINDER_MM,
    WEAR_ELEMENTS_MM,
    WEAR_STICK_ENERGY,
    WEAR_T6_MM,
    WEAR_TIP_STRETCH,
)

from kiribench.errors import DataError
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import Ogden
from kiribench.fem.patch import simulate_patch
from kiribench.fem.surface_map import Cylinder, Plane, SurfaceJet
from kiribench.fem.wear import WearSpec, WornPatch, wear_patch
from kiribench.fem.wear_measures import BREAKING_STRESS_MPA, BREAKING_STRETCH
from kiribench.fem.wear_mesh import NO_CUT
from kiribench.lattice import CutMap

MU = 0.207
ORIGIN = (20.0, 30.0)
NARROW = 1.3**-0.5


def _map(rows: int = 3, columns: int = 2, seed: int = 0, low: float = 0.3) -> CutMap:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(low, 0.8, (2, rows, columns))
    return CutMap(a, b, 15.0)


def _uncut(rows: int, columns: int) -> CutMap:
    return CutMap.uniform(0.0, 0.0, rows, columns, 15.0)


def _corners(worn: WornPatch) -> np.ndarray:
    assert worn.status == "ok"
    return worn.corner_q_mm


@pytest.mark.parametrize("element", ["nine-node", "four-node"])
def test_an_uncut_patch_in_uniaxial_tension(element: str) -> None:
    spec = WearSpec(6, element=element, thickness_mm=1.5)  # type: ignore[arg-type]
    worn = wear_patch(_uncut(3, 2), Plane(NARROW, 1.3), ORIGIN, spec)
    x, y = np.meshgrid(15.0 * np.arange(3), 15.0 * np.arange(4))
    laid = np.stack([x, y], axis=-1) + ORIGIN
    np.testing.assert_allclose(_corners(worn), laid, atol=1e-9)
    np.testing.assert_allclose(worn.longitudinal_stretch, 1.3, rtol=1e-12)
    np.testing.assert_allclose(worn.lateral_stretch, NARROW, rtol=1e-12)
    np.testing.assert_allclose(worn.shear, 0.0, atol=1e-12)
    assert worn.strap_force_n == pytest.approx(1.5 * 30 * MU * (1.3 - 1.3**-2), rel=1e-10)
    density = MU / 2 * (1.3**2 + 2 / 1.3 - 3)
    assert worn.energy_mj == pytest.approx(1.5 * 30 * 45 * density, rel=1e-10)
    np.testing.assert_allclose(worn.contact_pressure_mpa, 0.0, atol=1e-15)
    assert worn.tip_stretch.shape == (0,)


def test_a_patch_with_one_strap_relaxes_without_energy() -> None:
    worn = wear_patch(_map(), Plane(1.0, 1.3), ORIGIN, WearSpec(6, straps="free"))
    x, y = np.meshgrid(15.0 * np.arange(3), 15.0 * np.arange(4) / 1.3)
    np.testing.assert_allclose(_corners(worn) - ORIGIN, np.stack([x, y], axis=-1), atol=1e-5)
    assert worn.energy_mj == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(worn.longitudinal_stretch, 1.0, atol=1e-6)


@pytest.mark.parametrize("seed", [0, 1])
def test_on_a_plane_it_is_the_flat_patch_of_other_elements(seed: int) -> None:
    cut_map = _map(seed=seed)
    worn = wear_patch(cut_map, Plane(1.0, 1.3), ORIGIN, WearSpec(16))
    flat = simulate_patch(cut_map, np.linspace(0, 0.3 * 45, 4)[1:], mesh=MeshSpec().scaled(0.5))
    sites = (worn.site_q_mm - ORIGIN) * [1.0, 1.3]
    np.testing.assert_allclose(sites, flat.site_mm[-1], atol=WEAR_T6_MM)
    np.testing.assert_allclose(
        worn.longitudinal_stretch, flat.longitudinal_stretch[-1], atol=WEAR_T6_MM / 15
    )
    np.testing.assert_allclose(worn.lateral_stretch, flat.lateral_stretch[-1], atol=WEAR_T6_MM / 15)
    assert worn.strap_force_n == pytest.approx(2 * 30 * flat.path.nominal_stress_mpa[-1], rel=0.01)
    assert np.ptp(flat.longitudinal_stretch[-1]) > 0.05


def test_a_cylinder_gives_the_flat_answer() -> None:
    cut_map = _map(4, 3)
    flat = wear_patch(cut_map, Plane(1.05, 1.3), ORIGIN)
    for radius in (30.0, 60.0):
        rolled = wear_patch(cut_map, Cylinder(radius, 1.05, 1.3), ORIGIN)
        np.testing.assert_allclose(_corners(rolled), _corners(flat), atol=WEAR_CYLINDER_MM)
        np.testing.assert_allclose(
            rolled.longitudinal_stretch, flat.longitudinal_stretch, atol=WEAR_CYLINDER_MM / 15
        )
        np.testing.assert_allclose(rolled.shear, flat.shear, atol=2 * WEAR_CYLINDER_MM / 15)


def test_it_does_not_feel_where_the_body_is_nor_where_the_grid_begins() -> None:
    cut_map = _map(2, 2)
    spec = WearSpec(6)
    turn = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    base = wear_patch(cut_map, Sphere(50.0), (-12.0, 10.0), spec)
    moved = Moved(Sphere(50.0), turn, np.array([100.0, -40.0, 7.0]))
    mirrored = Moved(Sphere(50.0), turn * [1, -1, 1], np.zeros(3))
    for other in (
        wear_patch(cut_map, moved, (-12.0, 10.0), spec),
        wear_patch(cut_map, mirrored, (-12.0, 10.0), spec),
    ):
        np.testing.assert_allclose(_corners(other), _corners(base), atol=1e-8)
        np.testing.assert_allclose(
            other.contact_pressure_mpa, base.contact_pressure_mpa, atol=1e-10
        )
    later = wear_patch(cut_map, Relabelled(Sphere(50.0), (-20.0, 3.0)), (8.0, 7.0), spec)
    np.testing.assert_allclose(_corners(later), _corners(base) + np.array([20.0, -3.0]), atol=1e-8)


def test_mirrored_and_turned_patches_give_mirrored_and_turned_cells() -> None:
    cut_map = _map(3, 2)
    spec = WearSpec(10)
    plane = Plane(1.02, 1.25)
    base = _corners(wear_patch(cut_map, plane, (0.0, 0.0), spec))
    mirrored = CutMap(cut_map.a[:, ::-1], cut_map.b[:, ::-1], 15.0)
    turned = CutMap(cut_map.a[::-1, ::-1], cut_map.b[::-1, ::-1], 15.0)
    across = _corners(wear_patch(mirrored, plane, (0.0, 0.0), spec))[:, ::-1]
    np.testing.assert_allclose(across * [-1, 1] + [30, 0], base, atol=1e-8)
    about = _corners(wear_patch(turned, plane, (0.0, 0.0), spec))[::-1, ::-1]
    np.testing.assert_allclose([30, 45] - about, base, atol=1e-8)


def test_two_kinds_of_elements_tend_to_one_answer() -> None:
    cut_map = CutMap.uniform(0.5, 0.5, 1, 1, 15.0)
    plane = Plane(1.0, 1.2)

    def energy(count: int, element: str) -> float:
        spec = WearSpec(count, element=element)  # type: ignore[arg-type]
        return wear_patch(cut_map, plane, ORIGIN, spec).energy_mj

    fine = energy(24, "nine-node")
    coarse = [energy(n, "four-node") for n in (8, 16, 32)]
    errors = np.array(coarse) / fine - 1
    # First order, from above, as tips of cuts make it without quarter points.
    assert (errors > 0).all()
    order = np.log2(errors[:-1] / errors[1:])
    assert 0.8 < order[-1] < 1.2
    extrapolated = coarse[2] - (coarse[1] - coarse[2])
    assert extrapolated == pytest.approx(fine, rel=WEAR_ELEMENTS_MM)
    assert energy(10, "nine-node") / fine - 1 < errors[1] / 5


def test_full_stick_on_a_sphere_is_the_integral_of_its_metric() -> None:
    # Metric diag(cos^2(v/r), 1); stress and curvature along u and v give the pressure.
    radius, half_length = 50.0, 30.0
    coarse, worn = (
        wear_patch(
            _uncut(4, 2), Sphere(radius), (-15.0, -half_length), WearSpec(n, friction=np.inf)
        )
        for n in (10, 20)
    )
    nodes, weights = np.polynomial.legendre.leggauss(20)
    square = np.cos(half_length * nodes / radius) ** 2
    density = MU / 2 * (square + 1 + 1 / square - 3)
    energy = 2.0 * 30.0 * half_length * np.sum(weights * density)
    assert worn.energy_mj == pytest.approx(energy, rel=WEAR_STICK_ENERGY)
    # Of fourth order in the mesh.
    order = np.log2((coarse.energy_mj - energy) / (worn.energy_mj - energy))
    assert order == pytest.approx(4, abs=0.1)
    x, y = np.meshgrid(15.0 * np.arange(3) - 15, 15.0 * np.arange(5) - 30)
    np.testing.assert_allclose(worn.corner_q_mm, np.stack([x, y], axis=-1), atol=1e-12)
    mean = 0.5 * (
        np.cos((15.0 * np.arange(4) - 30) / radius) + np.cos((15.0 * np.arange(1, 5) - 30) / radius)
    )
    np.testing.assert_allclose(worn.lateral_stretch, mean[:, None] * np.ones((4, 2)), rtol=1e-10)
    np.testing.assert_allclose(worn.longitudinal_stretch, 1.0, rtol=1e-10)


def test_stretch_before_the_tips_is_that_of_the_skin_where_it_sticks() -> None:
    cut_map = _map(2, 3)

    class Graded:
        """A plane that stretches more and more along v, and less across along u."""

        outward = 1.0

        def at(self, q: np.ndarray) -> SurfaceJet:
            u, v = q.T
            zero = np.zeros_like(u)
            x = np.column_stack([u - 5e-4 * u * u, v + 5e-4 * v * v, zero])
            first = np.zeros((len(q), 2, 3))
            first[:, 0, 0], first[:, 1, 1] = 1 - 1e-3 * u, 1 + 1e-3 * v
            second = np.zeros((len(q), 3, 3))
            second[:, 0, 0], second[:, 2, 1] = -1e-3, 1e-3
            return SurfaceJet(x, first, second)

    worn = wear_patch(cut_map, Graded(), (0.0, 0.0), WearSpec(16, friction=np.inf))
    cuts = cut_map.half_cuts()
    ahead = np.minimum(0.5, 0.5 * (7.5 - cuts.length_mm))
    u, v = (cuts.tip_mm + ahead[:, None] * cuts.direction).T
    across, along = 1 - 1e-3 * u, 1 + 1e-3 * v
    np.testing.assert_allclose(worn.tip_stretch, along, atol=WEAR_TIP_STRETCH)
    stress = MU * (along**2 - 1 / (along * across) ** 2)
    np.testing.assert_allclose(worn.tip_stress_mpa, stress, atol=4 * MU * WEAR_TIP_STRETCH)


def test_straps_slip_turn_and_offset_move_what_they_say() -> None:
    cut_map = _map(2, 2)
    turned = wear_patch(cut_map, Plane(), ORIGIN, WearSpec(6, turn_deg=5.0, offset_mm=(3.0, -2.0)))
    angle = np.deg2rad(5.0)
    x, y = np.meshgrid(15.0 * np.arange(3) - 15, 15.0 * np.arange(3) - 15)
    expected = (
        np.stack(
            [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], axis=-1
        )
        + np.array(ORIGIN)
        + [18.0, 13.0]
    )
    np.testing.assert_allclose(_corners(turned), expected, atol=1e-7)
    assert turned.energy_mj < 1e-10
    slipped = wear_patch(cut_map, Plane(1.0, 1.3), ORIGIN, WearSpec(6, strap_slip_mm=4.0))
    np.testing.assert_allclose(_corners(slipped)[-1, :, 1], ORIGIN[1] + 26.0, atol=1e-12)
    np.testing.assert_allclose(_corners(slipped)[0, :, 1], ORIGIN[1], atol=1e-12)
    held = wear_patch(cut_map, Plane(1.0, 1.3), ORIGIN, WearSpec(6))
    assert slipped.strap_force_n < held.strap_force_n
    hoops = wear_patch(_map(2, 4), Plane(1.0, 1.3), ORIGIN, WearSpec(6, straps="hoops"))
    edge = _corners(hoops)[-1, :, 1] - ORIGIN[1]
    np.testing.assert_allclose(edge[[0, 1, 3, 4]], 30.0, atol=1e-12)
    assert edge[2] < 29.9


def test_the_breaking_stretch_is_the_last_row_of_the_tension_test() -> None:
    path = Path(__file__).parents[1] / "data" / "dragon_skin_srmd" / "Dragon_Skin_20.csv"
    last = path.read_text().strip().splitlines()[-1].split(";")
    assert pytest.approx(1 + float(last[3]), abs=0.05) == BREAKING_STRETCH
    assert pytest.approx(float(last[4]), abs=0.001) == BREAKING_STRESS_MPA


def test_what_cannot_be_modelled_is_refused() -> None:
    cut_map = _map(1, 1)
    with pytest.raises(DataError, match="wear-mesh"):
        wear_patch(cut_map, Plane(), ORIGIN, WearSpec(7))
    with pytest.raises(DataError, match="wear-material"):
        wear_patch(cut_map, Plane(), ORIGIN, material=Ogden(0.1, 3.0))
    with pytest.raises(DataError, match="wear-friction-path"):
        wear_patch(cut_map, Plane(), ORIGIN, WearSpec(friction=0.3))


@pytest.mark.parametrize("participant", ["S1", "S2", "S3"])
def test_uniform_patches_on_the_shipped_knees(participant: str) -> None:
    worn = wear_patch(CutMap.uniform(0.8, 0.8, 12, 6, 15.0), knee(participant), (45.0, 30.0))
    assert worn.reason is None
    # Held at both ends, the patch lengthens as the skin between them does.
    assert 1.2 < worn.longitudinal_stretch.mean() < 1.4
    assert worn.cpu_seconds < 30


@pytest.mark.parametrize("faint", [2e-10, 1e-8, 0.99 * NO_CUT])
def test_a_cut_too_short_to_be_cut_is_none(faint: float) -> None:
    a, b = (np.array(one) for one in (_map().a, _map().b))
    # At a strap and inside, and a column of faint cuts on both sides of a border.
    b[0, 0] = b[1, 0] = b[1, 1] = a[2, 1] = 0.0
    less, more = (np.where(one == 0, faint, one) for one in (a, b))
    surface, spec = Plane(1.0, 1.3), WearSpec(6)
    none = wear_patch(CutMap(a, b, 15.0), surface, ORIGIN, spec)
    found = wear_patch(CutMap(less, more, 15.0), surface, ORIGIN, spec)
    np.testing.assert_array_equal(_corners(found), _corners(none))
    np.testing.assert_array_equal(found.tip_stress_mpa, none.tip_stress_mpa)


def test_the_shortest_cut_that_is_modelled_changes_less_than_the_mesh_does() -> None:
    a, b = (np.array(one) for one in (_map().a, _map().b))
    b[0, 0] = a[1, 1] = 0.0
    surface = Plane(1.0, 1.3)
    none, finer = (
        _corners(wear_patch(CutMap(a, b, 15.0), surface, ORIGIN, WearSpec(elements)))
        for elements in (6, 16)
    )
    b[0, 0] = a[1, 1] = 1.01 * NO_CUT
    least = _corners(wear_patch(CutMap(a, b, 15.0), surface, ORIGIN, WearSpec(6)))
    # The cut itself would change 1e-8; its tip pulls the mesh along.
    assert np.abs(least - none).max() < np.abs(none - finer).max()


@pytest.mark.slow
@pytest.mark.parametrize("participant", ["S1", "S2", "S3"])
def test_random_designs_converge_on_the_shipped_knees(participant: str) -> None:
    rng = np.random.default_rng(11)
    skin = knee(participant)
    for _ in range(8):
        a, b = rng.uniform(0.05, 0.88, (2, 12, 6))
        worn = wear_patch(CutMap(a, b, 15.0), skin, (45.0, 30.0))
        assert worn.reason is None
