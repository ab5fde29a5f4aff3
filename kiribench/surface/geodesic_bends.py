"""Windows on their queue, and the vertices about which a shortest path may bend."""

from __future__ import annotations

import math

from numba import njit

from kiribench.surface.geodesic_kernels import (
    GAIN,
    Scratch,
    corner_angle,
    distance,
    heap_push,
    in_edge_frame,
    norm,
    through_edge,
    vertex_in_edge_frame,
)
from kiribench.surface.mesh import FloatArray, IntArray

ANGLE_SLACK = 1e-9  # rad; a wedge narrower than this behind a vertex is not searched


@njit(cache=True)
def known(v: int, stamp: int, work: Scratch) -> float:
    """The distance at which vertex ``v`` was reached so far; inf if it was not."""
    if work.vertex_stamp[v] == stamp:
        return float(work.vertex_mm[v])
    return math.inf


@njit(cache=True, error_model="numpy")
def push(
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
    far = norm(b1 - sx, sy)
    near = norm(b0 - sx, sy)
    slack = GAIN * (d + near + far)
    if d + far > known_o + b1 + slack:
        return True
    length, along, off = in_edge_frame(xyz, o, e, tx, ty, tz)
    if d + near > known_e + length - b0 + slack:
        return True
    least, _ = through_edge(b0, b1, sx, sy, along, off)
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
def push_window(
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
    """Queue the window behind half-edge ``leaving`` (see ``push``); False if no room."""
    h = twins[leaving // 3, leaving % 3]
    if h < 0 or not b1 > b0:
        return True
    o, e = faces[h // 3, h % 3], faces[h // 3, (h % 3 + 1) % 3]
    return push(
        xyz, t[0], t[1], t[2], h, o, e, b0, b1, sx, sy, d, link,
        known(o, stamp, work), known(e, stamp, work), limit,
        work.window, work.window_link, work.heap_key, work.heap_item, counts,
    )  # fmt: skip


@njit(cache=True)
def reach(
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
    if d >= known(v, stamp, work):
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
    px, py = side_b * math.cos(full), side_b * math.sin(full)
    b0, b1 = 0.0, length
    if low > 0.0:
        up = px * math.sin(low) - py * math.cos(low)
        down = side_a * math.sin(low)
        if up - down != 0.0:
            b1 = length * min(1.0, max(0.0, up / (up - down)))
    if high < full:
        up = px * math.sin(high) - py * math.cos(high)
        down = side_a * math.sin(high)
        if up - down != 0.0:
            b0 = length * min(1.0, max(0.0, up / (up - down)))
    link = -(v + 2)
    if low <= ANGLE_SLACK:
        turn = corner_angle(xyz, faces, 3 * f + j)
        if not reach(xyz, t, a, d + side_a, 3 * f + j, turn, link, limit, stamp, counts, work):
            return False
    if high >= full - ANGLE_SLACK and not reach(
        xyz, t, b, d + side_b, 3 * f + k, 0.0, link, limit, stamp, counts, work
    ):
        return False
    return push_window(
        xyz, faces, twins, t, 3 * f + j, b0, b1, along, off, d, link, limit, stamp,
        counts, work,
    )  # fmt: skip


@njit(cache=True)
def spread(
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
    if not border and degree == visited and turn + arrival <= 2.0 * math.pi + ANGLE_SLACK:
        return True
    end = math.inf if border else turn + arrival - math.pi
    # Counter-clockwise from the arrival, beyond half a turn, up to half a turn before it.
    angle = corner_angle(xyz, faces, first) - arrival
    c = first
    while True:
        c = twins[c // 3, (c % 3 + 2) % 3]
        if c < 0 or c == first:
            break
        wide = corner_angle(xyz, faces, c)
        if angle + wide > math.pi - ANGLE_SLACK and angle < end + ANGLE_SLACK and not _emit(
            xyz, faces, twins, t, c, math.pi - ANGLE_SLACK - angle, end + ANGLE_SLACK - angle,
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
            if angle + wide > math.pi - ANGLE_SLACK and not _emit(
                xyz, faces, twins, t, c, -1.0, wide - (math.pi - ANGLE_SLACK - angle),
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
