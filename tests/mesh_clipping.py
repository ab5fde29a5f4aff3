"""A second way to the overlap: cells cut out of the mesh itself, no flattening map.

The sides are taken with every edge that they cross, so they lie on the triangles. The part
of the mesh near a cell is a graph over the tangent plane at the cell's centre: seen along
the normal, the sides keep their order, the intersection is planar, and each triangle's
share of it is divided by the cosine of the triangle's tilt.
"""

from __future__ import annotations

import numpy as np
import shapely

from kiribench.surface.cells import GridSides
from kiribench.surface.mesh import Mesh


def ring(sides: GridSides, r: int, c: int) -> np.ndarray:
    """(n, 3) points of a cell's outline with every crossed edge."""
    top = sides.paths.path(sides.lateral_path[r, c])
    medial = sides.paths.path(sides.longitudinal_path[r, c + 1])
    bottom = sides.paths.path(sides.lateral_path[r + 1, c])[::-1]
    lateral = sides.paths.path(sides.longitudinal_path[r, c])[::-1]
    return np.concatenate([top[:-1], medial[:-1], bottom[:-1], lateral[:-1]])


def mesh_overlap(
    mesh: Mesh, skin: GridSides, patch: GridSides, r: int, c: int
) -> tuple[float, float, float]:
    """Areas on the mesh, mm^2, of the skin cell, the patch cell and their intersection."""
    rings = [ring(skin, r, c), ring(patch, r, c)]
    centre = rings[0].mean(axis=0)
    reach = max(np.linalg.norm(p - centre, axis=1).max() for p in rings) + 3.0
    near = np.flatnonzero(np.linalg.norm(mesh.corners_mm - centre, axis=2).min(axis=1) < reach)
    normal = (mesh.face_normals[near] * mesh.face_areas_mm2[near, None]).sum(axis=0)
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first)], axis=1)
    tilt = mesh.face_normals[near] @ normal
    triangles = shapely.polygons((mesh.corners_mm[near] - centre) @ axes)
    s, k = (shapely.Polygon((p - centre) @ axes) for p in rings)

    def area(region: shapely.Geometry) -> float:
        share = shapely.area(shapely.intersection(triangles, region))
        hit = share > 0.0
        if not (tilt[hit] > 0.2).all():
            raise ValueError("the mesh is no graph over the cell's tangent plane")
        return float((share[hit] / tilt[hit]).sum())

    return area(s), area(k), area(s.intersection(k))
