"""Remove scan noise, which lengthens every path, without moving the surface sideways.

Face normals are smoothed by a joint bilateral filter (Zheng, Fu, Au and Tai 2011,
doi 10.1109/TVCG.2010.264; the guidance by smoothed normals after Zhang, Deng, Zhang, Bouaziz
and Liu 2015, doi 10.1111/cgf.12742), then vertices move until the faces agree with them (Sun,
Rosin, Martin and Langbein 2007, doi 10.1109/TVCG.2007.1065, eq. 5), here each along its own
fixed normal only: what was drawn on the skin keeps its place on it. Because positions are
smoothed through their normals, a surface of constant curvature keeps its radius.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kiribench.surface import connectivity, denoise_kernels
from kiribench.surface.mesh import FloatArray, Mesh, SurfacePoints

RADIUS_MM = 1.4
"""Roughness finer than about this is taken for noise; skin's own relief is coarser."""

RANGE_SCALE = 0.35
"""Normals that differ by much more (20 degrees, after smoothing) do not blend: edges stay."""

AUTO_LENGTHENING = 1e-3
"""'auto' denoises a scan whose paths are predicted to be longer by more than this share."""

_PASSES = (2, 30)
_MOVES = 20


@dataclass(frozen=True)
class NoiseEstimate:
    """How rough a scan is, judged against its own denoised surface.

    Attributes:
        sd_mm: standard deviation of the vertices about the denoised surface, along normals.
        tilt_deg: rms angle between the face normals and the smoothed ones.
        predicted_lengthening: mean of (path on the scan / path on the denoised scan) - 1 over
            sampled pairs of points; 0.01 is 1 % too long.
        standard_error: of that mean, from the spread over the pairs.
        span_mm: mean length of the sampled paths.
        pairs: how many paths were compared.
    """

    sd_mm: float
    tilt_deg: float
    predicted_lengthening: float
    standard_error: float
    span_mm: float
    pairs: int


@dataclass(frozen=True, eq=False)
class Denoised:
    """A scan after the decision whether to denoise it.

    Attributes:
        mesh: the denoised mesh if ``applied``, else the very mesh that was given.
        applied: whether it was denoised.
        estimate: of the noise of the given mesh.
    """

    mesh: Mesh
    applied: bool
    estimate: NoiseEstimate


def denoise(mesh: Mesh, *, radius_mm: float = RADIUS_MM) -> Mesh:
    """Smooth ``mesh`` over about ``radius_mm``; faces, texture and colours stay as they are.

    Args:
        mesh: a repaired mesh, mm.
        radius_mm: reach of the filter; the number of passes over neighbouring faces is its
            square in units of the mean edge, between 2 and 30.
    """
    return _smoothed(mesh, radius_mm)[0]


def estimate_noise(
    mesh: Mesh, *, radius_mm: float = RADIUS_MM, pairs: int = 48, seed: int = 0
) -> NoiseEstimate:
    """Estimate the noise of a repaired ``mesh`` and how much longer it makes paths.

    Args:
        mesh: mm.
        radius_mm: as in :func:`denoise`.
        pairs: how many paths of about 15 mm to compare.
        seed: of the choice of paths.
    """
    return _estimate(mesh, *_smoothed(mesh, radius_mm), pairs, seed)


def denoise_if_needed(
    mesh: Mesh,
    *,
    threshold: float = AUTO_LENGTHENING,
    radius_mm: float = RADIUS_MM,
    pairs: int = 48,
    seed: int = 0,
) -> Denoised:
    """Denoise ``mesh`` only if its noise lengthens paths by more than ``threshold``."""
    smooth, tilt = _smoothed(mesh, radius_mm)
    estimate = _estimate(mesh, smooth, tilt, pairs, seed)
    applied = estimate.predicted_lengthening > threshold
    return Denoised(smooth if applied else mesh, applied, estimate)


def _smoothed(mesh: Mesh, radius_mm: float) -> tuple[Mesh, float]:
    """The denoised mesh and the rms angle (radians) that its normals were turned by."""
    faces, count = mesh.faces, len(mesh.vertices_mm)
    areas = mesh.face_areas_mm2
    normals = first = mesh.face_normals
    centres = mesh.corners_mm.mean(axis=1)
    offsets, items = denoise_kernels.vertex_faces(faces, count)
    # The edge of an equilateral triangle of median area: noise makes the edges themselves long.
    edge = float(np.sqrt(np.median(areas) * 4 / np.sqrt(3)))
    passes = int(np.clip(round((radius_mm / max(edge, 1e-9)) ** 2), *_PASSES))
    bounds, others, weights = denoise_kernels.face_neighbours(
        centres, areas, faces, offsets, items, edge
    )
    for _ in range(passes):
        guide = denoise_kernels.filter_normals(normals, normals, bounds, others, weights, 0.0)
        normals = denoise_kernels.filter_normals(
            normals, guide, bounds, others, weights, RANGE_SCALE
        )
    directions = denoise_kernels.vertex_directions(normals, areas, faces, count)
    held = ~directions.any(axis=1)
    moves = min(_MOVES, 2 * passes)
    moved = denoise_kernels.move_vertices(
        mesh.vertices_mm, directions, normals, areas, faces, offsets, items, held, moves
    )
    cosine = np.clip(np.einsum("ij,ij->i", first, normals), -1.0, 1.0)
    tilt = float(np.sqrt(np.average(np.arccos(cosine) ** 2, weights=areas)))
    return replace(mesh, vertices_mm=moved), tilt


def _estimate(mesh: Mesh, smooth: Mesh, tilt: float, pairs: int, seed: int) -> NoiseEstimate:
    from kiribench.surface.geodesic import geodesic_distances
    from kiribench.surface.topology import topology

    shift = np.linalg.norm(smooth.vertices_mm - mesh.vertices_mm, axis=1)
    sources, targets = _sample_pairs(smooth, pairs, seed)
    ratios = np.ones(0)
    span = 0.0
    if len(sources):
        connections = topology(mesh)
        rough = geodesic_distances(mesh, sources, targets, topology=connections)
        plain = geodesic_distances(smooth, sources, targets, topology=topology(smooth))
        ratios = rough / plain - 1.0
        span = float(plain.mean())
    return NoiseEstimate(
        sd_mm=float(np.sqrt(np.mean(shift**2))),
        tilt_deg=float(np.degrees(tilt)),
        predicted_lengthening=float(ratios.mean()) if len(ratios) else 0.0,
        standard_error=float(ratios.std(ddof=1) / np.sqrt(len(ratios))) if len(ratios) > 1 else 0.0,
        span_mm=span,
        pairs=len(ratios),
    )


def _sample_pairs(mesh: Mesh, pairs: int, seed: int) -> tuple[SurfacePoints, SurfacePoints]:
    """Face centres about 15 mm apart (less on a small mesh), each pair in one component."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    order, starts = connectivity.edge_groups(mesh.faces, len(mesh.vertices_mm))
    piece = connectivity.face_components(mesh.faces, order, starts, False)
    chosen = rng.permutation(len(mesh.faces))[: max(4000, 40 * pairs)]
    centres = mesh.corners_mm[chosen].mean(axis=1)
    span = min(15.0, 0.3 * float(np.linalg.norm(np.ptp(mesh.vertices_mm, axis=0))))
    near: NDArray[np.intp] = cKDTree(centres).query_pairs(1.1 * span, output_type="ndarray")
    apart: FloatArray = np.linalg.norm(centres[near[:, 0]] - centres[near[:, 1]], axis=1)
    wanted = (apart > 0.9 * span) & (piece[chosen[near[:, 0]]] == piece[chosen[near[:, 1]]])
    near = near[wanted]
    near = near[rng.permutation(len(near))[:pairs]]
    thirds = np.full((len(near), 3), 1.0 / 3.0)
    first, second = (chosen[near[:, side]].astype(np.int32) for side in range(2))
    return SurfacePoints(first, thirds), SurfacePoints(second, thirds)
