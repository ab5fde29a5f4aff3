"""The scan made small and turned to the viewer, for the pictures of the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.surface.mesh import Mesh

FloatArray = NDArray[np.float64]

#: Faces a point whose normals are averaged: one alone leans with its triangle.
NEAR_FACES = 8


@dataclass(frozen=True, eq=False)
class FrontView:
    """A right-handed frame that looks at the patch from outside.

    Attributes:
        origin_mm: (3,) centre of the patch.
        axes: (3, 3) rows: right, up (proximal), towards the viewer.
    """

    origin_mm: FloatArray
    axes: FloatArray

    def turn(self, points_mm: FloatArray) -> FloatArray:
        """(..., 3) points in this frame, mm."""
        return np.asarray((points_mm - self.origin_mm) @ self.axes.T)


def front_view(mesh: Mesh, centres_mm: FloatArray, normals: FloatArray | None = None) -> FrontView:
    """Look along the mean outside normal of the patch, proximal up.

    Args:
        mesh: the scan.
        centres_mm: (R, C, 3) centres of the skin cells, row 0 proximal; NaN where missing.
        normals: (k, 3) outside normals near the patch, or None: from the nearest faces.
    """
    flat = centres_mm.reshape(-1, 3)
    known = flat[~np.isnan(flat).any(axis=1)]
    towards = (nearest_normals(mesh, known) if normals is None else normals).mean(axis=0)
    towards = towards / np.linalg.norm(towards)
    steps = (centres_mm[:-1] - centres_mm[1:]).reshape(-1, 3)
    steps = steps[~np.isnan(steps).any(axis=1)]
    up = steps.mean(axis=0) if len(steps) else np.zeros(3)
    up = up - (up @ towards) * towards
    if np.linalg.norm(up) < 1e-9:
        up = np.cross(towards, np.eye(3)[int(np.argmin(np.abs(towards)))])
    up = up / np.linalg.norm(up)
    return FrontView(known.mean(axis=0), np.stack([np.cross(up, towards), up, towards]))


def nearest_normals(mesh: Mesh, points_mm: FloatArray) -> FloatArray:
    """(n, 3) unit normals of the faces whose middles are nearest to the points."""
    from scipy.spatial import cKDTree

    tree = cKDTree(mesh.corners_mm.mean(axis=1))
    _, near = tree.query(points_mm, k=min(NEAR_FACES, len(mesh.faces)))
    return np.asarray(mesh.face_normals[near.reshape(-1)])


def decimate(mesh: Mesh, faces: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """Vertices and faces of a coarser mesh: vertices in one cube become their mean.

    It is for pictures only; no number of the report is computed on it.

    Args:
        mesh: any triangle mesh.
        faces: about the number of faces wanted, at most.

    Returns:
        (n, 3) float64 vertices, mm, and (m, 3) int32 faces with m <= faces (the mesh itself
        where it is small enough).
    """
    vertices, triangles = mesh.vertices_mm, mesh.faces
    if len(triangles) <= faces:
        return vertices, triangles
    cube_mm = float(np.sqrt(2.0 * mesh.face_areas_mm2.sum() / faces))
    while True:
        keys = np.floor((vertices - vertices.min(axis=0)) / cube_mm).astype(np.int64)
        _, label = np.unique(keys, axis=0, return_inverse=True)
        label = label.reshape(-1)
        merged = label[triangles]
        distinct = (
            (merged[:, 0] != merged[:, 1])
            & (merged[:, 1] != merged[:, 2])
            & (merged[:, 2] != merged[:, 0])
        )
        merged = merged[distinct]
        _, first = np.unique(np.sort(merged, axis=1), axis=0, return_index=True)
        merged = merged[np.sort(first)]
        if len(merged) <= faces:
            break
        cube_mm *= 1.1
    count = np.bincount(label)
    mean = np.stack(
        [np.bincount(label, weights=vertices[:, axis]) / count for axis in range(3)], axis=1
    )
    kept, compact = np.unique(merged, return_inverse=True)
    return mean[kept], compact.reshape(-1, 3).astype(np.int32)
