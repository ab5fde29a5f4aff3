"""Areas of quad intersections, compiled: the inner loop of the Monte Carlo."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(cache=True)
def _triangle_intersection(t: FloatArray, u: FloatArray) -> float:
    """Area of the intersection of two counter-clockwise triangles (Sutherland-Hodgman)."""
    px = np.empty(9)
    py = np.empty(9)
    qx = np.empty(9)
    qy = np.empty(9)
    n = 3
    for i in range(3):
        px[i] = t[i, 0]
        py[i] = t[i, 1]
    for e in range(3):
        ax, ay = u[e, 0], u[e, 1]
        ex, ey = u[(e + 1) % 3, 0] - ax, u[(e + 1) % 3, 1] - ay
        m = 0
        for i in range(n):
            j = (i + 1) % n
            di = ex * (py[i] - ay) - ey * (px[i] - ax)
            dj = ex * (py[j] - ay) - ey * (px[j] - ax)
            if di >= 0.0:
                qx[m] = px[i]
                qy[m] = py[i]
                m += 1
            if (di > 0.0 and dj < 0.0) or (di < 0.0 and dj > 0.0):
                w = di / (di - dj)
                qx[m] = px[i] + w * (px[j] - px[i])
                qy[m] = py[i] + w * (py[j] - py[i])
                m += 1
        n = m
        if n < 3:
            return 0.0
        for i in range(n):
            px[i] = qx[i]
            py[i] = qy[i]
    area = 0.0
    for i in range(n):
        j = (i + 1) % n
        area += px[i] * py[j] - px[j] * py[i]
    return 0.5 * area


@njit(cache=True)
def _triangle_area(t: FloatArray) -> float:
    """Area of a counter-clockwise triangle."""
    ax, ay = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1]
    bx, by = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1]
    return float(0.5 * (ax * by - ay * bx))


@njit(cache=True)
def _signed_triangle(quad: FloatArray, half: int, out: FloatArray) -> float:
    """Triangle (0, 1, 2) or (0, 2, 3) of a quad made counter-clockwise; its sign."""
    second = 1 if half == 0 else 2
    third = 2 if half == 0 else 3
    ax = quad[second, 0] - quad[0, 0]
    ay = quad[second, 1] - quad[0, 1]
    bx = quad[third, 0] - quad[0, 0]
    by = quad[third, 1] - quad[0, 1]
    sign = 1.0
    if ax * by - ay * bx < 0.0:
        second, third = third, second
        sign = -1.0
    for axis in range(2):
        out[0, axis] = quad[0, axis]
        out[1, axis] = quad[second, axis]
        out[2, axis] = quad[third, axis]
    return sign


@njit(cache=True)
def quad_areas(skin: FloatArray, patch: FloatArray) -> FloatArray:
    """Areas of pairs of quads and of their intersections.

    A quad is the signed sum of two triangles that share corner 0, which holds for every
    quad that does not cross itself, convex or not; so is the intersection.

    Args:
        skin, patch: (k, 4, 2) corners, contiguous, either sense.

    Returns:
        (k, 3) areas of skin, patch and intersection.
    """
    out = np.empty((len(skin), 3))
    t = np.empty((3, 2))
    u = np.empty((3, 2))
    for i in range(len(skin)):
        area_s = 0.0
        area_k = 0.0
        both = 0.0
        for a in range(2):
            sign_t = _signed_triangle(skin[i], a, t)
            area_s += sign_t * _triangle_area(t)
            for b in range(2):
                sign_u = _signed_triangle(patch[i], b, u)
                both += sign_t * sign_u * _triangle_intersection(t, u)
        for b in range(2):
            sign_u = _signed_triangle(patch[i], b, u)
            area_k += sign_u * _triangle_area(u)
        orientation = 1.0 if area_s * area_k >= 0.0 else -1.0
        out[i, 0] = abs(area_s)
        out[i, 1] = abs(area_k)
        out[i, 2] = max(0.0, orientation * both)
    return out
