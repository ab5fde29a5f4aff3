"""Patch corners down to the skin, along the skin's normals.

A corner x above the skin belongs to the skin point s whose normal passes through x. The
normal of a scan is noisy from face to face, and 2 mm above the skin 0.05 rad are 0.1 mm;
so the normal is an average over a small disc, and s is found by a fixed-point iteration
(it contracts by lift times curvature, .05 for a 2 mm patch on a radius of 40 mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kiribench.surface.face_grid import face_grid
from kiribench.surface.locate import locate, project_along
from kiribench.surface.mesh import FloatArray, Mesh, SurfacePoints

#: Radius of the disc over which a normal is averaged: wide enough for the noise of 1 mm
#: triangles, small against the radius of a knee.
NORMAL_RADIUS_MM = 4.0
ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Projected:
    """Points on the skin below (or above) given points.

    Attributes:
        points: k skin points; meaningless where ``found`` is False.
        found: (k,) whether the skin lies below within the search distance.
        lift_mm: (k,) distance along the normal, positive outside; NaN where not found.
    """

    points: SurfacePoints
    found: NDArray[np.bool_]
    lift_mm: FloatArray


def smooth_normals(mesh: Mesh, at: FloatArray, radius_mm: float = NORMAL_RADIUS_MM) -> FloatArray:
    """Outward normals averaged over the faces near points.

    Args:
        mesh: the skin.
        at: (k, 3) points on it, mm.
        radius_mm: of the disc; enlarged where the triangles are as coarse as the disc.

    Returns:
        (k, 3) unit vectors.
    """
    centres = mesh.corners_mm.mean(axis=1)
    low, high = at.min(axis=0) - 4.0 * radius_mm, at.max(axis=0) + 4.0 * radius_mm
    near = np.flatnonzero(((centres >= low) & (centres <= high)).all(axis=1))
    if len(near) == 0:
        near = np.arange(len(centres))
    areas = mesh.face_areas_mm2[near]
    weighted = mesh.face_normals[near] * areas[:, None]
    edge = float(np.sqrt(2.3 * np.median(areas)))
    radius = max(radius_mm, 2.5 * edge)
    tree = cKDTree(centres[near])
    out = np.empty_like(at)
    for k in range(len(at)):
        faces: list[int] = tree.query_ball_point(at[k], radius) or [int(tree.query(at[k])[1])]
        apart = ((centres[near[faces]] - at[k]) ** 2).sum(axis=1) / radius**2
        kernel = np.maximum(1.0 - apart, 1e-3) ** 2
        total = (weighted[faces] * kernel[:, None]).sum(axis=0)
        out[k] = total / np.linalg.norm(total)
    return out


def project_to_skin(mesh: Mesh, points_mm: FloatArray, max_mm: float) -> Projected:
    """Project points onto the skin along its normals.

    Args:
        mesh: the skin.
        points_mm: (k, 3) points near it.
        max_mm: how far the skin may be.
    """
    grid = face_grid(mesh)
    start = locate(mesh, points_mm, grid=grid)
    foot = start.points.positions_mm(mesh)
    found = np.asarray(start.distance_mm <= max_mm)
    points = start.points
    normal = smooth_normals(mesh, foot)
    for _ in range(ROUNDS):
        line = project_along(mesh, points_mm, normal, max_mm, allow_miss=True, grid=grid)
        found = found & line.hit
        points = line.points
        foot = np.where(found[:, None], points.positions_mm(mesh), foot)
        normal = smooth_normals(mesh, foot)
    lift = ((points_mm - foot) * normal).sum(axis=1)
    return Projected(points, found, np.where(found, lift, np.nan))
