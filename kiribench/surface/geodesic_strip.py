"""A locally shortest path through a strip of faces: the upper bound for the exact search.

Find any strip between two points (best-first search over faces), lay it out flat, pull the
string taut (funnel), and while the path bends about a vertex with less than half a turn on
its free side, lead the strip around that other side. After Xin and Wang (2007),
doi:10.1109/TVCG.2007.1045 [edge-sequence shortening]; the funnel is Lee and Preparata (1984).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.surface.mesh import FloatArray, IntArray

GREED = 1.5  # weight of the straight-line guess; any value gives a valid strip
HALF_TURN = np.pi - 1e-12
MAX_FLIP_ROUNDS = 20_000


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


@njit(cache=True)
def distance(a: FloatArray, b: FloatArray) -> float:
    """Straight distance of two points, each (3,)."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return np.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def in_edge_frame(
    xyz: FloatArray, o: int, e: int, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Length of the edge from vertex ``o`` to ``e``, and a point's place along and off it."""
    ox, oy, oz = xyz[o, 0], xyz[o, 1], xyz[o, 2]
    ux, uy, uz = xyz[e, 0] - ox, xyz[e, 1] - oy, xyz[e, 2] - oz
    wx, wy, wz = px - ox, py - oy, pz - oz
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    scale = 1.0 / length
    along = (ux * wx + uy * wy + uz * wz) * scale
    return length, along, np.sqrt(cx * cx + cy * cy + cz * cz) * scale


@njit(cache=True, error_model="numpy")
def vertex_in_edge_frame(
    xyz: FloatArray, o: int, e: int, p: int
) -> tuple[float, float, float]:
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
    return np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), ux * wx + uy * wy + uz * wz)


@njit(cache=True)
def _towards(xyz: FloatArray, faces: IntArray, f: int, t: FloatArray) -> Any:
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    x = (xyz[a, 0] + xyz[b, 0] + xyz[c, 0]) / 3.0
    y = (xyz[a, 1] + xyz[b, 1] + xyz[c, 1]) / 3.0
    z = (xyz[a, 2] + xyz[b, 2] + xyz[c, 2]) / 3.0
    return x, y, z, np.sqrt((x - t[0]) * (x - t[0]) + (y - t[1]) * (y - t[1]) + (z - t[2]) * (z - t[2]))


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
            cost[g] = cost[f] + np.sqrt((gx - x) ** 2 + (gy - y) ** 2 + (gz - z) ** 2)
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
def _lay_out(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s_weights: FloatArray,
    target: FloatArray,
    count: int,
    work: Scratch,
) -> Any:
    """Unfold the strip into the plane; portal ``k`` has its ends in ``left[k]``, ``right[k]``.

    Walking through half-edge a -> b, its end b is to the left and a to the right.
    """
    left, right, strip = work.left, work.right, work.strip
    f, i = strip[0] // 3, strip[0] % 3
    a, b, c = faces[f, i], faces[f, (i + 1) % 3], faces[f, (i + 2) % 3]
    length, along, off = vertex_in_edge_frame(xyz, a, b, c)
    right[0, 0], right[0, 1] = 0.0, 0.0
    left[0, 0], left[0, 1] = length, 0.0
    first_x, first_y = along, off
    sx = s_weights[(i + 1) % 3] * length + s_weights[(i + 2) % 3] * along
    sy = s_weights[(i + 2) % 3] * off
    last_x = last_y = end_x = end_y = 0.0
    for k in range(count):
        other = twins[strip[k] // 3, strip[k] % 3]
        g, j = other // 3, other % 3
        # In g the edge runs from the left end to the right end, g on its left hand.
        o, e, p = faces[g, j], faces[g, (j + 1) % 3], faces[g, (j + 2) % 3]
        length, along, off = vertex_in_edge_frame(xyz, o, e, p)
        ux, uy = right[k, 0] - left[k, 0], right[k, 1] - left[k, 1]
        norm = np.sqrt(ux * ux + uy * uy)
        if norm > 0.0:
            ux /= norm
            uy /= norm
        px = left[k, 0] + along * ux - off * uy
        py = left[k, 1] + along * uy + off * ux
        if k + 1 < count:
            if strip[k + 1] % 3 == (j + 1) % 3:  # leaves through e -> p: right end stays
                right[k + 1, 0], right[k + 1, 1] = right[k, 0], right[k, 1]
                left[k + 1, 0], left[k + 1, 1] = px, py
            else:  # leaves through p -> o: left end stays
                left[k + 1, 0], left[k + 1, 1] = left[k, 0], left[k, 1]
                right[k + 1, 0], right[k + 1, 1] = px, py
        else:
            last_x, last_y = px, py
            _, tx, ty = in_edge_frame(xyz, o, e, target[0], target[1], target[2])
            end_x = left[k, 0] + tx * ux - ty * uy
            end_y = left[k, 1] + tx * uy + ty * ux
    left[count, 0], left[count, 1] = end_x, end_y
    right[count, 0], right[count, 1] = end_x, end_y
    return sx, sy, first_x, first_y, last_x, last_y


@njit(cache=True)
def _cross(ax: float, ay: float, bx: float, by: float) -> float:
    return ax * by - ay * bx


@njit(cache=True)
def _pull_taut(sx: float, sy: float, count: int, work: Scratch) -> tuple[int, float]:
    """The funnel: corners to ``corner_portal`` and ``corner_side`` (0 left, 1 right), length."""
    left, right = work.left, work.right
    ax, ay = sx, sy
    lx, ly, rx, ry = left[0, 0], left[0, 1], right[0, 0], right[0, 1]
    li = ri = 0
    corners = 0
    total = 0.0
    k = 1
    while k <= count:
        nx, ny = right[k, 0], right[k, 1]
        if _cross(rx - ax, ry - ay, nx - ax, ny - ay) >= 0.0:
            if (rx == ax and ry == ay) or _cross(lx - ax, ly - ay, nx - ax, ny - ay) <= 0.0:
                rx, ry, ri = nx, ny, k
            else:
                total += np.hypot(lx - ax, ly - ay)
                work.corner_portal[corners], work.corner_side[corners] = li, 0
                corners += 1
                ax, ay = lx, ly
                k = ri = li
                rx, ry = ax, ay
                k += 1
                continue
        nx, ny = left[k, 0], left[k, 1]
        if _cross(lx - ax, ly - ay, nx - ax, ny - ay) <= 0.0:
            if (lx == ax and ly == ay) or _cross(rx - ax, ry - ay, nx - ax, ny - ay) >= 0.0:
                lx, ly, li = nx, ny, k
            else:
                total += np.hypot(rx - ax, ry - ay)
                work.corner_portal[corners], work.corner_side[corners] = ri, 1
                corners += 1
                ax, ay = rx, ry
                k = li = ri
                lx, ly = ax, ay
                k += 1
                continue
        k += 1
    return corners, total + np.hypot(left[count, 0] - ax, left[count, 1] - ay)


@njit(cache=True)
def _end_vertex(faces: IntArray, half_edge: int, side: int) -> int:
    f, i = half_edge // 3, half_edge % 3
    return faces[f, (i + 1) % 3] if side == 0 else faces[f, i]


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
        v = _end_vertex(faces, strip[at], side)
        points = work.left if side == 0 else work.right
        vx, vy = points[at, 0], points[at, 1]
        if n + 1 < corners:
            nxt = work.left if work.corner_side[n + 1] == 0 else work.right
            after_x, after_y = nxt[work.corner_portal[n + 1], 0], nxt[work.corner_portal[n + 1], 1]
        else:
            after_x, after_y = work.left[count, 0], work.left[count, 1]
        begin = end = at
        while begin > 0 and _end_vertex(faces, strip[begin - 1], side) == v:
            begin -= 1
        while end + 1 < count and _end_vertex(faces, strip[end + 1], side) == v:
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
        angle = abs(np.arctan2(_cross(in_x, in_y, cx, cy), in_x * cx + in_y * cy))
        if end + 1 < count:
            cx, cy = points[end + 1, 0] - vx, points[end + 1, 1] - vy
        else:
            cx, cy = ends[4] - vx, ends[5] - vy
        angle += abs(np.arctan2(_cross(out_x, out_y, cx, cy), out_x * cx + out_y * cy))
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
    length = np.inf
    for _ in range(MAX_FLIP_ROUNDS):
        if count == 0:
            return 0, 0, distance(s, t)
        if count + 4 > len(work.strip):
            return -2, 0, 0.0
        ends = np.array(_lay_out(xyz, faces, twins, s_weights, t, count, work))
        corners, new_length = _pull_taut(ends[0], ends[1], count, work)
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


@njit(cache=True)
def strip_polyline(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    s: FloatArray,
    start: int,
    s_weights: FloatArray,
    t: FloatArray,
    count: int,
    corners: int,
    at: int,
    work: Scratch,
) -> int:
    """Write the taut path's points and faces from index ``at`` on; the next free index or -2."""
    out, out_face, strip = work.path_mm, work.path_face, work.strip
    if at + count + 3 > len(out):
        return -2
    out[at] = s
    out_face[at] = start
    at += 1
    if count > 0:
        ends = _lay_out(xyz, faces, twins, s_weights, t, count, work)
        ax, ay = ends[0], ends[1]
        qx, qy = ax, ay  # the last point written
        n = 0
        pivot = -1  # the mesh vertex at the last point, if any
        for i in range(3):
            if s_weights[i] == 1.0:
                pivot = faces[start, i]
        for k in range(count):
            g = twins[strip[k] // 3, strip[k] % 3] // 3
            a, b = _end_vertex(faces, strip[k], 1), _end_vertex(faces, strip[k], 0)
            while n < corners and work.corner_portal[n] == k:
                v = a if work.corner_side[n] == 1 else b
                points = work.right if work.corner_side[n] == 1 else work.left
                ax, ay = points[k, 0], points[k, 1]
                qx, qy = ax, ay
                n += 1
                if v != pivot:
                    if at + count - k + 3 > len(out):
                        return -2
                    out[at] = xyz[v]
                    at += 1
                    pivot = v
            if a == pivot or b == pivot:
                out_face[at - 1] = g  # still turning about that vertex
                continue
            ahead = -1
            bx, by = work.left[count, 0], work.left[count, 1]
            if n < corners:
                points = work.right if work.corner_side[n] == 1 else work.left
                bx, by = points[work.corner_portal[n], 0], points[work.corner_portal[n], 1]
                ahead = _end_vertex(faces, strip[work.corner_portal[n]], work.corner_side[n])
            pivot = -1
            if a == ahead or b == ahead:
                out[at] = xyz[ahead]
                pivot = ahead
                qx, qy = bx, by
            else:
                rx, ry = work.right[k, 0], work.right[k, 1]
                wx, wy = work.left[k, 0] - rx, work.left[k, 1] - ry
                bottom = _cross(wx, wy, bx - ax, by - ay)
                edge = wx * wx + wy * wy
                if abs(bottom) > 1e-12 * np.sqrt(edge) * np.hypot(bx - ax, by - ay):
                    share = _cross(ax - rx, ay - ry, bx - ax, by - ay) / bottom
                else:  # the path runs along this edge
                    share = ((qx - rx) * wx + (qy - ry) * wy) / edge
                share = min(1.0, max(0.0, share))
                qx, qy = rx + share * wx, ry + share * wy
                for x in range(3):
                    out[at, x] = xyz[a, x] + share * (xyz[b, x] - xyz[a, x])
            out_face[at] = g
            at += 1
    out[at] = t
    out_face[at] = out_face[at - 1]
    return at + 1
