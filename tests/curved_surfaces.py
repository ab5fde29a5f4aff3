"""Surfaces with closed-form cells: meshes of spheres and cylinders, nodes, true overlaps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from kiribench.surface.locate import locate
from kiribench.surface.mesh import Mesh
from kiribench.surface.nodes import LocatedNodes

#: A material map: (k, 2) mm on the drawing plane to (k, 3) mm on the surface.
Map = Callable[[np.ndarray], np.ndarray]


def sphere_map(radius_mm: float) -> Map:
    """Azimuthal equidistant map: the drawing plane rolled about the north pole."""

    def to_sphere(uv: np.ndarray) -> np.ndarray:
        arc = np.linalg.norm(uv, axis=-1) / radius_mm
        direction = uv / np.maximum(np.linalg.norm(uv, axis=-1, keepdims=True), 1e-300)
        return radius_mm * np.concatenate(
            [np.sin(arc)[..., None] * direction, np.cos(arc)[..., None]], axis=-1
        )

    return to_sphere


def cylinder_map(radius_mm: float) -> Map:
    """Isometric map: v wraps around the axis, u runs along it."""

    def to_cylinder(uv: np.ndarray) -> np.ndarray:
        angle = uv[..., 1] / radius_mm
        return np.stack([uv[..., 0], radius_mm * np.sin(angle), radius_mm * np.cos(angle)], axis=-1)

    return to_cylinder


def patch_mesh(surface: Map, half_mm: tuple[float, float], edge_mm: float, seed: int = 0) -> Mesh:
    """A jittered triangulation of the image of a rectangle, faces outwards (+z at the pole)."""
    counts = [int(np.ceil(2 * half / edge_mm)) + 1 for half in half_mm]
    u, v = (np.linspace(-half, half, n) for half, n in zip(half_mm, counts, strict=True))
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    jitter = np.random.default_rng(seed).uniform(-0.25, 0.25, size=uv.shape) * edge_mm
    jitter[[0, -1]] = 0.0
    jitter[:, [0, -1]] = 0.0
    index = np.arange(counts[0] * counts[1]).reshape(counts)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return Mesh(surface((uv + jitter).reshape(-1, 2)), faces.astype(np.int32))


def grid_uv(rows: int, columns: int, cell_mm: float = 15.0) -> np.ndarray:
    """(rows + 1, columns + 1, 2) nodes of a centred grid; u distal, v medial."""
    u = (np.arange(rows + 1) - 0.5 * rows) * cell_mm
    v = (np.arange(columns + 1) - 0.5 * columns) * cell_mm
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)


def nodes_on(mesh: Mesh, positions: np.ndarray, sd_mm: float = 0.25) -> LocatedNodes:
    """Nodes at (R+1, C+1, 3) positions, put on the mesh; NaN positions are absent."""
    present = np.isfinite(positions).all(axis=-1)
    found = locate(mesh, positions[present])
    index = np.full(present.shape, -1, dtype=np.int32)
    index[present] = np.arange(int(present.sum()), dtype=np.int32)
    on = np.full(positions.shape, np.nan)
    on[present] = found.points.positions_mm(mesh)
    offset = np.full(present.shape, np.nan)
    offset[present] = found.distance_mm
    return LocatedNodes(found.points, index, np.full(present.shape, sd_mm), offset, on, "column")


def cell(nodes: np.ndarray, r: int, c: int) -> np.ndarray:
    """(4, ...) corners of a cell of a node grid."""
    return np.stack([nodes[r, c], nodes[r, c + 1], nodes[r + 1, c + 1], nodes[r + 1, c]])


def spherical_overlap(skin: np.ndarray, patch: np.ndarray) -> tuple[float, float, float]:
    """Exact areas on the unit sphere of two great-circle quads and of their intersection.

    Great circles are straight lines in the gnomonic projection, so the intersection is a
    planar one there; its area on the sphere is the sum of its angles less (n - 2) pi.
    """
    pole = skin.mean(axis=0) / np.linalg.norm(skin.mean(axis=0))
    first = np.cross(pole, [1.0, 0.0, 0.0] if abs(pole[0]) < 0.9 else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(pole, first)

    def gnomonic(points: np.ndarray) -> shapely.Polygon:
        height = points @ pole
        return shapely.Polygon(
            np.stack([points @ first / height, points @ second / height], axis=1)
        )

    def area(polygon: shapely.Polygon) -> float:
        if polygon.is_empty:
            return 0.0
        xy = np.array(shapely.geometry.polygon.orient(polygon).exterior.coords)[:-1]
        p = pole + xy[:, :1] * first + xy[:, 1:] * second
        p /= np.linalg.norm(p, axis=1, keepdims=True)
        before, after = np.roll(p, 1, axis=0), np.roll(p, -1, axis=0)
        total = 0.0
        for a, b, c in zip(before, p, after, strict=True):
            u, w = a - (a @ b) * b, c - (c @ b) * b
            turn = np.arctan2(np.cross(w, u) @ b, w @ u)
            total += turn % (2.0 * np.pi)
        return float(total - (len(p) - 2) * np.pi)

    s, k = gnomonic(skin), gnomonic(patch)
    return area(s), area(k), area(s.intersection(k))


def flat_overlap(skin: np.ndarray, patch: np.ndarray) -> tuple[float, float, float]:
    """Exact areas of two straight-sided quads on a developed surface, (4, 2) each."""
    s, k = shapely.Polygon(skin), shapely.Polygon(patch)
    return s.area, k.area, s.intersection(k).area


def three_overlaps(areas: tuple[float, float, float]) -> np.ndarray:
    """(paper, strict, iou) of (skin, patch, both) areas."""
    skin, patch, both = areas
    return np.array([both / skin, both / max(skin, patch), both / (skin + patch - both)])
