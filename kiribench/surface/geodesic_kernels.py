"""What the geodesic kernels share: scratch arrays, a heap, and the plane frame of an edge."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from kiribench.surface.mesh import FloatArray, IntArray

FROM_SOURCE = -1  # link of a window or vertex reached straight from the source
NO_ROOM = -2  # a scratch array is too small
GAIN = 1e-12  # relative; a path must be shorter by this much to replace a known one


class Scratch(NamedTuple):
    """Arrays that the kernels reuse from pair to pair; a stamp says which pair wrote them.

    Shapes: ``face_*`` (m,), ``vertex_*`` (n,), ``strip_*`` (room,), ``path_*`` (room, 3)
    and (room,), ``window`` (room, 7), ``window_link`` (room, 2), ``heap_*`` (2 room,).
    """

    face_stamp: IntArray
    face_cost: FloatArray
    face_via: IntArray
    target_stamp: IntArray
    vertex_stamp: IntArray
    vertex_mm: FloatArray
    vertex_angle: FloatArray
    vertex_corner: IntArray
    vertex_parent: IntArray
    strip: IntArray
    strip_new: IntArray
    left: FloatArray
    right: FloatArray
    corner_portal: IntArray
    corner_side: IntArray
    path_mm: FloatArray
    path_face: IntArray
    window: FloatArray
    window_link: IntArray
    heap_key: FloatArray
    heap_item: IntArray
    laid_face: IntArray
    laid_over: IntArray
    laid_xy: FloatArray
    cut: FloatArray


def scratch(faces: int, vertices: int, room: int) -> Scratch:
    """Scratch arrays for a mesh of that size, with room for ``room`` windows or strip faces."""
    i32: Any = np.int32
    return Scratch(
        face_stamp=np.zeros(faces, i32),
        face_cost=np.empty(faces),
        face_via=np.empty(faces, i32),
        target_stamp=np.zeros(faces, i32),
        vertex_stamp=np.zeros(vertices, i32),
        vertex_mm=np.empty(vertices),
        vertex_angle=np.empty(vertices),
        vertex_corner=np.empty(vertices, i32),
        vertex_parent=np.empty(vertices, i32),
        strip=np.empty(room, i32),
        strip_new=np.empty(room, i32),
        left=np.empty((room, 2)),
        right=np.empty((room, 2)),
        corner_portal=np.empty(room, i32),
        corner_side=np.empty(room, i32),
        path_mm=np.empty((room, 3)),
        path_face=np.empty(room, i32),
        window=np.empty((room, 7)),
        window_link=np.empty((room, 2), i32),
        heap_key=np.empty(2 * room),
        heap_item=np.empty(2 * room, i32),
        laid_face=np.empty(room, i32),
        laid_over=np.empty(room, i32),
        laid_xy=np.empty((room, 6)),
        cut=np.empty((room, 6)),
    )


@njit(cache=True)
def heap_push(key: FloatArray, item: IntArray, size: int, k: float, value: int) -> int:
    """Add ``value`` with priority ``k`` to a binary heap of ``size`` items; the new size."""
    i = size
    while i > 0:
        up = (i - 1) >> 1
        if key[up] <= k:
            break
        key[i] = key[up]
        item[i] = item[up]
        i = up
    key[i] = k
    item[i] = value
    return size + 1


@njit(cache=True)
def heap_pop(key: FloatArray, item: IntArray, size: int) -> int:
    """Remove the smallest item (read it first at index 0); the new size."""
    size -= 1
    k = key[size]
    value = item[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        if child + 1 < size and key[child + 1] < key[child]:
            child += 1
        if key[child] >= k:
            break
        key[i] = key[child]
        item[i] = item[child]
        i = child
    key[i] = k
    item[i] = value
    return size


@njit(cache=True, inline="always")
def norm(x: float, y: float) -> float:
    """Length of a plane vector (faster than hypot; no overflow in millimetres)."""
    return math.sqrt(x * x + y * y)


@njit(cache=True)
def distance(a: FloatArray, b: FloatArray) -> float:
    """Straight distance of two points, each (3,)."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def in_edge_frame(
    xyz: FloatArray, o: int, e: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Length of the edge from vertex ``o`` to ``e``, and a point's place along and off it."""
    ox, oy, oz = xyz[o, 0], xyz[o, 1], xyz[o, 2]
    ux, uy, uz = xyz[e, 0] - ox, xyz[e, 1] - oy, xyz[e, 2] - oz
    wx, wy, wz = px - ox, py - oy, pz - oz
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    scale = 1.0 / length
    along = (ux * wx + uy * wy + uz * wz) * scale
    return length, along, math.sqrt(cx * cx + cy * cy + cz * cz) * scale


@njit(cache=True, error_model="numpy")
def vertex_in_edge_frame(xyz: FloatArray, o: int, e: int, p: int) -> tuple[float, float, float]:
    """As :func:`in_edge_frame`, for the vertex ``p``."""
    return in_edge_frame(xyz, o, e, xyz[p, 0], xyz[p, 1], xyz[p, 2])


@njit(cache=True)
def corner_angle(xyz: FloatArray, faces: IntArray, corner: int) -> float:
    """Angle of a face at one of its corners (``3 f + i``), in radians."""
    f, i = corner // 3, corner % 3
    v, a, b = faces[f, i], faces[f, (i + 1) % 3], faces[f, (i + 2) % 3]
    vx, vy, vz = xyz[v, 0], xyz[v, 1], xyz[v, 2]
    ux, uy, uz = xyz[a, 0] - vx, xyz[a, 1] - vy, xyz[a, 2] - vz
    wx, wy, wz = xyz[b, 0] - vx, xyz[b, 1] - vy, xyz[b, 2] - vz
    cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ux * wx + uy * wy + uz * wz)


@njit(cache=True, error_model="numpy")
def through_edge(
    b0: float, b1: float, sx: float, sy: float, tx: float, ty: float
) -> tuple[float, float]:
    """Length from (sx, -sy) through [b0, b1] on the x axis to (tx, ty), and the crossing."""
    depth = sy + ty
    x = sx + (tx - sx) * sy / depth if depth > 0.0 else tx
    if b0 < x < b1 and depth > 0.0:
        return norm(tx - sx, depth), x
    x = min(max(x, b0), b1)
    return norm(x - sx, sy) + norm(tx - x, ty), x
