"""Analytic surfaces as triangle meshes, for the tests of the scan's path through the code."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from kiribench.surface.mesh import Mesh, SurfacePoints

Array = NDArray[np.float64]


def parameter_mesh(
    width: float, height: float, edge: float, *, seed: int | None = None
) -> tuple[Array, NDArray[np.int32]]:
    """A rectangle cut into near-equilateral triangles; ``seed`` jitters the inner points.

    Returns (n, 2) points in [0, width] x [0, height] and (m, 3) counter-clockwise faces.
    """
    rows = max(2, round(height / (edge * np.sqrt(3) / 2))) + 1
    columns = max(2, round(width / edge)) + 1
    points = []
    for row in range(rows):
        y = height * row / (rows - 1)
        x = np.linspace(0, width, columns)
        if row % 2:
            x = np.concatenate([[0.0], (x[:-1] + x[1:]) / 2, [width]])
        points.append(np.column_stack([x, np.full(len(x), y)]))
    uv = np.concatenate(points)
    if seed is not None:
        rng = np.random.default_rng(seed)
        inner = (uv[:, 0] > 0) & (uv[:, 0] < width) & (uv[:, 1] > 0) & (uv[:, 1] < height)
        uv[inner] += rng.uniform(-0.25, 0.25, (int(inner.sum()), 2)) * edge
    faces = Delaunay(uv).simplices.astype(np.int32)
    p, q, r = (uv[faces[:, corner]] for corner in range(3))
    d, e = q - p, r - p
    turned = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0] < 0
    faces[turned] = faces[turned][:, [0, 2, 1]]
    area = np.abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])
    return uv, np.ascontiguousarray(faces[area > 1e-3 * edge**2])


def surface_mesh(
    place: Callable[[Array], Array],
    width: float,
    height: float,
    edge: float,
    *,
    seed: int | None = None,
) -> Mesh:
    """The rectangle's mesh carried onto a surface by ``place`` ((n, 2) -> (n, 3) mm)."""
    uv, faces = parameter_mesh(width, height, edge, seed=seed)
    return Mesh(np.ascontiguousarray(place(uv)), faces)


def on_cylinder(radius: float, width: float) -> Callable[[Array], Array]:
    """Isometric map of the rectangle onto a cylinder about z; the middle faces +y."""

    def place(uv: Array) -> Array:
        angle = (uv[:, 0] - width / 2) / radius
        # x falls with u, so that normals point away from the axis.
        return np.column_stack([-radius * np.sin(angle), radius * np.cos(angle), uv[:, 1]])

    return place


def on_sphere(radius: float, width: float, height: float) -> Callable[[Array], Array]:
    """The rectangle as longitude and latitude arcs about a sphere's equator, facing +y."""

    def place(uv: Array) -> Array:
        longitude = (uv[:, 0] - width / 2) / radius
        latitude = (uv[:, 1] - height / 2) / radius
        return radius * np.column_stack(
            [
                -np.sin(longitude) * np.cos(latitude),
                np.cos(longitude) * np.cos(latitude),
                np.sin(latitude),
            ]
        )

    return place


def on_knee(width: float, height: float) -> Callable[[Array], Array]:
    """A bent limb with a kneecap: no symmetry left but the mirror, facing +y.

    A centre line that bends in the y-z plane, a radius from 62 to 48 mm along it, and a bump.
    """

    def place(uv: Array) -> Array:
        angle = (uv[:, 0] - width / 2) / 55.0
        s = (uv[:, 1] - height / 2) / height
        bend = 0.9 * np.tanh(3 * s)
        along = height * s
        radius = 55.0 - 7.0 * np.tanh(2 * s) + 3.0 * np.cos(2 * angle)
        radius = radius + 7.0 * np.exp(-((angle - 0.1) ** 2) / 0.12 - (s + 0.03) ** 2 / 0.008)
        x = -radius * np.sin(angle)
        out = radius * np.cos(angle)
        y = out * np.cos(bend) - 30.0 * np.log(np.cosh(3 * s))
        z = along - out * np.sin(bend)
        return np.column_stack([x, y, z])

    return place


def with_noise(mesh: Mesh, sd_mm: float, seed: int, *, along_normals: bool = False) -> Mesh:
    """White noise on every vertex: isotropic, or along the vertex normals only."""
    rng = np.random.default_rng(seed)
    if not along_normals:
        return Mesh(mesh.vertices_mm + rng.normal(0, sd_mm, mesh.vertices_mm.shape), mesh.faces)
    normals = vertex_normals(mesh)
    shift = rng.normal(0, sd_mm, (len(normals), 1))
    return Mesh(mesh.vertices_mm + shift * normals, mesh.faces)


def vertex_normals(mesh: Mesh) -> Array:
    normals = np.zeros_like(mesh.vertices_mm)
    weighted = mesh.face_normals * mesh.face_areas_mm2[:, None]
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], weighted)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def surface_points(uv_mesh: tuple[Array, NDArray[np.int32]], points: Array) -> SurfacePoints:
    """Points of the rectangle (k, 2) as (face, barycentric) of its mesh."""
    uv, faces = uv_mesh
    p, q, r = (uv[faces[:, corner]] for corner in range(3))
    d, e = q - p, r - p
    area = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    face = np.empty(len(points), dtype=np.int32)
    weights = np.empty((len(points), 3))
    for row, point in enumerate(points):
        o = point - p
        b = (o[:, 0] * e[:, 1] - o[:, 1] * e[:, 0]) / area
        c = (d[:, 0] * o[:, 1] - d[:, 1] * o[:, 0]) / area
        inside = np.minimum(np.minimum(b, c), 1 - b - c)
        face[row] = np.argmax(inside)
        b_, c_ = b[face[row]], c[face[row]]
        weights[row] = np.clip((1 - b_ - c_, b_, c_), 0, 1)
    return SurfacePoints(face, weights / weights.sum(axis=1, keepdims=True))
