"""A strip of faces laid out flat, and the taut string through it.

The funnel is Lee and Preparata (1984), doi:10.1002/net.3230140304.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from kiribench.surface.geodesic_kernels import Scratch, in_edge_frame, vertex_in_edge_frame
from kiribench.surface.mesh import FloatArray, IntArray


@njit(cache=True)
def cross(ax: float, ay: float, bx: float, by: float) -> float:
    """z of the cross product of two plane vectors; positive if b is to the left of a."""
    return ax * by - ay * bx


@njit(cache=True)
def end_vertex(faces: IntArray, half_edge: int, side: int) -> int:
    """The vertex at the left (0) or right (1) end of a crossed half-edge."""
    f, i = half_edge // 3, half_edge % 3
    return int(faces[f, (i + 1) % 3] if side == 0 else faces[f, i])


@njit(cache=True)
def lay_out(
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
        norm = math.sqrt(ux * ux + uy * uy)
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
def pull_taut(sx: float, sy: float, count: int, work: Scratch) -> tuple[int, float]:
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
        if cross(rx - ax, ry - ay, nx - ax, ny - ay) >= 0.0:
            if (rx == ax and ry == ay) or cross(lx - ax, ly - ay, nx - ax, ny - ay) <= 0.0:
                rx, ry, ri = nx, ny, k
            else:
                total += math.hypot(lx - ax, ly - ay)
                work.corner_portal[corners], work.corner_side[corners] = li, 0
                corners += 1
                ax, ay = lx, ly
                k = ri = li
                rx, ry = ax, ay
                k += 1
                continue
        nx, ny = left[k, 0], left[k, 1]
        if cross(lx - ax, ly - ay, nx - ax, ny - ay) <= 0.0:
            if (lx == ax and ly == ay) or cross(rx - ax, ry - ay, nx - ax, ny - ay) >= 0.0:
                lx, ly, li = nx, ny, k
            else:
                total += math.hypot(rx - ax, ry - ay)
                work.corner_portal[corners], work.corner_side[corners] = ri, 1
                corners += 1
                ax, ay = rx, ry
                k = li = ri
                lx, ly = ax, ay
                k += 1
                continue
        k += 1
    return corners, total + math.hypot(left[count, 0] - ax, left[count, 1] - ay)
