"""A locally shortest path through a strip of faces: the upper bound for the exact search.

Find any strip between two points (a walk in a plane, or a best-first search where that
meets a border), lay it out flat, pull the
string taut (funnel), and while the path bends about a vertex with less than half a turn on
its free side, lead the strip around that other side. After Xin and Wang (2007),
doi:10.1016/j.cad.2007.08.001.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.surface.geodesic_funnel import cross, end_vertex, lay_out, pull_taut
from kiribench.surface.geodesic_kernels import (
    Scratch,
    corner_angle,
    distance,
    heap_pop,
    heap_push,
)
from kiribench.surface.mesh import FloatArray, IntArray

GREED = 1.5  # weight of the straight-line guess; any value gives a valid strip
HALF_TURN = math.pi - 1e-12
MAX_FLIP_ROUNDS = 20_000


@njit(cache=True)
def _towards(xyz: FloatArray, faces: IntArray, f: int, t: FloatArray) -> Any:
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    x = (xyz[a, 0] + xyz[b, 0] + xyz[c, 0]) / 3.0
    y = (xyz[a, 1] + xyz[b, 1] + xyz[c, 1]) / 3.0
    z = (xyz[a, 2] + xyz[b, 2] + xyz[c, 2]) / 3.0
    return (
        x,
        y,
        z,
        math.sqrt((x - t[0]) * (x - t[0]) + (y - t[1]) * (y - t[1]) + (z - t[2]) * (z - t[2])),
    )


@njit(cache=True)
def _beside(xyz: FloatArray, v: int, s: FloatArray, q: FloatArray) -> float:
    x, y, z = xyz[v, 0] - s[0], xyz[v, 1] - s[1], xyz[v, 2] - s[2]
    side: float = q[0] * x + q[1] * y + q[2] * z
    return side


@njit(cache=True)
def walk_strip(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s: FloatArray,
    held: IntArray,
    places: FloatArray,
    t: FloatArray,
    stamp: int,
    work: Scratch,
) -> tuple[int, int]:
    """The strip that the plane through both points and the normal at ``s`` cuts out.

    Args:
        held: faces that hold ``s``, with its weights ``places``.

    Returns:
        The number of crossed half-edges in ``work.strip`` and which of ``held`` it starts in;
        (-1, 0) where the walk meets a border or passes the target by.
    """
    a, b, c = faces[held[0], 0], faces[held[0], 1], faces[held[0], 2]
    normal = np.cross(xyz[b] - xyz[a], xyz[c] - xyz[a])
    ahead = t - s
    q = np.cross(ahead, normal)
    reach = ahead[0] * ahead[0] + ahead[1] * ahead[1] + ahead[2] * ahead[2]
    for n in range(len(held)):
        f = held[n]
        h = -1
        for i in range(3):
            if places[n, (i + 2) % 3] == 0.0:
                continue  # the edge holds s
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            side_a, side_b = _beside(xyz, a, s, q), _beside(xyz, b, s, q)
            if (side_a >= 0.0) == (side_b >= 0.0):
                continue
            share = side_a / (side_a - side_b)
            forward = 0.0
            for x in range(3):
                forward += ahead[x] * (xyz[a, x] + share * (xyz[b, x] - xyz[a, x]) - s[x])
            if forward > 0.0:
                h = 3 * f + i
        count = 0
        while h >= 0 and count + 4 < len(work.strip):
            work.strip[count] = h
            count += 1
            h = twins[h // 3, h % 3]
            if h < 0:
                break
            f, i = h // 3, h % 3
            if work.target_stamp[f] == stamp:
                return count, n
            o, p = faces[f, i], faces[f, (i + 2) % 3]
            past = 0.0
            for x in range(3):
                past += ahead[x] * (xyz[p, x] - s[x])
            if past > 1.5 * reach or past < -0.5 * reach:
                break
            if (_beside(xyz, p, s, q) >= 0.0) == (_beside(xyz, o, s, q) >= 0.0):
                h = 3 * f + (i + 1) % 3
            else:
                h = 3 * f + (i + 2) % 3
    return -1, 0


@njit(cache=True)
def find_strip(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s: FloatArray,
    start: int,
    t: FloatArray,
    stamp: int,
    work: Scratch,
) -> int:
    """Any strip from face ``start`` to a face marked with ``stamp``: its crossed half-edges.

    Returns their number, written to ``work.strip``; -1 if there is none, -2 if the scratch
    arrays are too small.
    """
    seen, cost, via = work.face_stamp, work.face_cost, work.face_via
    key, item = work.heap_key, work.heap_item
    room = len(key) - 4
    # The face's point is its centroid, for the first face the source itself.
    seen[start] = stamp
    cost[start] = 0.0
    via[start] = -1
    size = heap_push(key, item, 0, 0.0, start)
    goal = -1
    while size > 0:
        f = item[0]
        size = heap_pop(key, item, size)
        if work.target_stamp[f] == stamp:
            goal = f
            break
        if f == start:
            x, y, z = s[0], s[1], s[2]
        else:
            x, y, z, _ = _towards(xyz, faces, f, t)
        for i in range(3):
            other = twins[f, i]
            if other < 0:
                continue
            g = other // 3
            if seen[g] == stamp:  # best-first: the first visit stands, so at most m pushes
                continue
            gx, gy, gz, ahead = _towards(xyz, faces, g, t)
            seen[g] = stamp
            cost[g] = cost[f] + math.sqrt((gx - x) ** 2 + (gy - y) ** 2 + (gz - z) ** 2)
            via[g] = 3 * f + i
            if size >= room:
                return -2
            size = heap_push(key, item, size, cost[g] + GREED * ahead, g)
    if goal < 0:
        return -1
    count = 0
    f = goal
    while via[f] >= 0:
        count += 1
        f = via[f] // 3
    if count + 2 > len(work.strip):
        return -2
    f = goal
    for k in range(count - 1, -1, -1):
        work.strip[k] = via[f]
        f = via[f] // 3
    return count


@njit(cache=True)
def _flip_corners(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    ends: NDArray[np.float64],
    count: int,
    corners: int,
    work: Scratch,
) -> tuple[int, int]:
    """Lead the strip around the other side of every corner that has less than half a turn there.

    Returns the new number of crossed half-edges (-2 if there is no room) and of flips.
    """
    strip, new = work.strip, work.strip_new
    room = len(new) - 4
    kept = 0  # portals of the old strip already copied
    made = 0
    flips = 0
    before_x, before_y = ends[0], ends[1]
    for n in range(corners):
        side = work.corner_side[n]
        at = work.corner_portal[n]
        v = end_vertex(faces, strip[at], side)
        points = work.left if side == 0 else work.right
        vx, vy = points[at, 0], points[at, 1]
        if n + 1 < corners:
            nxt = work.left if work.corner_side[n + 1] == 0 else work.right
            after_x, after_y = nxt[work.corner_portal[n + 1], 0], nxt[work.corner_portal[n + 1], 1]
        else:
            after_x, after_y = work.left[count, 0], work.left[count, 1]
        begin = end = at
        while begin > 0 and end_vertex(faces, strip[begin - 1], side) == v:
            begin -= 1
        while end + 1 < count and end_vertex(faces, strip[end + 1], side) == v:
            end += 1
        in_x, in_y = before_x - vx, before_y - vy
        out_x, out_y = after_x - vx, after_y - vy
        before_x, before_y = vx, vy
        if begin < kept or (in_x == 0.0 and in_y == 0.0) or (out_x == 0.0 and out_y == 0.0):
            continue
        if begin > 0:
            cx, cy = points[begin - 1, 0] - vx, points[begin - 1, 1] - vy
        else:
            cx, cy = ends[2] - vx, ends[3] - vy
        angle = abs(math.atan2(cross(in_x, in_y, cx, cy), in_x * cx + in_y * cy))
        if end + 1 < count:
            cx, cy = points[end + 1, 0] - vx, points[end + 1, 1] - vy
        else:
            cx, cy = ends[4] - vx, ends[5] - vy
        angle += abs(math.atan2(cross(out_x, out_y, cx, cy), out_x * cx + out_y * cy))
        last = twins[strip[end] // 3, strip[end] % 3] // 3
        f, i = strip[begin] // 3, strip[begin] % 3
        h = 3 * f + ((i + 1) % 3 if side == 0 else (i + 2) % 3)
        if made + (begin - kept) >= room:
            return -2, flips
        trial = made + (begin - kept)
        fan = 0
        done = False
        while angle < HALF_TURN:
            other = twins[h // 3, h % 3]
            if other < 0:
                break
            if trial + fan >= room:
                return -2, flips
            new[trial + fan] = h
            fan += 1
            g, j = other // 3, other % 3
            if g == last:
                done = True
                break
            if side == 0:
                corner, j = 3 * g + (j + 1) % 3, (j + 1) % 3
            else:
                corner, j = other, (j + 2) % 3
            angle += corner_angle(xyz, faces, corner)
            h = 3 * g + j
            if g == f:
                break
        if done and angle < HALF_TURN:
            for k in range(kept, begin):
                new[made + k - kept] = strip[k]
            made = trial + fan
            kept = end + 1
            flips += 1
    if flips == 0:
        return count, 0
    if made + count - kept >= room:
        return -2, flips
    for k in range(kept, count):
        new[made] = strip[k]
        made += 1
    size = 0
    for k in range(made):  # a step straight back cancels the step before
        if size > 0 and twins[strip[size - 1] // 3, strip[size - 1] % 3] == new[k]:
            size -= 1
        else:
            strip[size] = new[k]
            size += 1
    return size, flips


@njit(cache=True)
def shorten(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s_weights: FloatArray,
    s: FloatArray,
    t: FloatArray,
    count: int,
    work: Scratch,
) -> tuple[int, int, float]:
    """Shorten the strip in ``work.strip`` until it is locally shortest.

    Returns the number of crossed half-edges (-2: no room), of corners, and the length. The
    layout of the final strip stays in ``work``.
    """
    length = math.inf
    for _ in range(MAX_FLIP_ROUNDS):
        if count == 0:
            return 0, 0, distance(s, t)
        if count + 4 > len(work.strip):
            return -2, 0, 0.0
        ends = np.array(lay_out(xyz, faces, twins, s_weights, t, count, work))
        corners, new_length = pull_taut(ends[0], ends[1], count, work)
        if not new_length < length:
            return count, corners, new_length
        length = new_length
        next_count, flips = _flip_corners(xyz, faces, twins, ends, count, corners, work)
        if next_count == -2:
            return -2, 0, 0.0
        if flips == 0:
            return count, corners, length
        count = next_count
    return count, corners, length
