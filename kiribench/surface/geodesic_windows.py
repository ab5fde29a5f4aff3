"""Exact search for any path shorter than a known one: windows, pruned by the two ends.

A window is an interval of an edge that one pseudo-source sees through one sequence of faces
(Mitchell, Mount and Papadimitriou 1987, doi:10.1137/0216045; Chen and Han 1990). Windows are
taken in the order of their distance; those that a vertex already reached makes useless are
dropped (Xin and Wang 2009, doi:10.1145/1559755.1559761), and so is every window whose best
continuation, a straight line in space to the target, is no shorter than the path already
known. On skin, where that path is nearly straight, few windows are left, and when none is
left the known path is proved shortest.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from kiribench.surface.geodesic_bends import push, push_window, reach, spread
from kiribench.surface.geodesic_kernels import (
    FROM_SOURCE,
    GAIN,
    NO_ROOM,
    Scratch,
    distance,
    heap_pop,
    in_edge_frame,
    norm,
    through_edge,
    vertex_in_edge_frame,
)
from kiribench.surface.mesh import FloatArray, IntArray


@njit(cache=True, error_model="numpy")
def _hit(
    b: float, sx: float, sy: float, ox: float, oy: float, ux: float, uy: float, side: float
) -> float:
    """Where the ray from (sx, -sy) through (b, 0) meets the edge from (ox, oy) along (ux, uy)."""
    rx, ry = b - sx, sy
    bottom = rx * uy - ry * ux
    if bottom == 0.0:
        return 0.0
    at = -(rx * (oy + sy) - ry * (ox - sx)) / bottom
    return min(side, max(0.0, at))


@njit(cache=True, error_model="numpy")
def search(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    offsets: IntArray,
    corners: IntArray,
    source_faces: IntArray,
    source_weights: FloatArray,
    s: FloatArray,
    target_faces: IntArray,
    target_weights: FloatArray,
    t: FloatArray,
    bound: float,
    stamp: int,
    work: Scratch,
) -> tuple[float, int]:
    """Look for a path from ``s`` to ``t`` shorter than ``bound``.

    ``source_faces`` are all faces that hold ``s`` and ``source_weights`` its barycentric
    coordinates there, zero exactly where ``s`` lies on an edge; likewise the target, whose
    faces carry ``stamp`` in ``work.target_stamp``.

    Returns the shorter length and the link to trace it by (a window, or ``-(v + 2)`` for a
    vertex); (bound, -1) if there is none; (0, NO_ROOM) if the scratch arrays are too small.
    """
    best, best_link = bound, -1
    limit = bound - GAIN * bound if bound < math.inf else 1e300
    counts = np.zeros(2, np.int32)
    window, window_link = work.window, work.window_link
    heap_key, heap_item = work.heap_key, work.heap_item
    vertex_stamp, vertex_mm = work.vertex_stamp, work.vertex_mm
    tx, ty, tz = t[0], t[1], t[2]
    for n in range(len(source_faces)):
        f = source_faces[n]
        for i in range(3):
            v, a = faces[f, i], faces[f, (i + 1) % 3]
            length, along, off = in_edge_frame(xyz, v, a, s[0], s[1], s[2])
            turn = math.atan2(off, along)
            ok = reach(
                xyz, t, v, distance(xyz[v], s), 3 * f + i, turn, FROM_SOURCE, limit, stamp,
                counts, work,
            )  # fmt: skip
            if ok and source_weights[n, (i + 2) % 3] > 0.0:
                length, along, off = in_edge_frame(xyz, a, v, s[0], s[1], s[2])
                ok = push_window(
                    xyz, faces, twins, t, 3 * f + i, 0.0, length, along, off, 0.0,
                    FROM_SOURCE, limit, stamp, counts, work,
                )  # fmt: skip
            if not ok:
                return 0.0, NO_ROOM
    while counts[1] > 0:
        item = work.heap_item[0]
        key = work.heap_key[0]
        counts[1] = heap_pop(work.heap_key, work.heap_item, counts[1])
        if item < 0:
            v = -item - 1
            d = work.vertex_mm[v]
            if key > d or d == 0.0 or d + distance(xyz[v], t) >= limit:
                continue
            for n in range(offsets[v], offsets[v + 1]):
                if work.target_stamp[corners[n] // 3] == stamp:
                    reached = d + distance(xyz[v], t)
                    if reached < limit:
                        best, best_link = reached, -(v + 2)
                        limit = best - GAIN * best
            if not spread(xyz, faces, twins, offsets, corners, t, v, limit, stamp, counts, work):
                return 0.0, NO_ROOM
            continue
        if window[item, 5] >= limit:
            continue
        b0, b1, sx, sy = window[item, 0], window[item, 1], window[item, 2], window[item, 3]
        d, length = window[item, 4], window[item, 6]
        h = window_link[item, 0]
        f = h // 3
        i = h - 3 * f
        j = i + 1 if i < 2 else 0
        k = i - 1 if i > 0 else 2
        v0, v1, v2 = faces[f, i], faces[f, j], faces[f, k]
        known0 = vertex_mm[v0] if vertex_stamp[v0] == stamp else math.inf
        known1 = vertex_mm[v1] if vertex_stamp[v1] == stamp else math.inf
        far, near = norm(b1 - sx, sy), norm(b0 - sx, sy)
        slack = GAIN * (d + near + far)
        if d + far > known0 + b1 + slack or d + near > known1 + length - b0 + slack:
            continue
        _, px, py = vertex_in_edge_frame(xyz, v0, v1, v2)
        if work.target_stamp[f] == stamp:
            for n in range(len(target_faces)):
                if target_faces[n] == f:
                    w1, w2 = target_weights[n, j], target_weights[n, k]
                    reached, _ = through_edge(b0, b1, sx, sy, w1 * length + w2 * px, w2 * py)
                    if d + reached < limit:
                        best, best_link = d + reached, item
                        limit = best - GAIN * best
        # On which side of the window's two border rays the third vertex lies (> 0: left).
        c0 = (b0 - sx) * (py + sy) - sy * (px - sx)
        c1 = (b1 - sx) * (py + sy) - sy * (px - sx)
        touch = 1e-11 * length
        known2 = vertex_mm[v2] if vertex_stamp[v2] == stamp else math.inf
        if c0 <= touch * near and c1 >= -touch * far:
            to = d + norm(px - sx, py + sy)
            if to < known2:
                known2 = to
                # Angle at the third vertex from its next vertex (v0) round to the source.
                turn = abs(
                    math.atan2(px * (sy + py) + py * (sx - px), -px * (sx - px) + py * (sy + py))
                )
                if not reach(xyz, t, v2, to, 3 * f + k, turn, item, limit, stamp, counts, work):
                    return 0.0, NO_ROOM
        for right in range(2):
            # Rays left of the third vertex reach edge v0 v2, those right of it v2 v1.
            if (right == 0 and c0 > 0.0) or (right == 1 and c1 < 0.0):
                continue
            beyond = twins[f, j if right else k]
            if beyond < 0:
                continue
            if right:
                ox, oy, wx, wy = px, py, length - px, -py
            else:
                ox, oy, wx, wy = 0.0, 0.0, px, py
            side = norm(wx, wy)
            ux, uy = wx / side, wy / side
            lo, hi = 0.0, side
            if right == 0 or c0 > 0.0:
                lo = _hit(b0, sx, sy, ox, oy, ux, uy, side)
            if right == 1 or c1 < 0.0:
                hi = _hit(b1, sx, sy, ox, oy, ux, uy, side)
            if not hi > lo:
                continue
            rx, ry = sx - ox, -sy - oy
            nx, ny = ux * rx + uy * ry, uy * rx - ux * ry
            # The vertex across the face beats the window if it beats the end farther from it.
            if right:
                rival = known0 + norm(px + hi * ux, py + hi * uy) - norm(hi - nx, ny)
                o, e, known_o, known_e = v2, v1, known2, known1
            else:
                rival = known1 + norm(length - lo * ux, lo * uy) - norm(lo - nx, ny)
                o, e, known_o, known_e = v0, v2, known0, known2
            if d > rival + slack:
                continue
            if not push(
                xyz, tx, ty, tz, beyond, o, e, lo, hi, nx, ny, d, item, known_o, known_e,
                limit, window, window_link, heap_key, heap_item, counts,
            ):  # fmt: skip
                return 0.0, NO_ROOM
    return best, best_link
