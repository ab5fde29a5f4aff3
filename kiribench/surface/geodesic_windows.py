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

from typing import Any

import numpy as np
from numba import njit

from kiribench.surface.geodesic_strip import (
    Scratch,
    corner_angle,
    distance,
    heap_pop,
    heap_push,
    in_edge_frame,
    vertex_in_edge_frame,
)
from kiribench.surface.mesh import FloatArray, IntArray

ANGLE_SLACK = 1e-9  # rad; a wedge narrower than this behind a vertex is not searched
GAIN = 1e-12  # relative; a path must be shorter by this much to replace a known one
FROM_SOURCE = -1  # link of a window or vertex reached straight from the source
NO_ROOM = -2


@njit(cache=True, inline="always")
def _norm(x: float, y: float) -> float:
    return np.sqrt(x * x + y * y)


@njit(cache=True, error_model="numpy")
def _shortest_through(
    b0: float, b1: float, sx: float, sy: float, tx: float, ty: float
) -> tuple[float, float]:
    """Length from (sx, -sy) through [b0, b1] on the x axis to (tx, ty), and the crossing."""
    depth = sy + ty
    x = sx + (tx - sx) * sy / depth if depth > 0.0 else tx
    if b0 < x < b1 and depth > 0.0:
        return _norm(tx - sx, depth), x
    x = min(max(x, b0), b1)
    return _norm(x - sx, sy) + _norm(tx - x, ty), x


@njit(cache=True, error_model="numpy")
def _push(
    xyz: FloatArray,
    tx: float,
    ty: float,
    tz: float,
    h: int,
    o: int,
    e: int,
    b0: float,
    b1: float,
    sx: float,
    sy: float,
    d: float,
    link: int,
    known_o: float,
    known_e: float,
    limit: float,
    window: FloatArray,
    window_link: IntArray,
    heap_key: FloatArray,
    heap_item: IntArray,
    counts: IntArray,
) -> bool:
    """Queue the window [b0, b1] on the edge ``o e`` of half-edge ``h``; False if no room.

    The frame's origin is ``o``, x runs to ``e``; the pseudo-source is at (sx, -sy), ``d``
    behind the source. It is dropped if a vertex beats it all over, or if its straight
    continuation to the target is no shorter than ``limit``.
    """
    far = _norm(b1 - sx, sy)
    near = _norm(b0 - sx, sy)
    slack = GAIN * (d + near + far)
    if d + far > known_o + b1 + slack:
        return True
    length, along, off = in_edge_frame(xyz, o, e, tx, ty, tz)
    if d + near > known_e + length - b0 + slack:
        return True
    least, _ = _shortest_through(b0, b1, sx, sy, along, off)
    if d + least >= limit:
        return True
    n = counts[0]
    if n + 2 > window.shape[0] or counts[1] + 2 > heap_key.shape[0]:
        return False
    window[n, 0], window[n, 1], window[n, 2], window[n, 3] = b0, b1, sx, sy
    window[n, 4], window[n, 5], window[n, 6] = d, d + least, length
    window_link[n, 0], window_link[n, 1] = h, link
    key = d + (sy if b0 <= sx <= b1 else min(near, far))
    counts[0] = n + 1
    counts[1] = heap_push(heap_key, heap_item, counts[1], key, n)
    return True


@njit(cache=True)
def _known(v: int, stamp: int, work: Scratch) -> float:
    if work.vertex_stamp[v] == stamp:
        return work.vertex_mm[v]
    return np.inf


@njit(cache=True)
def _push_window(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    t: FloatArray,
    leaving: int,
    b0: float,
    b1: float,
    sx: float,
    sy: float,
    d: float,
    link: int,
    limit: float,
    stamp: int,
    counts: IntArray,
    work: Scratch,
) -> bool:
    """Queue the window behind half-edge ``leaving`` (see ``_push``); False if no room."""
    h = twins[leaving // 3, leaving % 3]
    if h < 0 or not b1 > b0:
        return True
    o, e = faces[h // 3, h % 3], faces[h // 3, (h % 3 + 1) % 3]
    return _push(
        xyz, t[0], t[1], t[2], h, o, e, b0, b1, sx, sy, d, link,
        _known(o, stamp, work), _known(e, stamp, work), limit,
        work.window, work.window_link, work.heap_key, work.heap_item, counts,
    )  # fmt: skip


@njit(cache=True)
def _reach(
    xyz: FloatArray,
    t: FloatArray,
    v: int,
    d: float,
    corner: int,
    angle: float,
    link: int,
    limit: float,
    stamp: int,
    counts: IntArray,
    work: Scratch,
) -> bool:
    """Vertex ``v`` is ``d`` away, arriving in ``corner`` at ``angle`` from its next vertex."""
    if d >= _known(v, stamp, work):
        return True
    work.vertex_stamp[v] = stamp
    work.vertex_mm[v] = d
    work.vertex_corner[v] = corner
    work.vertex_angle[v] = angle
    work.vertex_parent[v] = link
    if d + distance(xyz[v], t) < limit:
        if counts[1] + 2 > len(work.heap_key):
            return False
        counts[1] = heap_push(work.heap_key, work.heap_item, counts[1], d, -v - 1)
    return True


@njit(cache=True)
def _emit(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    t: FloatArray,
    corner: int,
    low: float,
    high: float,
    d: float,
    limit: float,
    stamp: int,
    counts: IntArray,
    work: Scratch,
) -> bool:
    """Light the edge opposite ``corner`` from its vertex, between two angles from the next one."""
    f, i = corner // 3, corner % 3
    j, k = (i + 1) % 3, (i + 2) % 3
    v, a, b = faces[f, i], faces[f, j], faces[f, k]
    full = corner_angle(xyz, faces, corner)
    low = max(low, 0.0)
    high = min(high, full)
    if not high >= low:
        return True
    side_a, side_b = distance(xyz[v], xyz[a]), distance(xyz[v], xyz[b])
    length, along, off = vertex_in_edge_frame(xyz, b, a, v)
    px, py = side_b * np.cos(full), side_b * np.sin(full)
    b0, b1 = 0.0, length
    if low > 0.0:
        up = px * np.sin(low) - py * np.cos(low)
        down = side_a * np.sin(low)
        if up - down != 0.0:
            b1 = length * min(1.0, max(0.0, up / (up - down)))
    if high < full:
        up = px * np.sin(high) - py * np.cos(high)
        down = side_a * np.sin(high)
        if up - down != 0.0:
            b0 = length * min(1.0, max(0.0, up / (up - down)))
    link = -(v + 2)
    if low <= ANGLE_SLACK:
        turn = corner_angle(xyz, faces, 3 * f + j)
        if not _reach(
            xyz, t, a, d + side_a, 3 * f + j, turn, link, limit, stamp, counts, work
        ):
            return False
    if high >= full - ANGLE_SLACK and not _reach(
        xyz, t, b, d + side_b, 3 * f + k, 0.0, link, limit, stamp, counts, work
    ):
        return False
    return _push_window(
        xyz, faces, twins, t, 3 * f + j, b0, b1, along, off, d, link, limit, stamp,
        counts, work,
    )  # fmt: skip


@njit(cache=True)
def _spread(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    offsets: IntArray,
    corners: IntArray,
    t: FloatArray,
    v: int,
    limit: float,
    stamp: int,
    counts: IntArray,
    work: Scratch,
) -> bool:
    """Make vertex ``v`` a pseudo-source where a shortest path may bend: more than half a turn."""
    d = work.vertex_mm[v]
    first = work.vertex_corner[v]
    arrival = work.vertex_angle[v]
    turn = corner_angle(xyz, faces, first) - arrival
    visited = 1
    border = False
    c = first
    while True:
        c = twins[c // 3, (c % 3 + 2) % 3]
        if c < 0:
            border = True
            break
        if c == first:
            break
        turn += corner_angle(xyz, faces, c)
        visited += 1
    degree = offsets[v + 1] - offsets[v]
    if not border and degree == visited and turn + arrival <= 2.0 * np.pi + ANGLE_SLACK:
        return True
    end = np.inf if border else turn + arrival - np.pi
    # Counter-clockwise from the arrival, beyond half a turn, up to half a turn before it.
    angle = corner_angle(xyz, faces, first) - arrival
    c = first
    while True:
        c = twins[c // 3, (c % 3 + 2) % 3]
        if c < 0 or c == first:
            break
        wide = corner_angle(xyz, faces, c)
        if angle + wide > np.pi - ANGLE_SLACK and angle < end + ANGLE_SLACK and not _emit(
            xyz, faces, twins, t, c, np.pi - ANGLE_SLACK - angle, end + ANGLE_SLACK - angle,
            d, limit, stamp, counts, work,
        ):  # fmt: skip
            return False
        angle += wide
    if border:
        angle = arrival
        c = first
        while True:
            back = twins[c // 3, c % 3]
            if back < 0:
                break
            c = 3 * (back // 3) + (back % 3 + 1) % 3
            visited += 1
            wide = corner_angle(xyz, faces, c)
            if angle + wide > np.pi - ANGLE_SLACK and not _emit(
                xyz, faces, twins, t, c, -1.0, wide - (np.pi - ANGLE_SLACK - angle),
                d, limit, stamp, counts, work,
            ):  # fmt: skip
                return False
            angle += wide
    if visited < degree:  # other fans that touch only at this vertex
        for n in range(offsets[v], offsets[v + 1]):
            c = first
            mine = corners[n] == first
            while not mine:
                c = twins[c // 3, (c % 3 + 2) % 3]
                if c < 0 or c == first:
                    break
                mine = c == corners[n]
            c = first
            while not mine:
                back = twins[c // 3, c % 3]
                if back < 0:
                    break
                c = 3 * (back // 3) + (back % 3 + 1) % 3
                if c == first:
                    break
                mine = c == corners[n]
            if not mine and not _emit(
                xyz, faces, twins, t, corners[n], -1.0, 10.0, d, limit, stamp, counts, work
            ):
                return False
    return True


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
    limit = bound - GAIN * bound if bound < np.inf else 1e300
    counts = np.zeros(2, np.int32)
    window, window_link = work.window, work.window_link
    heap_key, heap_item = work.heap_key, work.heap_item
    vertex_stamp, vertex_mm = work.vertex_stamp, work.vertex_mm
    tx, ty, tz = t[0], t[1], t[2]
    for n in range(len(source_faces)):
        f = source_faces[n]
        for i in range(3):
            v, a, b = faces[f, i], faces[f, (i + 1) % 3], faces[f, (i + 2) % 3]
            length, along, off = in_edge_frame(xyz, v, a, s[0], s[1], s[2])
            turn = np.arctan2(off, along)
            ok = _reach(
                xyz, t, v, distance(xyz[v], s), 3 * f + i, turn, FROM_SOURCE, limit, stamp,
                counts, work,
            )  # fmt: skip
            if ok and source_weights[n, (i + 2) % 3] > 0.0:
                length, along, off = in_edge_frame(xyz, a, v, s[0], s[1], s[2])
                ok = _push_window(
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
            if not _spread(
                xyz, faces, twins, offsets, corners, t, v, limit, stamp, counts, work
            ):
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
        known0 = vertex_mm[v0] if vertex_stamp[v0] == stamp else np.inf
        known1 = vertex_mm[v1] if vertex_stamp[v1] == stamp else np.inf
        far, near = _norm(b1 - sx, sy), _norm(b0 - sx, sy)
        slack = GAIN * (d + near + far)
        if d + far > known0 + b1 + slack or d + near > known1 + length - b0 + slack:
            continue
        _, px, py = vertex_in_edge_frame(xyz, v0, v1, v2)
        if work.target_stamp[f] == stamp:
            for n in range(len(target_faces)):
                if target_faces[n] == f:
                    w1, w2 = target_weights[n, j], target_weights[n, k]
                    reached, _ = _shortest_through(b0, b1, sx, sy, w1 * length + w2 * px, w2 * py)
                    if d + reached < limit:
                        best, best_link = d + reached, item
                        limit = best - GAIN * best
        # On which side of the window's two border rays the third vertex lies (> 0: left).
        c0 = (b0 - sx) * (py + sy) - sy * (px - sx)
        c1 = (b1 - sx) * (py + sy) - sy * (px - sx)
        touch = 1e-11 * length
        known2 = vertex_mm[v2] if vertex_stamp[v2] == stamp else np.inf
        if c0 <= touch * near and c1 >= -touch * far:
            to = d + _norm(px - sx, py + sy)
            if to < known2:
                known2 = to
                # Angle at the third vertex from its next vertex (v0) round to the source.
                turn = abs(
                    np.arctan2(
                        px * (sy + py) + py * (sx - px), -px * (sx - px) + py * (sy + py)
                    )
                )
                if not _reach(
                    xyz, t, v2, to, 3 * f + k, turn, item, limit, stamp, counts, work
                ):
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
            side = _norm(wx, wy)
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
                rival = known0 + _norm(px + hi * ux, py + hi * uy) - _norm(hi - nx, ny)
                o, e, known_o, known_e = v2, v1, known2, known1
            else:
                rival = known1 + _norm(length - lo * ux, lo * uy) - _norm(lo - nx, ny)
                o, e, known_o, known_e = v0, v2, known0, known2
            if d > rival + slack:
                continue
            if not _push(
                xyz, tx, ty, tz, beyond, o, e, lo, hi, nx, ny, d, item, known_o, known_e,
                limit, window, window_link, heap_key, heap_item, counts,
            ):  # fmt: skip
                return 0.0, NO_ROOM
    return best, best_link


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


@njit(cache=True)
def window_polyline(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s: FloatArray,
    t: FloatArray,
    t_face: int,
    link: int,
    at: int,
    work: Scratch,
) -> int:
    """Trace the path that ``search`` found, from index ``at`` on; the next free index or -2."""
    out, out_face = work.path_mm, work.path_face
    begin = at
    x = np.empty(3)
    x[:] = t
    out[at] = t
    out_face[at] = t_face
    at += 1
    while link != FROM_SOURCE:
        if at + 3 > len(out):
            return NO_ROOM
        if link >= 0:
            h = work.window_link[link, 0]
            f, i = h // 3, h % 3
            o, e = faces[f, i], faces[f, (i + 1) % 3]
            record = work.window[link]
            length, px, py = in_edge_frame(xyz, o, e, x[0], x[1], x[2])
            _, cut = _shortest_through(record[0], record[1], record[2], record[3], px, py)
            share = cut / length
            for k in range(3):
                x[k] = xyz[o, k] + share * (xyz[e, k] - xyz[o, k])
            out[at] = x
            out_face[at - 1] = f  # while reversed: the face between this point and the last
            out_face[at] = twins[f, i] // 3
            at += 1
            link = work.window_link[link, 1]
        else:
            v = -link - 2
            x[:] = xyz[v]
            out[at] = x
            corner = work.vertex_corner[v]
            out_face[at] = corner // 3
            at += 1
            link = work.vertex_parent[v]
    if at + 2 > len(out):
        return NO_ROOM
    out[at] = s
    # out_face[j] is now the face between points j and j + 1 (towards the source). Reverse.
    out_face[at] = out_face[at - 1]
    at += 1
    i, j = begin, at - 1
    while i < j:
        for k in range(3):
            out[i, k], out[j, k] = out[j, k], out[i, k]
        i += 1
        j -= 1
    # Faces of segments: reversed order, one fewer than points, the last repeated.
    i, j = begin, at - 2
    while i < j:
        out_face[i], out_face[j] = out_face[j], out_face[i]
        i += 1
        j -= 1
    out_face[at - 1] = out_face[at - 2]
    return at


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
    )
