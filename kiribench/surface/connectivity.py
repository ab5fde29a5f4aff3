"""Compiled loops over the connectivity of a triangle soup, however broken it is.

A half-edge ``3 f + i`` runs from corner ``i`` of face ``f`` to its next corner; a corner has
the number of the half-edge that leaves it. Everything is linear in the number of faces,
whatever the valences, so that hostile files cost no more than honest ones.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def edge_groups(faces, vertex_count):  # type: ignore[no-untyped-def]
    """Half-edges grouped by edge.

    Returns order (3m,) int32, the half-edges sorted by their two vertices, and starts (e+1,)
    int64, where each edge's half-edges begin in ``order``. Two stable counting sorts.
    """
    total = 3 * len(faces)
    order = np.empty(total, np.int32)
    first = np.empty(total, np.int32)
    counts = np.zeros(vertex_count + 1, np.int64)
    for half in range(total):
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        counts[max(a, b) + 1] += 1
    for vertex in range(vertex_count):
        counts[vertex + 1] += counts[vertex]
    for half in range(total):
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        key = max(a, b)
        first[counts[key]] = half
        counts[key] += 1
    counts[:] = 0
    for half in range(total):
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        counts[min(a, b) + 1] += 1
    for vertex in range(vertex_count):
        counts[vertex + 1] += counts[vertex]
    for place in range(total):
        half = first[place]
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        key = min(a, b)
        order[counts[key]] = half
        counts[key] += 1
    edges = 0
    starts = np.empty(total + 1, np.int64)
    low = high = -1
    for place in range(total):
        half = order[place]
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        if min(a, b) != low or max(a, b) != high:
            low, high = min(a, b), max(a, b)
            starts[edges] = place
            edges += 1
    starts[edges] = total
    return order, starts[: edges + 1].copy()


@njit(cache=True)
def _root(parent, item):  # type: ignore[no-untyped-def]
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


@njit(cache=True)
def _join(parent, a, b):  # type: ignore[no-untyped-def]
    a, b = _root(parent, a), _root(parent, b)
    if a < b:
        parent[b] = a
    else:
        parent[a] = b


@njit(cache=True)
def face_components(faces, order, starts, across_nonmanifold):  # type: ignore[no-untyped-def]
    """(m,) int32: the lowest face of each face's edge-connected component.

    Edges with three or more faces join nothing unless ``across_nonmanifold``.
    """
    parent = np.arange(len(faces)).astype(np.int32)
    for edge in range(len(starts) - 1):
        begin, end = starts[edge], starts[edge + 1]
        if end - begin == 2 or (across_nonmanifold and end - begin > 2):
            for place in range(begin + 1, end):
                _join(parent, order[begin] // 3, order[place] // 3)
    for face in range(len(faces)):
        parent[face] = _root(parent, face)
    return parent


@njit(cache=True)
def corner_fans(faces, order, starts):  # type: ignore[no-untyped-def]
    """(3m,) int32: the lowest corner of each corner's fan.

    Two corners at one vertex are in one fan if their faces share an edge at that vertex. A
    vertex with several fans is a bow-tie.
    """
    parent = np.arange(3 * len(faces)).astype(np.int32)
    for edge in range(len(starts) - 1):
        begin, end = starts[edge], starts[edge + 1]
        half = order[begin]
        tail = half
        head = half - 2 if half % 3 == 2 else half + 1
        at_tail = faces[tail // 3, tail % 3]
        for place in range(begin + 1, end):
            other = order[place]
            other_head = other - 2 if other % 3 == 2 else other + 1
            if faces[other // 3, other % 3] == at_tail:
                _join(parent, tail, other)
                _join(parent, head, other_head)
            else:
                _join(parent, tail, other_head)
                _join(parent, head, other)
    for corner in range(len(parent)):
        parent[corner] = _root(parent, corner)
    return parent


@njit(cache=True)
def split_fans(faces, fans, vertex_count):  # type: ignore[no-untyped-def]
    """Give every fan its own vertex.

    Returns the faces (m, 3) int32 and, for every vertex beyond ``vertex_count``, the vertex
    that it repeats, (extra,) int32. The first fan of a vertex keeps it.
    """
    new_faces = faces.copy()
    taken = np.zeros(vertex_count, np.bool_)
    label = np.full(len(fans), -1, np.int32)
    extra = np.empty(len(fans), np.int32)
    count = 0
    for corner in range(len(fans)):
        root = fans[corner]
        vertex = faces[corner // 3, corner % 3]
        if label[root] < 0:
            if taken[vertex]:
                label[root] = vertex_count + count
                extra[count] = vertex
                count += 1
            else:
                taken[vertex] = True
                label[root] = vertex
        new_faces[corner // 3, corner % 3] = label[root]
    return new_faces, extra[:count].copy()


@njit(cache=True)
def orientation(faces, order, starts):  # type: ignore[no-untyped-def]
    """Signs that would make the winding consistent across every edge of two faces.

    Returns flip (m,) bool relative to the lowest face of each component, the number of edges
    whose two faces disagree as they are, and the number that no choice of signs satisfies
    (more than 0: the surface has one side only, like a Moebius strip).
    """
    count = len(faces)
    across = np.full((count, 3), -1, np.int32)
    same = np.zeros((count, 3), np.bool_)
    disagreeing = 0
    for edge in range(len(starts) - 1):
        if starts[edge + 1] - starts[edge] != 2:
            continue
        a, b = order[starts[edge]], order[starts[edge] + 1]
        equal = faces[a // 3, a % 3] == faces[b // 3, b % 3]
        across[a // 3, a % 3] = b // 3
        across[b // 3, b % 3] = a // 3
        same[a // 3, a % 3] = equal
        same[b // 3, b % 3] = equal
        disagreeing += equal
    flip = np.zeros(count, np.bool_)
    seen = np.zeros(count, np.bool_)
    queue = np.empty(count, np.int32)
    conflicts = 0
    for seed in range(count):
        if seen[seed]:
            continue
        seen[seed] = True
        queue[0] = seed
        head, tail = 0, 1
        while head < tail:
            face = queue[head]
            head += 1
            for side in range(3):
                other = across[face, side]
                if other < 0:
                    continue
                wanted = flip[face] != same[face, side]
                if not seen[other]:
                    seen[other] = True
                    flip[other] = wanted
                    queue[tail] = other
                    tail += 1
                elif flip[other] != wanted:
                    conflicts += 1
    return flip, disagreeing, conflicts // 2


@njit(cache=True)
def coincident_vertices(bits):  # type: ignore[no-untyped-def]
    """(n,) int32: the lowest vertex with the very same coordinates.

    ``bits`` (n, 3) uint64: the coordinates' bit patterns, -0 made 0. Open addressing.
    """
    count = len(bits)
    size = 16
    while size < 2 * count:
        size *= 2
    mask = np.uint64(size - 1)
    table = np.full(size, -1, np.int32)
    representative = np.empty(count, np.int32)
    for vertex in range(count):
        key = bits[vertex, 0] * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ (key >> np.uint64(29))) + bits[vertex, 1]
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ (key >> np.uint64(32))) + bits[vertex, 2]
        key *= np.uint64(0x94D049BB133111EB)
        slot = (key ^ (key >> np.uint64(31))) & mask
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = vertex
                representative[vertex] = vertex
                break
            if (
                bits[other, 0] == bits[vertex, 0]
                and bits[other, 1] == bits[vertex, 1]
                and bits[other, 2] == bits[vertex, 2]
            ):
                representative[vertex] = other
                break
            slot = (slot + np.uint64(1)) & mask
    return representative


@njit(cache=True)
def closing_vertices(faces, welded, order, starts):  # type: ignore[no-untyped-def]
    """(n,) bool: vertices whose welding joins two edges that are separate in ``faces``.

    ``welded`` is ``faces`` with coincident vertices made one, ``order`` and ``starts`` its edge
    groups. Vertices that only touch (the two halves of a bow-tie) are not among them.
    """
    closing = np.zeros(faces.max() + 1, np.bool_)
    for edge in range(len(starts) - 1):
        begin, end = starts[edge], starts[edge + 1]
        half = order[begin]
        a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
        low, high = min(a, b), max(a, b)
        differs = False
        for place in range(begin + 1, end):
            half = order[place]
            c, d = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
            differs |= min(c, d) != low or max(c, d) != high
        if differs:
            for place in range(begin, end):
                half = order[place]
                closing[faces[half // 3, half % 3]] = True
                closing[faces[half // 3, (half + 1) % 3]] = True
    return closing


@njit(cache=True)
def duplicate_faces(faces):  # type: ignore[no-untyped-def]
    """(m,) int32: the lowest face with the same three vertices, in any order."""
    count = len(faces)
    size = 16
    while size < 2 * count:
        size *= 2
    mask = np.uint64(size - 1)
    table = np.full(size, -1, np.int32)
    first = np.empty(count, np.int32)
    for face in range(count):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        low, high = min(a, b, c), max(a, b, c)
        middle = a + b + c - low - high
        key = np.uint64(low) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ (key >> np.uint64(29))) + np.uint64(middle)
        key *= np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ (key >> np.uint64(32))) + np.uint64(high)
        key *= np.uint64(0x94D049BB133111EB)
        slot = (key ^ (key >> np.uint64(31))) & mask
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = face
                first[face] = face
                break
            d, e, f = faces[other, 0], faces[other, 1], faces[other, 2]
            lowest, highest = min(d, e, f), max(d, e, f)
            if lowest == low and highest == high and d + e + f - lowest - highest == middle:
                first[face] = other
                break
            slot = (slot + np.uint64(1)) & mask
    return first
