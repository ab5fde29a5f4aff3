"""Registration against known motions of analytic knees, and a real rigid body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scan_shapes import (
    Array,
    on_cylinder,
    on_knee,
    on_sphere,
    parameter_mesh,
    surface_mesh,
    vertex_normals,
    with_noise,
)
from tolerances import (
    REGISTRATION_CLEAN_MM,
    REGISTRATION_MULTIDIC_MM,
    REGISTRATION_NOISY_MM,
    REGISTRATION_SIGMAS,
)

from kiribench.errors import RegistrationError
from kiribench.surface.mesh import Mesh
from kiribench.surface.read import read_mesh
from kiribench.surface.register import Registration, register
from kiribench.surface.rigid import RigidTransform, kabsch, rotation_of

DATA = Path(__file__).parents[1] / "data"
WIDTH, HEIGHT = 130.0, 240.0
TRUTH = RigidTransform(rotation_of(np.array([0.10, -0.08, 0.12])), np.array([4.0, -6.0, 5.0]))


@dataclass(frozen=True, eq=False)
class Worn:
    """A bare scan in a frame of its own, and the worn scan with the patch 2 mm over the skin."""

    bare: Mesh
    worn: Mesh
    on_patch: np.ndarray  # faces of the worn scan
    under_patch: np.ndarray  # faces of the bare scan


def worn_pair(sd_mm: float = 0.0, seed: int = 0, *, edge: float = 2.0, margin: float = 0.0) -> Worn:
    """Different tessellations, a patch over a third of the surface, a bare scan cropped by
    ``margin`` at three sides, white noise on both.
    """
    place = on_knee(WIDTH, HEIGHT)
    uv, faces = parameter_mesh(WIDTH, HEIGHT, edge, seed=1)
    inside = (uv[:, 0] > margin) & (uv[:, 0] < WIDTH - margin) & (uv[:, 1] > margin)
    bare = Mesh(place(uv), faces[inside[faces].all(axis=1)])
    kept = uv[bare.faces].mean(axis=1)
    worn_uv, worn_faces = parameter_mesh(WIDTH, HEIGHT, 1.35 * edge, seed=2)
    worn = Mesh(place(worn_uv), worn_faces)
    patch = (np.abs(worn_uv[:, 0] - WIDTH / 2) < 45) & (np.abs(worn_uv[:, 1] - HEIGHT / 2) < 60)
    worn = Mesh(worn.vertices_mm + 2.0 * patch[:, None] * vertex_normals(worn), worn_faces)
    if sd_mm:
        bare, worn = with_noise(bare, sd_mm, 2 * seed), with_noise(worn, sd_mm, 2 * seed + 1)
    return Worn(
        bare=TRUTH.inverse().moved(bare),
        worn=worn,
        on_patch=patch[worn_faces].any(axis=1),
        under_patch=(np.abs(kept[:, 0] - WIDTH / 2) < 48) & (np.abs(kept[:, 1] - HEIGHT / 2) < 63),
    )


def error_mm(result: Registration, mesh: Mesh) -> Array:
    """(n, 3) how far the estimated motion puts vertices from the true one."""
    return result.transform.apply(mesh.vertices_mm) - TRUTH.apply(mesh.vertices_mm)


def test_known_motion_without_noise() -> None:
    pair = worn_pair()
    before = pair.bare.vertices_mm.copy(), pair.worn.vertices_mm.copy()
    result = register(
        pair.bare, pair.worn, exclude_moving=pair.under_patch, exclude_fixed=pair.on_patch
    )
    assert np.linalg.norm(error_mm(result, pair.bare), axis=1).max() < REGISTRATION_CLEAN_MM
    assert result.residual_rms_mm < REGISTRATION_CLEAN_MM
    assert result.improvement > 0.99
    assert result.inlier_fraction > 0.9 * result.overlap_fraction
    assert np.array_equal(pair.bare.vertices_mm, before[0])
    assert np.array_equal(pair.worn.vertices_mm, before[1])


def test_patch_is_trimmed_without_a_mask() -> None:
    """A third of what is seen lies 2 mm too high, and nobody says where."""
    pair = worn_pair()
    result = register(pair.bare, pair.worn)
    assert np.linalg.norm(error_mm(result, pair.bare), axis=1).max() < REGISTRATION_CLEAN_MM
    covered = pair.bare.face_areas_mm2[pair.under_patch].sum() / pair.bare.face_areas_mm2.sum()
    assert result.inlier_fraction < 1.0 - 0.8 * covered


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("masked", [True, False])
def test_noise_and_partial_overlap_stay_within_the_covariance(seed: int, masked: bool) -> None:
    sd = (0.05, 0.1)[seed % 2]
    pair = worn_pair(sd, seed, margin=15.0)
    result = register(
        pair.bare,
        pair.worn,
        exclude_moving=pair.under_patch if masked else None,
        exclude_fixed=pair.on_patch if masked else None,
        seed=seed,
    )
    assert result.misfit_rms_mm < 0.6 * result.residual_rms_mm
    # The residual is that of two noisy surfaces: white noise averaged within their faces.
    assert 0.6 * sd < result.residual_rms_mm < 1.5 * sd
    corners = pair.bare.vertices_mm[:: len(pair.bare.vertices_mm) // 25]
    off = result.transform.apply(corners) - TRUTH.apply(corners)
    spread = result.point_covariance_mm2(TRUTH.apply(corners))
    distance = np.sqrt(np.einsum("ki,kij,kj->k", off, np.linalg.inv(spread), off))
    assert distance.max() < REGISTRATION_SIGMAS
    assert np.linalg.norm(off, axis=1).max() < REGISTRATION_NOISY_MM


def test_covariance_covers_noise_alone() -> None:
    """Ten noise draws: errors have the size that the covariance without its systematic
    part predicts, neither a third nor three times of it.
    """
    offs, predicted = [], []
    for seed in range(10):
        pair = worn_pair(0.1, 100 + seed, edge=5.0)
        result = register(
            pair.bare,
            pair.worn,
            exclude_fixed=pair.on_patch,
            initial=TRUTH,
            samples=2500,
            seed=seed,
            systematic_mm=0.0,
        )
        centre = result.centre_mm[None]
        offs.append(result.transform.apply(TRUTH.inverse().apply(centre))[0] - centre[0])
        predicted.append(np.trace(result.covariance[3:, 3:]))
    ratio = np.sqrt(np.mean(np.square(offs).sum(axis=1)) / np.mean(predicted))
    assert 1 / 3 < ratio < 3


def test_corresponding_nodes_give_the_start() -> None:
    """From 70 degrees and 300 mm off, with noisy nodes and two of them missing."""
    far = RigidTransform(rotation_of(np.array([0.3, 1.1, -0.4])), np.array([300.0, 40.0, -90.0]))
    pair = worn_pair()
    bare = far.moved(pair.bare)
    rng = np.random.default_rng(0)
    nodes = pair.bare.vertices_mm[rng.integers(0, len(pair.bare.vertices_mm), 12)]
    ours, theirs = far.apply(nodes) + rng.normal(0, 1, nodes.shape), TRUTH.apply(nodes)
    ours[3] = np.nan
    theirs[5] = np.nan
    result = register(bare, pair.worn, initial=kabsch(ours, theirs))
    off = result.transform.after(far).apply(nodes) - TRUTH.apply(nodes)
    assert np.linalg.norm(off, axis=1).max() < REGISTRATION_CLEAN_MM


def test_result_does_not_depend_on_the_frame() -> None:
    turn = RigidTransform(rotation_of(np.array([-0.7, 0.2, 1.9])), np.array([20.0, -500.0, 90.0]))
    pair = worn_pair(0.05, 3, edge=4.0)
    plain = register(pair.bare, pair.worn, exclude_fixed=pair.on_patch)
    turned = register(
        turn.moved(pair.bare),
        turn.moved(pair.worn),
        initial=turn.after(turn.inverse()),
        exclude_fixed=pair.on_patch,
    )
    # turned = turn plain turn^-1, up to where each run stopped: a tenth of a standard error.
    corners = pair.bare.vertices_mm[::50]
    expected = turn.apply(plain.transform.apply(corners))
    got = turned.transform.apply(turn.apply(corners))
    sd = np.sqrt(np.trace(plain.covariance[3:, 3:]))
    assert np.linalg.norm(got - expected, axis=1).max() < sd


@pytest.mark.parametrize("pose", [1, 3])
def test_real_rigid_cylinder(pose: int) -> None:
    """A speckled cylinder, moved rigidly: matched points are the witness.

    Along normals the motion agrees with theirs. Along and about its axis a cylinder slides
    freely: there the covariance must say so.
    """
    moving = read_mesh(DATA / "multidic_cylinder" / "cyl_0.obj")
    fixed = read_mesh(DATA / "multidic_cylinder" / f"cyl_{pose}.obj")
    witness = kabsch(moving.vertices_mm, fixed.vertices_mm)
    start = rotation_of(np.array([0.004, -0.003, 0.002]))
    first = RigidTransform(start, np.array([0.2, -0.3, 0.1])).after(witness)
    result = register(moving, fixed, initial=first)
    off = result.transform.apply(moving.vertices_mm) - witness.apply(moving.vertices_mm)
    along = np.einsum("ij,ij->i", off, vertex_normals(fixed))
    assert np.sqrt(np.mean(along**2)) < REGISTRATION_MULTIDIC_MM
    spread = result.point_covariance_mm2(fixed.vertices_mm)
    sideways = np.sqrt(np.trace(spread, axis1=1, axis2=2))
    assert (np.linalg.norm(off, axis=1) < REGISTRATION_SIGMAS * sideways).all()
    assert sideways.min() > 0.5  # mm: not to be trusted sideways
    assert result.firmness < 0.005


def test_knee_is_firm() -> None:
    pair = worn_pair(0.05, edge=4.0)
    result = register(pair.bare, pair.worn, exclude_fixed=pair.on_patch)
    assert result.firmness > 0.1
    assert np.sqrt(np.diag(result.covariance)[3:]).max() < 0.05


@pytest.mark.parametrize("place", [on_sphere(57, 80, 80), on_cylinder(57, 80)])
def test_free_directions_are_seen(place: object) -> None:
    mesh = surface_mesh(place, 80, 80, 4.0, seed=0)  # type: ignore[arg-type]
    result = register(mesh, surface_mesh(place, 80, 80, 5.0, seed=1))  # type: ignore[arg-type]
    assert result.firmness < 0.01
    assert np.linalg.eigvalsh(result.covariance)[-1] > 1e-4


def test_motions_drawn_have_the_covariance() -> None:
    pair = worn_pair(0.1, 1, edge=4.0)
    result = register(pair.bare, pair.worn, exclude_fixed=pair.on_patch)
    rng = np.random.default_rng(0)
    point = TRUTH.inverse().apply(result.centre_mm + np.array([30.0, -20.0, 60.0]))[None]
    moved = np.array([motion.apply(point)[0] for motion in result.sample(rng, 4000)])
    expected = result.point_covariance_mm2(result.transform.apply(point))[0]
    # The relative error of a variance from 4,000 draws is sqrt(2 / 4000) = 2.2 %.
    assert np.cov(moved.T) == pytest.approx(expected, abs=0.1 * expected.max())


def refused(**options: object) -> str:
    pair = worn_pair(edge=4.0)
    arguments: dict[str, object] = {"moving": pair.bare, "fixed": pair.worn, **options}
    with pytest.raises(RegistrationError) as caught:
        register(**arguments)  # type: ignore[arg-type]
    assert caught.value.exit_code == 3
    return caught.value.code


def test_too_little_overlap_is_refused() -> None:
    apart = RigidTransform(np.eye(3), np.array([0.0, 0.0, 220.0])).after(TRUTH)
    assert refused(initial=apart) == "registration-overlap"


def test_nothing_left_is_refused() -> None:
    pair = worn_pair(edge=4.0)
    assert refused(exclude_moving=np.ones(len(pair.bare.faces), bool)) == "registration-overlap"
    assert refused(exclude_fixed=np.ones(len(pair.worn.faces), bool)) == "registration-overlap"


def test_another_leg_is_refused() -> None:
    """A limb of another girth and pose has no rigid place."""
    other = surface_mesh(
        lambda uv: on_knee(WIDTH, HEIGHT)(uv) * [1.25, 0.8, 1.1], WIDTH, HEIGHT, 4.0
    )
    assert refused(moving=other, samples=2000) in {"registration-residual", "registration-inliers"}


def test_kabsch_is_exact_and_proper() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 50, (20, 3))
    found = kabsch(points, TRUTH.apply(points))
    assert np.allclose(found.rotation, TRUTH.rotation, atol=1e-13)
    assert np.allclose(found.translation_mm, TRUTH.translation_mm, atol=1e-11)
    mirrored = kabsch(points, points * [-1, 1, 1])
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.arange(12.0).reshape(4, 3)])
def test_kabsch_refuses_what_fixes_nothing(points: Array) -> None:
    with pytest.raises(RegistrationError, match="registration-correspondences"):
        kabsch(points, points)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.1])
def test_rotation_of_its_vector(angle: float) -> None:
    from scipy.spatial.transform import Rotation

    vector = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    found = rotation_of(vector)
    assert np.allclose(found, Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)
    assert RigidTransform(found, np.zeros(3)).angle_deg == pytest.approx(np.degrees(angle))


def test_transforms_compose() -> None:
    point = np.array([[3.0, -4.0, 5.0]])
    assert np.allclose(TRUTH.inverse().apply(TRUTH.apply(point)), point, atol=1e-13)
    twice = TRUTH.after(TRUTH)
    assert np.allclose(twice.apply(point), TRUTH.apply(TRUTH.apply(point)), atol=1e-13)


def test_a_start_without_any_partner_is_passed_over() -> None:
    """A strip so narrow that a start 3 mm aside meets only its border, and no clean fit."""
    fixed = surface_mesh(lambda uv: np.column_stack([uv, 0.0 * uv[:, 0]]), 4.0, 90.0, 1.0)

    def wavy(uv: Array) -> Array:
        return np.column_stack([uv, 0.4 * np.sin(uv[:, 1] / 4.0)])

    result = register(surface_mesh(wavy, 4.0, 90.0, 1.0), fixed, samples=2000)
    assert 0.1 < result.residual_rms_mm < 0.5
