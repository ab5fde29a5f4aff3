"""Find points on a mesh: the closest one, or the one met along a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from kiribench.errors import NodesError
from kiribench.surface.face_grid import FaceGrid, box_index, face_grid
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints

_ON_FACE = 1e-12  # a line this close (in weights) beside a face still meets it


@dataclass(frozen=True, eq=False)
class Located:
    """Points found on a mesh.

    Attributes:
        points: k points as (face, barycentric); face -1 and weights 0 where nothing was hit.
        distance_mm: (k,) from the given points; along the line, signed positive along the
            direction, for ``project_along``; inf where nothing was hit.
        hit: (k,) bool; all True unless misses were allowed.
    """

    points: SurfacePoints
    distance_mm: FloatArray
    hit: NDArray[np.bool_]


def locate(mesh: Mesh, points_mm: ArrayLike, *, grid: FaceGrid | None = None) -> Located:
    """The closest point of ``mesh`` to each given point, exactly.

    Boxes of faces are searched outwards until no unseen box can be nearer than the best.

    Args:
        mesh: any triangles; topology does not matter.
        points_mm: (k, 3) in the mesh's frame.
        grid: ``face_grid(mesh)``, to share between calls.

    Raises:
        MeshError: an empty mesh, or vertices that are not finite.
        NodesError: a point is not finite; remedy: mark it missing.
    """
    points = _checked(points_mm, "point")
    grid = face_grid(mesh) if grid is None else grid
    xyz = np.ascontiguousarray(mesh.vertices_mm, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    found, weights, away = _closest(xyz, faces, *grid, points)
    return Located(SurfacePoints(found, weights), away, np.ones(len(points), np.bool_))


def project_along(
    mesh: Mesh,
    points_mm: ArrayLike,
    directions: ArrayLike,
    max_mm: float,
    *,
    allow_miss: bool = False,
    grid: FaceGrid | None = None,
) -> Located:
    """Where the line through each point meets ``mesh``, nearest first, in either sense.

    Args:
        mesh: any triangles.
        points_mm: (k, 3) in the mesh's frame.
        directions: (k, 3) or (3,), of any length but zero.
        max_mm: how far along the line to look.
        allow_miss: return misses with ``hit`` False instead of raising.
        grid: ``face_grid(mesh)``, to share between calls.

    Raises:
        NodesError: a line meets nothing within ``max_mm``; remedy: a larger ``max_mm``, or a
            scan without a hole there. Or a point or direction is not finite.
        MeshError: an empty mesh, or vertices that are not finite.
    """
    points = _checked(points_mm, "point")
    toward = np.broadcast_to(_checked(directions, "direction"), points.shape)
    length = np.linalg.norm(toward, axis=1, keepdims=True)
    if not (length > 0).all():
        raise NodesError(
            "direction-zero",
            f"Direction {int(np.argmin(length[:, 0] > 0))} has no length.",
            remedy="Give the surface normal, or any line, for every point.",
        )
    grid = face_grid(mesh) if grid is None else grid
    xyz = np.ascontiguousarray(mesh.vertices_mm, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    found, weights, along = _first_hits(
        xyz, faces, *grid, points, np.ascontiguousarray(toward / length), float(max_mm)
    )
    hit = found >= 0
    if not hit.all() and not allow_miss:
        missed = np.flatnonzero(~hit)
        shown = ", ".join(map(str, missed[:10])) + (", ..." if len(missed) > 10 else "")
        raise NodesError(
            "projection-miss",
            f"{len(missed)} of {len(points)} lines meet no surface (points {shown}).",
            remedy="Look farther (a larger limit), or mend the hole in the scan.",
            expected=f"a hit within {max_mm:g} mm",
        )
    return Located(SurfacePoints(found, weights), along, hit)


def _checked(values: ArrayLike, what: str) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64).reshape(-1, 3)
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise NodesError(
            "point-not-finite",
            f"{len(bad)} {what}s have coordinates that are not finite, first {what} {bad[0]}.",
            remedy="Mark these nodes as missing.",
        )
    return array


@njit(cache=True)
def _closest_on_face(
    xyz: FloatArray, faces: IntArray, f: int, p: FloatArray
) -> tuple[float, float, float, float]:
    """Squared distance and weights of the point of face ``f`` closest to ``p``."""
    best = np.inf
    w0 = w1 = w2 = 0.0
    a, b, c = xyz[faces[f, 0]], xyz[faces[f, 1]], xyz[faces[f, 2]]
    # Inside: the foot of the perpendicular, if it falls on the face and the face has an area.
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = nx * nx + ny * ny + nz * nz
    if area > 0.0:
        t1 = ((py * vz - pz * vy) * nx + (pz * vx - px * vz) * ny + (px * vy - py * vx) * nz) / area
        t2 = ((uy * pz - uz * py) * nx + (uz * px - ux * pz) * ny + (ux * py - uy * px) * nz) / area
        if t1 >= 0.0 and t2 >= 0.0 and t1 + t2 <= 1.0:
            dx = px - t1 * ux - t2 * vx
            dy = py - t1 * uy - t2 * vy
            dz = pz - t1 * uz - t2 * vz
            return dx * dx + dy * dy + dz * dz, 1.0 - t1 - t2, t1, t2
    for i in range(3):
        o, e = xyz[faces[f, i]], xyz[faces[f, (i + 1) % 3]]
        ux, uy, uz = e[0] - o[0], e[1] - o[1], e[2] - o[2]
        px, py, pz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
        length = ux * ux + uy * uy + uz * uz
        at = 0.0
        if length > 0.0:
            at = min(1.0, max(0.0, (ux * px + uy * py + uz * pz) / length))
        dx, dy, dz = px - at * ux, py - at * uy, pz - at * uz
        away = dx * dx + dy * dy + dz * dz
        if away < best:
            best = away
            if i == 0:
                w0, w1, w2 = 1.0 - at, at, 0.0
            elif i == 1:
                w0, w1, w2 = 0.0, 1.0 - at, at
            else:
                w0, w1, w2 = at, 0.0, 1.0 - at
    return best, w0, w1, w2


@njit(cache=True)
def _closest(
    xyz: FloatArray,
    faces: IntArray,
    low: FloatArray,
    box: float,
    shape: NDArray[np.int64],
    offsets: NDArray[np.int64],
    members: IntArray,
    large: IntArray,
    points: FloatArray,
) -> Any:
    k = len(points)
    found = np.full(k, -1, np.int32)
    weights = np.zeros((k, 3))
    away = np.full(k, np.inf)
    seen = np.full(len(faces), -1, np.int32)
    centre = np.empty(3, np.int64)
    for n in range(k):
        p = points[n]
        best = np.inf
        for f in large:
            d2, w0, w1, w2 = _closest_on_face(xyz, faces, f, p)
            if d2 < best:
                best = d2
                found[n] = f
                weights[n, 0], weights[n, 1], weights[n, 2] = w0, w1, w2
        outside = 0.0  # squared distance from the point to the grid
        inner = np.empty(3)
        for x in range(3):
            centre[x] = box_index(low, box, shape, x, p[x])
            inner[x] = min(max(p[x], low[x]), low[x] + box * shape[x])
            outside += (p[x] - inner[x]) ** 2
        reach = 0
        while True:
            i0, i1 = max(centre[0] - reach, 0), min(centre[0] + reach, shape[0] - 1)
            j0, j1 = max(centre[1] - reach, 0), min(centre[1] + reach, shape[1] - 1)
            k0, k1 = max(centre[2] - reach, 0), min(centre[2] + reach, shape[2] - 1)
            for i in range(i0, i1 + 1):
                rim_i = abs(i - centre[0]) == reach
                for j in range(j0, j1 + 1):
                    rim = rim_i or abs(j - centre[1]) == reach
                    step = 1 if rim or reach == 0 else 2 * reach
                    kk = k0 if rim else centre[2] - reach
                    while kk <= k1:
                        if kk >= k0:
                            cell = (i * shape[1] + j) * shape[2] + kk
                            for m in range(offsets[cell], offsets[cell + 1]):
                                f = members[m]
                                if seen[f] == n:
                                    continue
                                seen[f] = n
                                d2, w0, w1, w2 = _closest_on_face(xyz, faces, f, p)
                                if d2 < best:
                                    best = d2
                                    found[n] = f
                                    weights[n, 0], weights[n, 1], weights[n, 2] = w0, w1, w2
                        kk += step
            # Everything not yet seen lies beyond a side of the searched block.
            margin = np.inf
            for x in range(3):
                if centre[x] - reach > 0:
                    margin = min(margin, inner[x] - (low[x] + box * (centre[x] - reach)))
                if centre[x] + reach < shape[x] - 1:
                    margin = min(margin, low[x] + box * (centre[x] + reach + 1) - inner[x])
            if margin == np.inf:
                break
            margin = max(0.0, margin - 1e-9 * box)
            if best <= outside + margin * margin:
                break
            reach += 1
        away[n] = np.sqrt(best)
    return found, weights, away


@njit(cache=True)
def _hit_face(
    xyz: FloatArray, faces: IntArray, f: int, p: FloatArray, d: FloatArray
) -> tuple[float, float, float]:
    """Signed length along unit ``d`` to face ``f`` and two weights; inf if it is missed."""
    a, b, c = xyz[faces[f, 0]], xyz[faces[f, 1]], xyz[faces[f, 2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    qx, qy, qz = d[1] * vz - d[2] * vy, d[2] * vx - d[0] * vz, d[0] * vy - d[1] * vx
    bottom = ux * qx + uy * qy + uz * qz
    if bottom == 0.0:
        return np.inf, 0.0, 0.0
    w1 = (px * qx + py * qy + pz * qz) / bottom
    rx, ry, rz = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
    w2 = (d[0] * rx + d[1] * ry + d[2] * rz) / bottom
    if w1 < -_ON_FACE or w2 < -_ON_FACE or w1 + w2 > 1.0 + _ON_FACE:
        return np.inf, 0.0, 0.0
    return (vx * rx + vy * ry + vz * rz) / bottom, w1, w2


@njit(cache=True)
def _first_hits(
    xyz: FloatArray,
    faces: IntArray,
    low: FloatArray,
    box: float,
    shape: NDArray[np.int64],
    offsets: NDArray[np.int64],
    members: IntArray,
    large: IntArray,
    points: FloatArray,
    directions: FloatArray,
    limit: float,
) -> Any:
    k = len(points)
    found = np.full(k, -1, np.int32)
    weights = np.zeros((k, 3))
    along = np.full(k, np.inf)
    seen = np.full(len(faces), -1, np.int32)
    first = np.zeros(3, np.int64)
    last = np.zeros(3, np.int64)
    for n in range(k):
        p, d = points[n], directions[n]
        best = np.inf
        for m in range(len(large)):
            at, w1, w2 = _hit_face(xyz, faces, large[m], p, d)
            if abs(at) <= limit and abs(at) < abs(best):
                best = at
                found[n] = large[m]
                weights[n, 1], weights[n, 2] = w1, w2
        main = 0
        for x in range(3):
            if abs(d[x]) > abs(d[main]):
                main = x
        pad = 1e-9 * box
        # Slab by slab across the line's main axis, all boxes that the line touches there.
        ends = (p[main] - limit * abs(d[main]), p[main] + limit * abs(d[main]))
        if ends[1] < low[main] - pad or ends[0] > low[main] + box * shape[main] + pad:
            slabs = range(0)
        else:
            slabs = range(
                box_index(low, box, shape, main, ends[0] - pad),
                box_index(low, box, shape, main, ends[1] + pad) + 1,
            )
        for slab in slabs:
            t0 = (low[main] + box * slab - pad - p[main]) / d[main]
            t1 = (low[main] + box * (slab + 1) + pad - p[main]) / d[main]
            t0, t1 = max(min(t0, t1), -limit), min(max(t0, t1), limit)
            apart = t1 < t0
            for x in range(3):
                if x == main:
                    first[x] = last[x] = slab
                    continue
                c0, c1 = p[x] + t0 * d[x], p[x] + t1 * d[x]
                c0, c1 = min(c0, c1) - pad, max(c0, c1) + pad
                if c1 < low[x] or c0 > low[x] + box * shape[x] + pad:
                    apart = True
                first[x] = box_index(low, box, shape, x, c0)
                last[x] = box_index(low, box, shape, x, c1)
            if apart or (min(abs(t0), abs(t1)) > abs(best) and t0 * t1 > 0.0):
                continue
            for i in range(first[0], last[0] + 1):
                for j in range(first[1], last[1] + 1):
                    for kk in range(first[2], last[2] + 1):
                        cell = (i * shape[1] + j) * shape[2] + kk
                        for m in range(offsets[cell], offsets[cell + 1]):
                            f = members[m]
                            if seen[f] == n:
                                continue
                            seen[f] = n
                            at, w1, w2 = _hit_face(xyz, faces, f, p, d)
                            if abs(at) <= limit and abs(at) < abs(best):
                                best = at
                                found[n] = f
                                weights[n, 1], weights[n, 2] = w1, w2
        along[n] = best
        if found[n] >= 0:
            w1 = min(1.0, max(0.0, weights[n, 1]))
            w2 = min(1.0 - w1, max(0.0, weights[n, 2]))
            weights[n, 0], weights[n, 1], weights[n, 2] = 1.0 - w1 - w2, w1, w2
    return found, weights, along
