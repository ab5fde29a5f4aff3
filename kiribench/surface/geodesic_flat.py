"""A quick proof, where the surface is nearly developable, that a straight line is shortest.

Let X be faces that hold every point p with |p - s| + |p - t| < L and can be reached from the
source: no path shorter than L leaves X. Lay X out in the plane, face by face over the edges of
a tree, the strip first, so that source and target come to lie L apart on the x axis. Other
edges between faces of X (the cuts) get two places, and a point of a cut jumps between them.

Suppose Q, a shortest path, is shorter than L. It shares one piece with an edge at most (a
segment in space is the only shortest way between its ends), and it passes a vertex on one side,
so it crosses every cut at most once, a cut at its own end s or t only there. The image of Q is a
polygon with a gap a crossing. If it stays within heights |y| <= M, each gap is at most the
largest jump of that cut's points within |y| <= M; their sum J(M) grows with M. By the triangle
inequality, the distances of every point of the image to both ends sum to at most
|Q| + J(M) < L + J(M): an ellipse of half width H(J) = sqrt((L + J)^2 - L^2) / 2. So
M <= H(J(M)), and starting from J of all cuts the bounds M <- H(J(M)) shrink. Where J(M) comes
to nothing, |Q| >= L - J(M) is no shorter than the line. No convexity or smoothness is assumed.

Holes, handles and borders need no care: what they break is seen as jumps. Two pieces that touch
at a vertex only are no neighbours over an edge: there the proof is not tried.
"""

from __future__ import annotations

import math

from numba import njit

from kiribench.surface.geodesic_kernels import (
    GAIN,
    Scratch,
    in_edge_frame,
    norm,
    through_edge,
    vertex_in_edge_frame,
)
from kiribench.surface.mesh import FloatArray, IntArray

_MOST_ROUNDS = 30


@njit(cache=True)
def _where(f: int, count: int, place: IntArray, laid_face: IntArray) -> int:
    """The number of face ``f`` in the layout; -1 if it is not laid out."""
    n = int(place[f])
    if 0 <= n < count and laid_face[n] == f:
        return n
    return -1


@njit(cache=True, error_model="numpy")
def _lay(
    xyz: FloatArray,
    faces: IntArray,
    n: int,
    i: int,
    other: int,
    count: int,
    place: IntArray,
    laid_face: IntArray,
    laid_over: IntArray,
    xy: FloatArray,
) -> None:
    """Lay the face of half-edge ``other`` next to laid face ``n``, over that one's edge ``i``."""
    g = other // 3
    j = other - 3 * g
    k = j + 1 if j < 2 else 0
    m = j - 1 if j > 0 else 2
    i1 = i + 1 if i < 2 else 0
    _, along, off = vertex_in_edge_frame(xyz, faces[g, j], faces[g, k], faces[g, m])
    ax, ay = xy[n, 2 * i1], xy[n, 2 * i1 + 1]
    bx, by = xy[n, 2 * i], xy[n, 2 * i + 1]
    ux, uy = bx - ax, by - ay
    scale = 1.0 / norm(ux, uy)
    ux *= scale
    uy *= scale
    xy[count, 2 * j], xy[count, 2 * j + 1] = ax, ay
    xy[count, 2 * k], xy[count, 2 * k + 1] = bx, by
    xy[count, 2 * m] = ax + along * ux - off * uy
    xy[count, 2 * m + 1] = ay + along * uy + off * ux
    laid_face[count] = g
    laid_over[count] = other
    place[g] = count


@njit(cache=True)
def _is_one_fan(twins: IntArray, offsets: IntArray, corners: IntArray, v: int) -> bool:
    """Whether the faces at vertex ``v`` are one fan."""
    first = corners[offsets[v]]
    visited = 1
    c = first
    while True:
        c = twins[c // 3, c % 3 - 1 if c % 3 > 0 else 2]
        if c < 0 or c == first:
            break
        visited += 1
    if c < 0:
        c = first
        while True:
            back = twins[c // 3, c % 3]
            if back < 0:
                break
            c = 3 * (back // 3) + (back % 3 + 1) % 3
            visited += 1
    return bool(visited == offsets[v + 1] - offsets[v])


@njit(cache=True, error_model="numpy")
def _gaps(cut: FloatArray, cuts: int, height: float) -> float:
    """J: the sum of the largest jumps of the cuts' points within ``height`` of the line."""
    total = 0.0
    for n in range(cuts):
        y0, y1 = cut[n, 0], cut[n, 1]
        if min(y0, y1) > height or max(y0, y1) < -height:
            continue
        low, high = 0.0, 1.0
        if y0 != y1:
            a, b = (-height - y0) / (y1 - y0), (height - y0) / (y1 - y0)
            low, high = max(low, min(a, b)), min(high, max(a, b))
        dx, dy = cut[n, 2], cut[n, 3]
        ex, ey = cut[n, 4] - dx, cut[n, 5] - dy
        x, y = dx + low * ex, dy + low * ey
        first = x * x + y * y
        x, y = dx + high * ex, dy + high * ey
        total += math.sqrt(max(first, x * x + y * y))
    return total


@njit(cache=True, error_model="numpy")
def straight_is_shortest(
    xyz: FloatArray,
    faces: IntArray,
    twins: IntArray,
    offsets: IntArray,
    corners: IntArray,
    s: FloatArray,
    s_weights: FloatArray,
    start: int,
    t: FloatArray,
    t_held: IntArray,
    t_place: FloatArray,
    bound: float,
    strip_count: int,
    stamp: int,
    work: Scratch,
) -> bool:
    """Whether the straight line through ``work.strip`` is proved to be a shortest path.

    Args:
        start: the strip's first face, where ``s`` has weights ``s_weights``.
        t_held: all faces that hold ``t``, with its weights ``t_place``.
        bound: the line's length.
        strip_count: crossed half-edges of the strip.

    False says nothing: the exact search must then decide.
    """
    strip, xy, cut = work.strip, work.laid_xy, work.cut
    place, laid_face, laid_over = work.face_via, work.laid_face, work.laid_over
    vertex_stamp, vertex_mm = work.vertex_stamp, work.vertex_mm
    sx3, sy3, sz3 = s[0], s[1], s[2]
    tx3, ty3, tz3 = t[0], t[1], t[2]
    room = min(len(laid_face) - 4, 16 * strip_count + 256)
    if strip_count + 2 > room:
        return False
    length, along, off = vertex_in_edge_frame(
        xyz, faces[start, 0], faces[start, 1], faces[start, 2]
    )
    xy[0, 0] = xy[0, 1] = xy[0, 3] = 0.0
    xy[0, 2], xy[0, 4], xy[0, 5] = length, along, off
    laid_face[0] = start
    laid_over[0] = -1
    place[start] = 0
    count = 1
    for k in range(strip_count):
        h = strip[k]
        other = twins[h // 3, h % 3]
        if _where(other // 3, count, place, laid_face) >= 0:
            return False
        _lay(xyz, faces, count - 1, h % 3, other, count, place, laid_face, laid_over, xy)
        count += 1
    last = count - 1
    at = -1
    for n in range(len(t_held)):
        if t_held[n] == laid_face[last]:
            at = n
    if at < 0:
        return False
    sx = sy = tx = ty = 0.0
    for i in range(3):
        sx += s_weights[i] * xy[0, 2 * i]
        sy += s_weights[i] * xy[0, 2 * i + 1]
        tx += t_place[at, i] * xy[last, 2 * i]
        ty += t_place[at, i] * xy[last, 2 * i + 1]
    span = math.sqrt((tx - sx) * (tx - sx) + (ty - sy) * (ty - sy))
    if abs(span - bound) > GAIN * bound:
        return False
    ux, uy = (tx - sx) / span, (ty - sy) / span
    # Around an end at a vertex the faces are laid about that vertex: no jump there.
    s_vertex = t_vertex = -1
    for end in range(2):
        n = last if end == 1 else 0
        v = -1
        for i in range(3):
            if (t_place[at, i] if end == 1 else s_weights[i]) == 1.0:
                v = i
        if v >= 0 and end == 0:
            s_vertex = faces[laid_face[n], v]
        elif v >= 0:
            t_vertex = faces[laid_face[n], v]
        while v >= 0:
            i = v - 1 if v > 0 else 2
            other = twins[laid_face[n], i]
            if other < 0:
                break
            v = other % 3
            beyond = _where(other // 3, count, place, laid_face)
            if beyond < 0:
                _lay(xyz, faces, n, i, other, count, place, laid_face, laid_over, xy)
                beyond = count
                count += 1
                if count >= room:
                    return False
            elif beyond <= strip_count and (end == 0) == (beyond == 0):
                break
            n = beyond
            if n == (last if end == 1 else 0):
                break
    limit = bound - GAIN * bound
    cuts = 0
    n = 0
    while n < count:
        f = laid_face[n]
        for i in range(3):
            v = faces[f, i]
            if vertex_stamp[v] == -stamp:
                continue
            ax, ay, az = xyz[v, 0] - sx3, xyz[v, 1] - sy3, xyz[v, 2] - sz3
            bx, by, bz = xyz[v, 0] - tx3, xyz[v, 1] - ty3, xyz[v, 2] - tz3
            around = math.sqrt(ax * ax + ay * ay + az * az)
            around += math.sqrt(bx * bx + by * by + bz * bz)
            vertex_stamp[v] = -stamp
            vertex_mm[v] = around
            if around < limit and not _is_one_fan(twins, offsets, corners, v):
                return False
        for i in range(3):
            v, e = faces[f, i], faces[f, i + 1 if i < 2 else 0]
            other = twins[f, i]
            if other < 0 or other == laid_over[n]:
                continue
            g = other // 3
            beyond = _where(g, count, place, laid_face)
            if beyond < 0:
                if vertex_mm[v] >= limit and vertex_mm[e] >= limit:
                    side, x0, y0 = in_edge_frame(xyz, v, e, sx3, sy3, sz3)
                    _, x1, y1 = in_edge_frame(xyz, v, e, tx3, ty3, tz3)
                    least, _ = through_edge(0.0, side, x0, y0, x1, y1)
                    if least >= limit:
                        continue
                if count >= room:
                    return False
                _lay(xyz, faces, n, i, other, count, place, laid_face, laid_over, xy)
                count += 1
            elif beyond < n and laid_over[beyond] != 3 * f + i:
                j = other - 3 * g
                p, q = 2 * i, 2 * (i + 1 if i < 2 else 0)
                p2, q2 = 2 * (j + 1 if j < 2 else 0), 2 * j
                x0, y0, x1, y1 = xy[n, p], xy[n, p + 1], xy[n, q], xy[n, q + 1]
                if cuts >= len(cut):
                    return False
                cut[cuts, 0] = ux * (y0 - sy) - uy * (x0 - sx)
                cut[cuts, 1] = ux * (y1 - sy) - uy * (x1 - sx)
                cut[cuts, 2] = xy[beyond, p2] - x0
                cut[cuts, 3] = xy[beyond, p2 + 1] - y0
                cut[cuts, 4] = xy[beyond, q2] - x1
                cut[cuts, 5] = xy[beyond, q2 + 1] - y1
                # A path from an end at a vertex leaves the cuts there at once.
                if v in (s_vertex, t_vertex):
                    cut[cuts, 4], cut[cuts, 5] = cut[cuts, 2], cut[cuts, 3]
                elif e in (s_vertex, t_vertex):
                    cut[cuts, 2], cut[cuts, 3] = cut[cuts, 4], cut[cuts, 5]
                cuts += 1
        n += 1
    height = math.inf
    for _ in range(_MOST_ROUNDS):
        gaps = _gaps(cut, cuts, height)
        if gaps <= GAIN * bound:
            return True
        next_height = 0.5 * math.sqrt(gaps * (2.0 * bound + gaps))
        if next_height >= 0.999 * height:
            return False
        height = next_height
    return False
