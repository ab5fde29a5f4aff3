"""A grid of boxes over the faces of a mesh, to find the faces near a point or along a line."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.errors import MeshError
from kiribench.surface.mesh import FloatArray, IntArray, Mesh

MOST_BOXES_OF_A_FACE = 512  # a face over more boxes is tested always instead


class FaceGrid(NamedTuple):
    """Faces sorted into the boxes that their bounding boxes touch.

    Attributes:
        low_mm: (3,) corner of the grid.
        box_mm: edge of a box.
        shape: (3,) int64 boxes along x, y, z.
        offsets: (boxes + 1,) int64 into ``members``.
        members: face indices, box by box (z fastest).
        large: faces over too many boxes to list.
    """

    low_mm: FloatArray
    box_mm: float
    shape: NDArray[np.int64]
    offsets: NDArray[np.int64]
    members: IntArray
    large: IntArray


def face_grid(mesh: Mesh) -> FaceGrid:
    """Sort the faces of ``mesh`` into boxes of about twice their mean size.

    Raises:
        MeshError: no faces, or coordinates that are not finite.
    """
    if len(mesh.faces) == 0:
        raise MeshError(
            "mesh-empty", "The mesh has no faces.", remedy="Give a scan that holds a surface."
        )
    xyz = np.ascontiguousarray(mesh.vertices_mm, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    low, high, mean_size = _extent(xyz, faces)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise MeshError(
            "mesh-nan-vertex",
            "A face has a corner whose coordinates are not finite.",
            remedy="Repair the mesh first (repair_mesh drops such faces).",
        )
    span = high - low
    box = max(2.0 * mean_size, float(span.max()) / 1000.0, 1e-9 * (1.0 + float(np.abs(high).max())))
    while np.prod(np.floor(span / box) + 1) > 4 * len(faces) + 64:
        box *= 1.25
    shape = (np.floor(span / box) + 1).astype(np.int64)
    offsets, members, large = _sort(xyz, faces, low, box, shape)
    return FaceGrid(low, box, shape, offsets, members, large)


@njit(cache=True)
def _extent(xyz: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray, float]:
    """Bounding box of all faces and the mean of their longest extents; NaN spreads."""
    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    total = 0.0
    for f in range(len(faces)):
        size = 0.0
        for x in range(3):
            a, b, c = xyz[faces[f, 0], x], xyz[faces[f, 1], x], xyz[faces[f, 2], x]
            if not np.isfinite(a + b + c):
                low[x] = np.nan
            least, most = min(a, b, c), max(a, b, c)
            if least < low[x]:
                low[x] = least
            if most > high[x]:
                high[x] = most
            size = max(size, most - least)
        total += size
    return low, high, total / len(faces)


@njit(cache=True)
def box_index(grid_low: FloatArray, box: float, shape: NDArray[np.int64], x: int, v: float) -> int:
    """Index of the box that holds coordinate ``v`` on axis ``x``, clamped to the grid."""
    at = math.floor((v - grid_low[x]) / box)
    return int(min(max(at, 0), shape[x] - 1))


@njit(cache=True)
def _sort(
    xyz: FloatArray, faces: IntArray, low: FloatArray, box: float, shape: NDArray[np.int64]
) -> Any:
    boxes = shape[0] * shape[1] * shape[2]
    offsets = np.zeros(boxes + 1, np.int64)
    first = np.empty((len(faces), 3), np.int32)
    last = np.empty((len(faces), 3), np.int32)
    many = 0
    for f in range(len(faces)):
        count = 1
        for x in range(3):
            a, b, c = xyz[faces[f, 0], x], xyz[faces[f, 1], x], xyz[faces[f, 2], x]
            first[f, x] = box_index(low, box, shape, x, min(a, b, c))
            last[f, x] = box_index(low, box, shape, x, max(a, b, c))
            count *= last[f, x] - first[f, x] + 1
        if count > MOST_BOXES_OF_A_FACE:
            many += 1
            first[f, 0] = -1
            continue
        for i in range(first[f, 0], last[f, 0] + 1):
            for j in range(first[f, 1], last[f, 1] + 1):
                for k in range(first[f, 2], last[f, 2] + 1):
                    offsets[(i * shape[1] + j) * shape[2] + k + 1] += 1
    for n in range(boxes):
        offsets[n + 1] += offsets[n]
    members = np.empty(offsets[boxes], np.int32)
    fill = offsets[:-1].copy()
    large = np.empty(many, np.int32)
    many = 0
    for f in range(len(faces)):
        if first[f, 0] < 0:
            large[many] = f
            many += 1
            continue
        for i in range(first[f, 0], last[f, 0] + 1):
            for j in range(first[f, 1], last[f, 1] + 1):
                for k in range(first[f, 2], last[f, 2] + 1):
                    n = (i * shape[1] + j) * shape[2] + k
                    members[fill[n]] = f
                    fill[n] += 1
    return offsets, members, large
