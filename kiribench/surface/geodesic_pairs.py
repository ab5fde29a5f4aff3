"""Pair after pair: a taut strip, then the proof that nothing is shorter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.surface.geodesic_flat import straight_is_shortest
from kiribench.surface.geodesic_kernels import NO_ROOM, Scratch, distance
from kiribench.surface.geodesic_strip import find_strip, shorten, walk_strip
from kiribench.surface.geodesic_trace import strip_polyline, window_polyline
from kiribench.surface.geodesic_windows import search
from kiribench.surface.mesh import FloatArray, IntArray

DONE = 0
NO_STRIP = -3  # no strip of faces joins the points
UNREACHED = -4  # nor does a path through vertices


@njit(cache=True)
def faces_at(
    faces: IntArray,
    twins: IntArray,
    offsets: IntArray,
    corners: IntArray,
    face: int,
    weights: FloatArray,
) -> Any:
    """All faces that hold a point: one, two across an edge, or those at a vertex; its weights."""
    zeros = 0
    for i in range(3):
        if weights[i] == 0.0:
            zeros += 1
    if zeros == 2:
        at = 0
        for i in range(3):
            if weights[i] > 0.0:
                at = i
        v = faces[face, at]
        n = offsets[v + 1] - offsets[v]
        held = np.empty(n, np.int32)
        place = np.zeros((n, 3))
        for k in range(n):
            corner = corners[offsets[v] + k]
            held[k] = corner // 3
            place[k, corner % 3] = 1.0
        return held, place
    other = -1
    edge = 0
    if zeros == 1:
        for i in range(3):
            if weights[(i + 2) % 3] == 0.0:
                edge = i
        other = twins[face, edge]
    held = np.empty(2 if other >= 0 else 1, np.int32)
    place = np.zeros((len(held), 3))
    held[0] = face
    place[0] = weights
    if other >= 0:
        held[1] = other // 3
        place[1, other % 3] = weights[(edge + 1) % 3]
        place[1, (other % 3 + 1) % 3] = weights[edge]
    return held, place


@njit(cache=True)
def _point(xyz: FloatArray, faces: IntArray, f: int, weights: FloatArray) -> FloatArray:
    p = np.zeros(3)
    for i in range(3):
        if weights[i] != 0.0:
            for x in range(3):
                p[x] += weights[i] * xyz[faces[f, i], x]
    return p


@njit(cache=True)
def solve_pairs(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    offsets: IntArray,
    corners: IntArray,
    source_faces: IntArray,
    source_weights: FloatArray,
    target_faces: IntArray,
    target_weights: FloatArray,
    first: int,
    unbounded: NDArray[np.bool_],
    paths: bool,
    lengths: FloatArray,
    path_offsets: NDArray[np.int64],
    work: Scratch,
) -> tuple[int, int]:
    """Solve the pairs from ``first`` on; the pair where it stopped, and why."""
    for k in range(first, len(lengths)):
        at = path_offsets[k]
        stamp = k + 1
        s = _point(xyz, faces, source_faces[k], source_weights[k])
        t = _point(xyz, faces, target_faces[k], target_weights[k])
        s_held, s_place = faces_at(
            faces, twins, offsets, corners, source_faces[k], source_weights[k]
        )
        t_held, t_place = faces_at(
            faces, twins, offsets, corners, target_faces[k], target_weights[k]
        )
        shared = -1
        for i in range(len(t_held)):
            work.target_stamp[t_held[i]] = stamp
        for i in range(len(s_held)):
            if work.target_stamp[s_held[i]] == stamp:
                shared = s_held[i]
        if shared >= 0:
            lengths[k] = distance(s, t)
            if paths:
                if at + 3 > len(work.path_mm):
                    return k, NO_ROOM
                work.path_mm[at] = s
                work.path_mm[at + 1] = t
                work.path_face[at] = shared
                work.path_face[at + 1] = shared
                at += 2
            path_offsets[k + 1] = at
            continue
        start, weights = source_faces[k], source_weights[k]
        bound = math.inf
        count = bends = 0
        if not unbounded[k]:
            count, at_face = walk_strip(xyz, faces, twins, s, s_held, s_place, t, stamp, work)
            if count > 0:
                start, weights = s_held[at_face], s_place[at_face]
            else:
                count = find_strip(xyz, faces, twins, s, start, t, stamp, work)
            if count == -1:
                return k, NO_STRIP
            if count >= 0:
                count, bends, bound = shorten(xyz, faces, twins, weights, s, t, count, work)
            if count == -2:
                return k, NO_ROOM
        strip_at = at
        if paths and not unbounded[k]:
            at = strip_polyline(
                xyz, faces, twins, s, start, weights, t, count, bends, strip_at, work
            )
            if at < 0:
                return k, NO_ROOM
        if count > 0 and bends == 0 and straight_is_shortest(
            xyz, faces, twins, offsets, corners, s, weights, start, t, t_held, t_place,
            bound, count, stamp, work,
        ):  # fmt: skip
            best, link = bound, -1
        else:
            best, link = search(
                xyz, faces, twins, offsets, corners, s_held, s_place, s, t_held, t_place, t,
                bound, stamp, work,
            )  # fmt: skip
        if link == NO_ROOM and best == 0.0:
            return k, NO_ROOM
        if link == -1 and unbounded[k]:
            return k, UNREACHED
        lengths[k] = best
        if paths and link != -1:
            t_face = t_held[0]
            if link < -1:  # the path ends with a straight line from a vertex
                for i in range(len(t_held)):
                    for j in range(3):
                        if faces[t_held[i], j] == -link - 2:
                            t_face = t_held[i]
            at = window_polyline(xyz, faces, twins, s, t, t_face, link, strip_at, work)
            if at < 0:
                return k, NO_ROOM
        path_offsets[k + 1] = at
    return len(lengths), DONE
