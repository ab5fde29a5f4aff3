"""Meshes and independent answers for the geodesic tests and the benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pygeodesic.geodesic
from scipy.spatial import ConvexHull, Delaunay, cKDTree

from kiribench.surface.mesh import Mesh, SurfacePoints

DATA = Path(__file__).parent / "data"
BENCHMARK = DATA / "geodesic_benchmark"


def read_obj(path: Path) -> Mesh:
    """Vertices and triangles of a plain OBJ."""
    vertices, faces = [], []
    for line in path.read_text().splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif kind == "f":
            faces.append([int(x.split("/")[0]) - 1 for x in rest])
    return Mesh(np.array(vertices), np.array(faces, np.int32))


def read_pygeodesic(path: Path) -> Mesh:
    """The text format of pygeodesic's own examples."""
    lines = path.read_text().splitlines()
    n, m = (int(x) for x in lines[0].split())
    vertices = [[float(x) for x in line.split()] for line in lines[1 : n + 1]]
    faces = [[int(x) for x in line.split()] for line in lines[n + 1 : n + m + 1]]
    return Mesh(np.array(vertices), np.array(faces, np.int32))


def at_vertices(mesh: Mesh, vertices: np.ndarray) -> SurfacePoints:
    """Vertices as (face, barycentric), each in one of its faces."""
    face = np.full(len(mesh.vertices_mm), -1, np.int32)
    corner = np.zeros(len(mesh.vertices_mm), np.int64)
    for i in range(3):
        face[mesh.faces[:, i]] = np.arange(len(mesh.faces))
        corner[mesh.faces[:, i]] = i
    vertices = np.asarray(vertices)
    weights = np.zeros((len(vertices), 3))
    weights[np.arange(len(vertices)), corner[vertices]] = 1.0
    return SurfacePoints(face[vertices], weights)


def inside_faces(mesh: Mesh, count: int, rng: np.random.Generator) -> SurfacePoints:
    """Points inside distinct faces, none nearer to an edge than 5 % of the face."""
    faces = rng.choice(len(mesh.faces), size=count, replace=False).astype(np.int32)
    weights = 0.05 + 0.85 * rng.dirichlet(np.ones(3), size=count)
    return SurfacePoints(faces, weights)


def with_points_as_vertices(mesh: Mesh, points: SurfacePoints) -> tuple[Mesh, np.ndarray]:
    """The same surface with each point a vertex (its face split in three), and their numbers.

    The points must lie inside distinct faces.
    """
    n = len(mesh.vertices_mm)
    new = np.arange(n, n + len(points), dtype=np.int32)
    a, b, c = mesh.faces[points.faces].T
    split = [np.stack([a, b, new], 1), np.stack([b, c, new], 1), np.stack([c, a, new], 1)]
    faces = np.concatenate([np.delete(mesh.faces, points.faces, axis=0), *split])
    vertices = np.concatenate([mesh.vertices_mm, points.positions_mm(mesh)])
    return Mesh(vertices, np.ascontiguousarray(faces, np.int32)), new


def mmp(mesh: Mesh, sources: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Exact distances between vertices, pair by pair, by pygeodesic (Kirsanov's MMP)."""
    algorithm = pygeodesic.geodesic.PyGeodesicAlgorithmExact(mesh.vertices_mm, mesh.faces)
    sources, targets = np.asarray(sources), np.asarray(targets)
    out = np.empty(len(sources))
    for source in np.unique(sources):
        of = np.flatnonzero(sources == source)
        out[of] = algorithm.geodesicDistances(np.array([source]), targets[of])[0]
    return out


def sheet(nx: int, ny: int, spacing_mm: float = 1.0) -> Mesh:
    """A flat rectangle of nx x ny vertices with all diagonals one way."""
    index = np.arange(nx * ny).reshape(nx, ny)
    a, b, c, d = (
        part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    x, y = np.meshgrid(np.arange(nx) * spacing_mm, np.arange(ny) * spacing_mm, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(nx * ny)], axis=1)
    return Mesh(vertices, faces.astype(np.int32))


def terrain(seed: int, count: int, height: float) -> Mesh:
    """A rough landscape over random plan points: saddles, peaks, slivers, a border."""
    rng = np.random.default_rng(seed)
    plan = rng.uniform(0.0, 10.0, size=(count, 2))
    faces = Delaunay(plan).simplices.astype(np.int32)
    vertices = np.column_stack([plan, rng.normal(0.0, height, size=count)])
    return Mesh(vertices, faces)


def polyhedron(seed: int, count: int, axes: tuple[float, float, float]) -> Mesh:
    """The convex hull of random points on an ellipsoid, all faces outwards."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * axes
    hull = ConvexHull(points)
    faces = hull.simplices.astype(np.int32)
    corner = points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = np.einsum("fx,fx->f", normal, hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return Mesh(points, faces)


def without_faces(mesh: Mesh, drop: np.ndarray) -> Mesh:
    """The mesh with a hole (vertices kept, possibly unused)."""
    return Mesh(mesh.vertices_mm, np.ascontiguousarray(mesh.faces[~drop]))


def quartered(mesh: Mesh) -> Mesh:
    """The same surface with every face cut in four at its edges' middles; vertices keep numbers."""
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middle = (len(mesh.vertices_mm) + inverse.reshape(-1, 3)).astype(np.int32)
    vertices = np.concatenate([mesh.vertices_mm, mesh.vertices_mm[unique].mean(axis=1)])
    a, b, c = mesh.faces.T
    ab, bc, ca = middle.T
    faces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return Mesh(vertices, np.concatenate([np.stack(f, 1) for f in faces]).astype(np.int32))


def knee_like(nx: int, ny: int, noise_mm: float = 0.0, seed: int = 0) -> tuple[Mesh, np.ndarray]:
    """A bent tube piece of 240 x 180 mm and more with a patella, and 412 grid pairs on it.

    Args:
        nx: vertices around.
        ny: vertices along; the mesh has 2 (nx - 1) (ny - 1) faces.
        noise_mm: sd of white noise along the normals.
        seed: of jitter and noise.

    Returns:
        The mesh and (412, 2) vertex numbers of adjacent nodes of a 17 x 13 grid of 15 mm.
    """
    rng = np.random.default_rng(seed)
    flat = sheet(nx, ny)
    u = np.linspace(-100.0, 100.0, nx)[(flat.vertices_mm[:, 0]).astype(int)]
    v = np.linspace(-130.0, 130.0, ny)[(flat.vertices_mm[:, 1]).astype(int)]
    u = u + rng.uniform(-0.25, 0.25, u.shape) * 200.0 / (nx - 1)
    v = v + rng.uniform(-0.25, 0.25, v.shape) * 260.0 / (ny - 1)
    radius = 62.0 + 8.0 * np.exp(-(((v - 40.0) / 60.0) ** 2))
    radius += 9.0 * np.exp(-((u / 28.0) ** 2) - (v / 30.0) ** 2)
    radius -= 3.0 * np.exp(-(((np.abs(u) - 35.0) / 15.0) ** 2) - (v / 25.0) ** 2)
    around, bend = u / 60.0, 0.5 * np.arctan(v / 40.0)
    front = radius * np.cos(around)
    vertices = np.stack(
        [radius * np.sin(around), front * np.cos(bend), v + 0.8 * front * np.sin(bend)], axis=1
    )
    mesh = Mesh(vertices, flat.faces)
    if noise_mm:
        normal = np.zeros_like(vertices)
        for corner in range(3):
            np.add.at(normal, flat.faces[:, corner], mesh.face_normals)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        mesh = Mesh(vertices + normal * rng.normal(0.0, noise_mm, (len(normal), 1)), flat.faces)
    node_u, node_v = np.meshgrid(np.arange(-6, 7) * 15.0, np.arange(-8, 9) * 15.0)
    nearest = cKDTree(np.stack([u, v], 1)).query(np.stack([node_u.ravel(), node_v.ravel()], 1))[1]
    node = nearest.reshape(17, 13)
    down = np.stack([node[:-1].ravel(), node[1:].ravel()], 1)
    across = np.stack([node[:, :-1].ravel(), node[:, 1:].ravel()], 1)
    return mesh, np.concatenate([down, across])
