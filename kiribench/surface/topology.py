"""Which face lies across each edge, and which faces meet at each vertex."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.errors import Fault, MeshError
from kiribench.surface.mesh import FloatArray, IntArray, Mesh

_REPEATED_VERTEX = 0
_CROWDED_EDGE = 1
_SAME_DIRECTION = 2
_ZERO_EDGE = 3
_SLOTS = 8  # edges to higher vertices; a vertex with more takes the careful way


@dataclass(frozen=True, eq=False)
class Topology:
    """The neighbourhood tables of an edge-manifold, orientable mesh.

    Half-edge ``3 f + i`` runs from corner ``i`` to corner ``i + 1`` of face ``f`` in ``faces``.

    Attributes:
        faces: (m, 3) int32, the mesh's faces, all wound one way: where ``reversed_faces`` says
            so, the second and third corner are swapped.
        reversed_faces: (m,) bool; all False on a consistently wound mesh.
        twins: (m, 3) int32, the half-edge that runs the other way in the neighbouring
            face; -1 on a border.
        corner_offsets: (n + 1,) int32; the corners at vertex ``v`` are
            ``corners[corner_offsets[v] : corner_offsets[v + 1]]``.
        corners: (3 m,) int32, corners as ``3 f + i``, grouped by vertex.
    """

    faces: IntArray
    reversed_faces: NDArray[np.bool_]
    twins: IntArray
    corner_offsets: IntArray
    corners: IntArray

    @cached_property
    def neighbours(self) -> IntArray:
        """(m, 3) int32, the face across edge (i, i + 1) of the mesh's face; -1 on a border."""
        across = np.where(self.twins < 0, np.int32(-1), self.twins // 3).astype(np.int32)
        across[self.reversed_faces] = across[self.reversed_faces][:, ::-1]
        return across

    @cached_property
    def components(self) -> IntArray:
        """(m,) int32, a number a connected piece; faces that share a vertex are connected."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        faces = len(self.twins)
        vertices = len(self.corner_offsets) - 1
        owner = np.repeat(np.arange(vertices), np.diff(self.corner_offsets))
        graph = coo_array(
            (np.ones(3 * faces, np.int8), (self.corners // 3, faces + owner)),
            shape=(faces + vertices, faces + vertices),
        )
        return np.asarray(connected_components(graph, directed=False)[1][:faces], np.int32)


def topology(mesh: Mesh) -> Topology:
    """Pair the half-edges of ``mesh``.

    Raises:
        MeshError: an index is out of range, a vertex is not finite, a face repeats a vertex,
            an edge has no length, three faces share an edge, or the surface has one side only
            (a Moebius strip); remedy: ``repair_mesh`` first. Neighbours that are wound against
            each other are turned here, in the tables only.
    """
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    vertices = len(mesh.vertices_mm)
    if len(faces) == 0:
        raise MeshError(
            "mesh-empty", "The mesh has no faces.", remedy="Give a scan that holds a surface."
        )
    if int(faces.min()) < 0 or int(faces.max()) >= vertices:
        raise MeshError(
            "mesh-index-range",
            "A face names a vertex that does not exist.",
            remedy="Export the scan again; the file is damaged.",
            got=f"indices {int(faces.min())} to {int(faces.max())}",
            expected=f"0 to {vertices - 1}",
        )
    used = mesh.vertices_mm
    if not np.isfinite(used).all():
        bad = np.flatnonzero(~np.isfinite(used).all(axis=1))
        raise MeshError(
            "mesh-nan-vertex",
            f"{len(bad)} vertices have coordinates that are not finite, first vertex {bad[0]}.",
            remedy="Repair the mesh first (repair_mesh drops them).",
        )
    xyz = np.ascontiguousarray(used, dtype=np.float64)
    turned = np.zeros(len(faces), np.bool_)
    ready, twins, offsets, corners = _pair_quickly(xyz, faces)
    if ready:
        return Topology(faces, turned, twins, offsets, corners)
    twins, offsets, corners, counts, examples = _pair(xyz, faces)
    if counts[_SAME_DIRECTION] and not np.delete(counts, _SAME_DIRECTION).any():
        turned = _turns(faces, offsets, corners)
        faces = np.where(turned[:, None], faces[:, [0, 2, 1]], faces)
        twins, offsets, corners, counts, examples = _pair(xyz, faces)
    if counts.any():
        raise MeshError.of(_faults(counts, examples))
    return Topology(faces, turned, twins, offsets, corners)


def _faults(counts: NDArray[np.int64], examples: NDArray[np.int64]) -> list[Fault]:
    meanings = {
        _REPEATED_VERTEX: ("mesh-degenerate-face", "faces name the same vertex twice"),
        _ZERO_EDGE: ("mesh-zero-edge", "edges have no length"),
        _CROWDED_EDGE: ("mesh-nonmanifold-edge", "edges are shared by three or more faces"),
        _SAME_DIRECTION: (
            "mesh-one-sided",
            "edges cannot be wound one way: the surface has one side",
        ),
    }
    return [
        Fault(
            code=code,
            what=f"{counts[kind]} {what}, for example at face {examples[kind]}.",
            remedy="Repair the mesh first (repair_mesh), or clean it in the scanner's software.",
        )
        for kind, (code, what) in meanings.items()
        if counts[kind]
    ]


@njit(cache=True)
def _group(faces: IntArray, vertices: int) -> tuple[IntArray, IntArray]:
    """Corners grouped by vertex (counting sort): offsets and corners."""
    m = faces.shape[0]
    offsets = np.zeros(vertices + 1, np.int32)
    for f in range(m):
        for i in range(3):
            offsets[faces[f, i] + 1] += 1
    for v in range(vertices):
        offsets[v + 1] += offsets[v]
    corners = np.empty(3 * m, np.int32)
    fill = offsets[:-1].copy()
    for f in range(m):
        for i in range(3):
            v = faces[f, i]
            corners[fill[v]] = 3 * f + i
            fill[v] += 1
    return offsets, corners


@njit(cache=True)
def _pair_quickly(xyz: FloatArray, faces: IntArray) -> tuple[bool, IntArray, IntArray, IntArray]:
    """Match half-edges in one pass; False for a mesh with a fault or a vertex of many edges.

    Each edge waits in a slot of its lower vertex until its second face comes.
    """
    m, vertices = faces.shape[0], xyz.shape[0]
    waiting = np.empty((vertices, _SLOTS, 2), np.int32)
    filled = np.zeros(vertices, np.int32)
    twins = np.full((m, 3), -1, np.int32)
    offsets = np.empty(0, np.int32)
    corners = np.empty(0, np.int32)
    for f in range(m):
        for i in range(3):
            a, b = faces[f, i], faces[f, i + 1 if i < 2 else 0]
            low, high = min(a, b), max(a, b)
            count = filled[low]
            at = 0
            while at < count and waiting[low, at, 0] != high:
                at += 1
            if at < count:
                other = waiting[low, at, 1]
                if other < 0 or faces[other // 3, other % 3] == a:
                    return False, twins, offsets, corners
                twins[f, i] = other
                twins[other // 3, other % 3] = 3 * f + i
                waiting[low, at, 1] = -1
                continue
            same = xyz[a, 0] == xyz[b, 0] and xyz[a, 1] == xyz[b, 1] and xyz[a, 2] == xyz[b, 2]
            if same or count == _SLOTS:
                return False, twins, offsets, corners
            waiting[low, count, 0] = high
            waiting[low, count, 1] = 3 * f + i
            filled[low] = count + 1
    offsets, corners = _group(faces, vertices)
    return True, twins, offsets, corners


@njit(cache=True)
def _pair(xyz: FloatArray, faces: IntArray) -> Any:
    """Match half-edges vertex by vertex; counts every kind of fault, with an example."""
    m, vertices = faces.shape[0], xyz.shape[0]
    offsets, corners = _group(faces, vertices)
    twins = np.full((m, 3), -1, np.int32)
    counts = np.zeros(4, np.int64)
    examples = np.full(4, -1, np.int64)
    # At vertex v the half-edge that leaves for w (corner's own) pairs with the one that comes
    # from w (the half-edge before another corner). A fan may be large: then sort, not compare.
    for v in range(vertices):
        begin, end = offsets[v], offsets[v + 1]
        k = end - begin
        if k == 0:
            continue
        leaves = np.empty(k, np.int64)
        comes = np.empty(k, np.int64)
        for j in range(k):
            f, i = corners[begin + j] // 3, corners[begin + j] % 3
            leaves[j] = np.int64(faces[f, (i + 1) % 3]) * k + j
            comes[j] = np.int64(faces[f, (i + 2) % 3]) * k + j
        if k > 12:
            leaves.sort()
            comes.sort()
        else:
            _insertion_sort(leaves)
            _insertion_sort(comes)
        a = b = 0
        while a < k or b < k:
            w = np.int64(1) << 62
            if a < k:
                w = leaves[a] // k
            if b < k:
                w = min(w, comes[b] // k)
            a0, b0 = a, b
            while a < k and leaves[a] // k == w:
                a += 1
            while b < k and comes[b] // k == w:
                b += 1
            out, back = a - a0, b - b0
            corner = corners[begin + (leaves[a0] if out > 0 else comes[b0]) % k]
            if w == v:
                counts[_REPEATED_VERTEX] += out
                examples[_REPEATED_VERTEX] = corner // 3
                continue
            if v < w and (
                xyz[v, 0] == xyz[w, 0] and xyz[v, 1] == xyz[w, 1] and xyz[v, 2] == xyz[w, 2]
            ):
                counts[_ZERO_EDGE] += 1
                examples[_ZERO_EDGE] = corner // 3
            if out + back > 2:
                if v < w:
                    counts[_CROWDED_EDGE] += 1
                    examples[_CROWDED_EDGE] = corner // 3
            elif out == 2 or back == 2:
                if v < w:
                    counts[_SAME_DIRECTION] += 1
                    examples[_SAME_DIRECTION] = corner // 3
            elif out == 1 and back == 1:
                other = corners[begin + comes[b0] % k]
                g, i = other // 3, other % 3
                twins[corner // 3, corner % 3] = 3 * g + (i + 2) % 3
    return twins, offsets, corners, counts, examples


@njit(cache=True)
def _insertion_sort(values: NDArray[np.int64]) -> None:
    for i in range(1, len(values)):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value


@njit(cache=True)
def _turns(faces: IntArray, offsets: IntArray, corners: IntArray) -> NDArray[np.bool_]:
    """Which faces to reverse so that neighbours agree; each piece keeps its first face."""
    m = faces.shape[0]
    turned = np.zeros(m, np.bool_)
    seen = np.zeros(m, np.bool_)
    stack = np.empty(m, np.int32)
    for first in range(m):
        if seen[first]:
            continue
        seen[first] = True
        stack[0] = first
        size = 1
        while size > 0:
            size -= 1
            f = stack[size]
            for i in range(3):
                a, b = faces[f, i], faces[f, (i + 1) % 3]
                for k in range(offsets[a], offsets[a + 1]):
                    g, j = corners[k] // 3, corners[k] % 3
                    if g == f or seen[g]:
                        continue
                    same = faces[g, (j + 1) % 3] == b
                    if same or faces[g, (j + 2) % 3] == b:
                        seen[g] = True
                        turned[g] = turned[f] != same
                        stack[size] = g
                        size += 1
    return turned
