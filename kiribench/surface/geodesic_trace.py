"""The polylines of paths that were found, from source to target."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from kiribench.surface.geodesic_funnel import cross, end_vertex, lay_out
from kiribench.surface.geodesic_kernels import (
    FROM_SOURCE,
    NO_ROOM,
    Scratch,
    in_edge_frame,
    norm,
    through_edge,
)
from kiribench.surface.mesh import FloatArray, IntArray


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
        ends = lay_out(xyz, faces, twins, s_weights, t, count, work)
        ax, ay = ends[0], ends[1]
        qx, qy = ax, ay  # the last point written
        n = 0
        pivot = -1  # the mesh vertex at the last point, if any
        for i in range(3):
            if s_weights[i] == 1.0:
                pivot = faces[start, i]
        for k in range(count):
            g = twins[strip[k] // 3, strip[k] % 3] // 3
            a, b = end_vertex(faces, strip[k], 1), end_vertex(faces, strip[k], 0)
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
                ahead = end_vertex(faces, strip[work.corner_portal[n]], work.corner_side[n])
            pivot = -1
            if a == ahead or b == ahead:
                out[at] = xyz[ahead]
                pivot = ahead
                qx, qy = bx, by
            else:
                rx, ry = work.right[k, 0], work.right[k, 1]
                wx, wy = work.left[k, 0] - rx, work.left[k, 1] - ry
                bottom = cross(wx, wy, bx - ax, by - ay)
                edge = wx * wx + wy * wy
                if abs(bottom) > 1e-12 * math.sqrt(edge) * math.hypot(bx - ax, by - ay):
                    share = cross(ax - rx, ay - ry, bx - ax, by - ay) / bottom
                else:  # the path runs along this edge
                    share = ((qx - rx) * wx + (qy - ry) * wy) / edge
                share = min(1.0, max(0.0, share))
                px, py = rx + share * wx, ry + share * wy
                if norm(px - qx, py - qy) <= 1e-12 * math.sqrt(edge):
                    out_face[at - 1] = g  # the last point lies on this edge
                    continue
                qx, qy = px, py
                for x in range(3):
                    out[at, x] = xyz[a, x] + share * (xyz[b, x] - xyz[a, x])
            out_face[at] = g
            at += 1
    out[at] = t
    out_face[at] = out_face[at - 1]
    return at + 1


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
            _, cut = through_edge(record[0], record[1], record[2], record[3], px, py)
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
