"""Denoising against surfaces whose geodesics are known in closed form."""

from __future__ import annotations

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
    surface_points,
    vertex_normals,
    with_noise,
)
from tolerances import (
    DENOISED_CLEAN_CHANGE,
    DENOISED_LENGTHENING_0_05_MM,
    DENOISED_LENGTHENING_0_1_MM,
    NOISE_SD_RELATIVE,
    PREDICTED_LENGTHENING_RELATIVE,
)

from kiribench.surface.denoise import (
    AUTO_LENGTHENING,
    denoise,
    denoise_if_needed,
    estimate_noise,
)
from kiribench.surface.geodesic import geodesic_distances
from kiribench.surface.mesh import Mesh, SurfacePoints
from kiribench.surface.read import read_mesh

DATA = Path(__file__).parents[1] / "data"
WIDTH, HEIGHT, EDGE, RADIUS = 44.0, 40.0, 0.31, 57.0


def cylinder_pairs(count: int) -> tuple[Mesh, SurfacePoints, SurfacePoints, Array]:
    """A scan of 1M-triangle resolution, and pairs of points 15 mm apart on the cylinder."""
    uv_mesh = parameter_mesh(WIDTH, HEIGHT, EDGE, seed=0)
    mesh = Mesh(on_cylinder(RADIUS, WIDTH)(uv_mesh[0]), uv_mesh[1])
    rng = np.random.default_rng(1)
    angle = rng.uniform(0, np.pi / 2, count)
    start = rng.uniform(4, 20, (count, 2))
    end = start + 15 * np.column_stack([np.cos(angle), np.sin(angle)])
    return mesh, surface_points(uv_mesh, start), surface_points(uv_mesh, end), np.full(count, 15.0)


@pytest.fixture(scope="module")
def scanned() -> tuple[Mesh, SurfacePoints, SurfacePoints, Array]:
    return cylinder_pairs(40)


def lengthening(mesh: Mesh, ends: tuple[SurfacePoints, SurfacePoints], true: Array) -> Array:
    return geodesic_distances(mesh, *ends) / true - 1.0


@pytest.mark.parametrize(
    ("sd_mm", "published", "limit"),
    [(0.05, 0.013, DENOISED_LENGTHENING_0_05_MM), (0.1, 0.041, DENOISED_LENGTHENING_0_1_MM)],
)
def test_lengthening_by_noise_is_predicted_and_removed(
    scanned: tuple[Mesh, SurfacePoints, SurfacePoints, Array],
    sd_mm: float,
    published: float,
    limit: float,
) -> None:
    mesh, sources, targets, true = scanned
    assert abs(lengthening(mesh, (sources, targets), true).mean()) < 1e-6
    noisy = with_noise(mesh, sd_mm, 7, along_normals=True)
    before = lengthening(noisy, (sources, targets), true)
    # The known figure is for one mesh; another of like resolution shows the same size.
    assert 0.7 * published < before.mean() < 1.6 * published
    result = denoise_if_needed(noisy)
    assert result.applied
    after = lengthening(result.mesh, (sources, targets), true)
    assert abs(after.mean()) < limit
    estimate = result.estimate
    assert estimate.sd_mm == pytest.approx(sd_mm, rel=NOISE_SD_RELATIVE)
    assert estimate.predicted_lengthening == pytest.approx(
        before.mean(), rel=PREDICTED_LENGTHENING_RELATIVE
    )
    # The surface stays where it was: no shrinking towards the axis.
    radius = np.hypot(result.mesh.vertices_mm[:, 0], result.mesh.vertices_mm[:, 1])
    inner = (noisy.vertices_mm[:, 2] > 2) & (noisy.vertices_mm[:, 2] < HEIGHT - 2)
    assert abs(radius[inner].mean() - RADIUS) < 0.002
    assert radius[inner].std() < 0.2 * sd_mm


def test_isotropic_noise_too(
    scanned: tuple[Mesh, SurfacePoints, SurfacePoints, Array],
) -> None:
    """Vertices shaken sideways as well: the true distance is that of the ends' shadows."""
    mesh, sources, targets, _ = scanned
    smooth = denoise(with_noise(mesh, 0.05, 3))
    ends = [points.positions_mm(smooth) for points in (sources, targets)]
    arcs = [RADIUS * np.arctan2(end[:, 0], end[:, 1]) for end in ends]
    true = np.hypot(arcs[1] - arcs[0], ends[1][:, 2] - ends[0][:, 2])
    after = lengthening(smooth, (sources, targets), true)
    assert abs(after.mean()) < DENOISED_LENGTHENING_0_05_MM


def test_sphere_keeps_its_radius() -> None:
    mesh = surface_mesh(on_sphere(50, 30, 30), 30, 30, 0.4, seed=2)
    smooth = denoise(with_noise(mesh, 0.05, 1, along_normals=True))
    radius = np.linalg.norm(smooth.vertices_mm, axis=1)
    inner = np.abs(mesh.vertices_mm[:, [0, 2]]).max(axis=1) < 13
    assert abs(radius[inner].mean() - 50) < 0.002
    assert radius[inner].std() < 0.015


def test_vertices_move_along_normals_only() -> None:
    mesh = surface_mesh(on_knee(40, 40), 40, 40, 0.8, seed=0)
    noisy = with_noise(mesh, 0.1, 0, along_normals=True)
    before = noisy.vertices_mm.copy()
    smooth = denoise(noisy)
    assert np.array_equal(noisy.vertices_mm, before)
    assert smooth.faces is noisy.faces
    shift = smooth.vertices_mm - noisy.vertices_mm
    normals = vertex_normals(smooth)
    sideways = shift - np.einsum("ij,ij->i", shift, normals)[:, None] * normals
    # The line of motion is the normal of the filtered surface: the same within 0.03 rad rms.
    assert np.sqrt(np.mean(sideways**2)) < 0.03 * np.sqrt(np.mean(shift**2))


def test_sharp_step_stays() -> None:
    """The rim of a 2 mm patch is no noise: it must not be rounded off."""
    uv, faces = parameter_mesh(40.0, 20.0, 0.4, seed=0)
    # A 2 mm wall of 1 mm run: the rim turns by 63 degrees.
    height = np.clip(2.0 * (uv[:, 0] - 20.0), 0.0, 2.0)
    mesh = Mesh(np.column_stack([uv, height]), faces)
    smooth = denoise(with_noise(mesh, 0.02, 0, along_normals=True))
    off = np.abs(smooth.vertices_mm[:, 2] - height)
    inner = (np.minimum(uv[:, 1], 20 - uv[:, 1]) > 2) & (np.minimum(uv[:, 0], 40 - uv[:, 0]) > 2)
    assert off[inner & (np.abs(uv[:, 0] - 20.5) > 2.5)].max() < 0.05
    # The rim itself is rounded by an eighth of the step.
    assert off[inner].max() < 0.3


@pytest.mark.parametrize(
    "name",
    [
        "anny_knee/A_male_athletic_dqs_00deg",
        "anny_knee/B_female_average_dqs_90deg",
        "multidic_cylinder/cyl_0",
        "duodic_rubber_tension/state_05",
        "geodesic_benchmark/sphere_R50",
    ],
)
def test_clean_scans_are_left_alone(name: str) -> None:
    mesh = read_mesh(DATA / f"{name}.obj")
    result = denoise_if_needed(mesh)
    assert not result.applied
    assert result.mesh is mesh
    assert abs(result.estimate.predicted_lengthening) < DENOISED_CLEAN_CHANGE


@pytest.mark.parametrize(
    ("edge", "width", "height"), [(0.31, 40, 40), (1.0, 90, 120), (2.0, 130, 240)]
)
def test_denoising_a_clean_knee_changes_no_length(edge: float, width: int, height: int) -> None:
    mesh = surface_mesh(on_knee(130, 240), width, height, edge, seed=0)
    estimate = estimate_noise(mesh, pairs=30, seed=4)
    assert abs(estimate.predicted_lengthening) < DENOISED_CLEAN_CHANGE
    assert estimate.pairs == 30
    assert 10 < estimate.span_mm < 25


def test_threshold_decides() -> None:
    mesh = surface_mesh(on_knee(50, 60), 50, 60, 1.0, seed=0)
    noisy = with_noise(mesh, 0.05, 1, along_normals=True)
    predicted = estimate_noise(noisy).predicted_lengthening
    assert predicted > AUTO_LENGTHENING
    assert denoise_if_needed(noisy).applied
    assert denoise_if_needed(noisy, threshold=1.01 * predicted).mesh is noisy
    assert not denoise_if_needed(with_noise(mesh, 0.01, 1, along_normals=True)).applied


def test_two_pieces_are_sampled_apart() -> None:
    """No path is asked for from one piece to another."""
    mesh = surface_mesh(on_knee(40, 40), 40, 40, 1.0, seed=0)
    both = Mesh(
        np.concatenate([mesh.vertices_mm, mesh.vertices_mm + np.array([0, 3, 0])]),
        np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices_mm)]),
    )
    assert estimate_noise(both).pairs == 48
