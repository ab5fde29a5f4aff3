"""Subsets of one picture found in another: inverse-compositional Gauss-Newton, affine warps.

A subset is a set of points xi (pixels, relative to its centre) with the brightness that they
have in a reference picture. Its warp w = (u, v, ux, uy, vx, vy) puts them at
centre + (u, v) + (I + [[ux, uy], [vx, vy]]) xi. Sought is the warp under which the picture has
the reference's brightness up to gain and offset (zero-mean normalised squares, ZNSSD). The
Hessian belongs to the reference and is made once (Baker & Matthews, IJCV 56, 2004; for digital
image correlation Pan, Li & Tong, Exp. Mech. 53, 2013, doi 10.1007/s11340-013-9717-6). Pictures
are read by cubic B-splines whose coefficients are made for the window of the subset alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]

FOUND = 0
OUTSIDE = 1
DIVERGED = 2
FLAT = 3
"""Codes of :class:`Matches`: found, left the picture, no convergence, no contrast."""

_RIM = 9
"""Pixels around the points, so that the ends of the spline's recursion are not felt (2e-5)."""
_ROOM = 4
"""Pixels that the points may move before the window is read again."""
_CONTRAST = 3.0
"""Standard deviation of the grey levels (of 255) of a subset that shows something."""
_HOPE_AFTER = 6
_HOPE = 0.25
"""A search that correlates no better than this after so many steps is given up."""
_POLE = np.sqrt(3.0) - 2.0


@dataclass(frozen=True, eq=False)
class Templates:
    """m subsets as they look in a reference picture.

    Attributes:
        centre: (m, 2) px, x and y, in the very first picture.
        xi: (m, p, 2) px, their points relative to the centre.
        value: (m, p) brightness.
        slope: (m, p, 2) its derivatives with respect to xi.
        good: (m,) False where the points are not all in the picture, or have no contrast.
    """

    centre: FloatArray
    xi: FloatArray
    value: FloatArray
    slope: FloatArray
    good: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.centre)

    def some(self, which: IntArray) -> Templates:
        """The subsets with the given numbers."""
        return Templates(
            self.centre[which],
            self.xi[which],
            self.value[which],
            self.slope[which],
            self.good[which],
        )


@dataclass(frozen=True, eq=False)
class Matches:
    """Where m subsets were found.

    Attributes:
        warp: (m, 6) as in the module's text; the last iterate where not found.
        zncc: (m,) correlation coefficient, -1..1; 0 where not found.
        sd_px: (m, 2) standard deviation of u and v by the residual brightness.
        code: (m,) :data:`FOUND` or why not.
    """

    warp: FloatArray
    zncc: FloatArray
    sd_px: FloatArray
    code: IntArray


def make_templates(
    picture: Float32Array, centre: FloatArray, xi: FloatArray, warp: FloatArray
) -> Templates:
    """Read subsets off a picture, at the places where their warps put their points.

    Args:
        picture: (h, w) brightness. centre: (m, 2) px. xi: (m, p, 2) px. warp: (m, 6).
    """
    value, slope, good = _read(picture, centre, xi, warp)
    return Templates(centre, xi, value, slope, good)


def match(
    picture: Float32Array,
    templates: Templates,
    start: FloatArray,
    *,
    iterations: int = 60,
    tolerance_px: float = 5e-4,
    reach_px: float = 12.0,
) -> Matches:
    """Find subsets in a picture.

    Args:
        picture: (h, w) brightness.
        templates: m subsets.
        start: (m, 6) where the search starts.
        iterations: at most so many.
        tolerance_px: the last step moves no point by more than about this.
        reach_px: give up where the centre gets further than this from where it started.
    """
    warp, zncc, sd, code = _match(
        picture,
        templates.centre,
        templates.xi,
        templates.value,
        templates.slope,
        templates.good,
        start,
        iterations,
        tolerance_px,
        reach_px,
    )
    return Matches(warp, zncc, sd, code)


@njit(cache=True, nogil=True)
def _coefficients(picture: Float32Array, x0: int, y0: int, width: int, height: int) -> FloatArray:
    """Cubic B-spline coefficients of a window, beyond the picture continued by its rim."""
    rows, columns = picture.shape
    c = np.empty((height, width))
    for i in range(height):
        row = min(max(y0 + i, 0), rows - 1)
        for j in range(width):
            c[i, j] = picture[row, min(max(x0 + j, 0), columns - 1)]
    z = _POLE
    for i in range(height):
        c[i, 0] *= 6.0 / (1.0 - z)
        for j in range(1, width):
            c[i, j] = 6.0 * c[i, j] + z * c[i, j - 1]
        c[i, width - 1] *= -z / (1.0 - z)
        for j in range(width - 2, -1, -1):
            c[i, j] = z * (c[i, j + 1] - c[i, j])
    for j in range(width):
        c[0, j] *= 6.0 / (1.0 - z)
    for i in range(1, height):
        for j in range(width):
            c[i, j] = 6.0 * c[i, j] + z * c[i - 1, j]
    for j in range(width):
        c[height - 1, j] *= -z / (1.0 - z)
    for i in range(height - 2, -1, -1):
        for j in range(width):
            c[i, j] = z * (c[i + 1, j] - c[i, j])
    return c


@njit(cache=True, nogil=True)
def _value(c: FloatArray, x: float, y: float) -> float:
    """Value of the spline at (x, y) of its window."""
    j, i = int(x), int(y)
    u, v = x - j, y - i
    u1, v1 = 1.0 - u, 1.0 - v
    a0, a3 = u1 * u1 * u1 / 6.0, u * u * u / 6.0
    a1 = 2.0 / 3.0 - 0.5 * u * u * (2.0 - u)
    a2 = 2.0 / 3.0 - 0.5 * u1 * u1 * (2.0 - u1)
    b0, b3 = v1 * v1 * v1 / 6.0, v * v * v / 6.0
    b1 = 2.0 / 3.0 - 0.5 * v * v * (2.0 - v)
    b2 = 2.0 / 3.0 - 0.5 * v1 * v1 * (2.0 - v1)
    r0 = a0 * c[i - 1, j - 1] + a1 * c[i - 1, j] + a2 * c[i - 1, j + 1] + a3 * c[i - 1, j + 2]
    r1 = a0 * c[i, j - 1] + a1 * c[i, j] + a2 * c[i, j + 1] + a3 * c[i, j + 2]
    r2 = a0 * c[i + 1, j - 1] + a1 * c[i + 1, j] + a2 * c[i + 1, j + 1] + a3 * c[i + 1, j + 2]
    r3 = a0 * c[i + 2, j - 1] + a1 * c[i + 2, j] + a2 * c[i + 2, j + 1] + a3 * c[i + 2, j + 2]
    return float(b0 * r0 + b1 * r1 + b2 * r2 + b3 * r3)


@njit(cache=True, nogil=True)
def _slopes(c: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Derivatives of the spline at (x, y) of its window."""
    j, i = int(x), int(y)
    u, v = x - j, y - i
    u1, v1 = 1.0 - u, 1.0 - v
    a = (
        u1 * u1 * u1 / 6.0,
        2.0 / 3.0 - 0.5 * u * u * (2.0 - u),
        2.0 / 3.0 - 0.5 * u1 * u1 * (2.0 - u1),
        u * u * u / 6.0,
    )
    b = (
        v1 * v1 * v1 / 6.0,
        2.0 / 3.0 - 0.5 * v * v * (2.0 - v),
        2.0 / 3.0 - 0.5 * v1 * v1 * (2.0 - v1),
        v * v * v / 6.0,
    )
    da = (-0.5 * u1 * u1, 0.5 * u * (3.0 * u - 4.0), 0.5 * u1 * (4.0 - 3.0 * u1), 0.5 * u * u)
    db = (-0.5 * v1 * v1, 0.5 * v * (3.0 * v - 4.0), 0.5 * v1 * (4.0 - 3.0 * v1), 0.5 * v * v)
    gx = gy = 0.0
    for p in range(4):
        for q in range(4):
            value = c[i - 1 + p, j - 1 + q]
            gx += b[p] * da[q] * value
            gy += db[p] * a[q] * value
    return gx, gy


@njit(cache=True, nogil=True)
def _box(xi: FloatArray, cx: float, cy: float, w: FloatArray) -> tuple[float, float, float, float]:
    """Smallest and largest x and y of the warped points."""
    low_x = low_y = 1e30
    high_x = high_y = -1e30
    for k in range(len(xi)):
        x = cx + w[0] + (1.0 + w[2]) * xi[k, 0] + w[3] * xi[k, 1]
        y = cy + w[1] + w[4] * xi[k, 0] + (1.0 + w[5]) * xi[k, 1]
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    return low_x, high_x, low_y, high_y


@njit(cache=True, nogil=True)
def _read(
    picture: Float32Array, centre: FloatArray, xi: FloatArray, warp: FloatArray
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    m, p = xi.shape[:2]
    value, slope = np.zeros((m, p)), np.zeros((m, p, 2))
    good = np.zeros(m, dtype=np.bool_)
    rows, columns = picture.shape
    for s in range(m):
        w = warp[s]
        low_x, high_x, low_y, high_y = _box(xi[s], centre[s, 0], centre[s, 1], w)
        if not (low_x >= 0 and low_y >= 0 and high_x <= columns - 1 and high_y <= rows - 1):
            continue
        x0, y0 = int(low_x) - _RIM, int(low_y) - _RIM
        c = _coefficients(picture, x0, y0, int(high_x) - x0 + _RIM + 2, int(high_y) - y0 + _RIM + 2)
        total = square = 0.0
        for k in range(p):
            x = centre[s, 0] + w[0] + (1.0 + w[2]) * xi[s, k, 0] + w[3] * xi[s, k, 1] - x0
            y = centre[s, 1] + w[1] + w[4] * xi[s, k, 0] + (1.0 + w[5]) * xi[s, k, 1] - y0
            g = _value(c, x, y)
            gx, gy = _slopes(c, x, y)
            value[s, k] = g
            slope[s, k, 0] = (1.0 + w[2]) * gx + w[4] * gy
            slope[s, k, 1] = w[3] * gx + (1.0 + w[5]) * gy
            total += g
            square += g * g
        good[s] = square / p - (total / p) ** 2 > _CONTRAST**2
    return value, slope, good


@njit(cache=True, nogil=True)
def _match(
    picture: Float32Array,
    centre: FloatArray,
    xi: FloatArray,
    value: FloatArray,
    slope: FloatArray,
    good: npt.NDArray[np.bool_],
    start: FloatArray,
    iterations: int,
    tolerance: float,
    reach: float,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    m, p = value.shape
    rows, columns = picture.shape
    warp = start.copy()
    zncc, sd = np.zeros(m), np.full((m, 2), np.nan)
    code = np.full(m, DIVERGED)
    found = np.empty(p)
    for s in range(m):
        w = warp[s]
        if not good[s]:
            code[s] = FLAT
            continue
        cx, cy = centre[s, 0], centre[s, 1]
        mean_f = 0.0
        for k in range(p):
            mean_f += value[s, k] / p
        norm_f = 0.0
        hessian = np.zeros((6, 6))
        far = 0.0
        for k in range(p):
            norm_f += (value[s, k] - mean_f) ** 2
            a, b = xi[s, k, 0], xi[s, k, 1]
            gx, gy = slope[s, k, 0], slope[s, k, 1]
            jac = (gx, gy, gx * a, gx * b, gy * a, gy * b)
            far = max(far, abs(a), abs(b))
            for r in range(6):
                for q in range(r + 1):
                    hessian[r, q] += jac[r] * jac[q]
        for r in range(6):
            for q in range(r):
                hessian[q, r] = hessian[r, q]
        norm_f = np.sqrt(norm_f)
        trace = 0.0
        for r in range(6):
            trace += hessian[r, r] * (1.0 if r < 2 else 1.0 / (far * far))
        for r in range(6):  # no effect on a good subset, keeps a line from being singular
            hessian[r, r] += 1e-9 * trace * (1.0 if r < 2 else far * far)
        inverse = np.linalg.inv(hessian)
        x0 = y0 = 0
        width = height = -1
        c = np.empty((1, 1))
        residual2 = 0.0
        for iteration in range(iterations + 1):
            low_x, high_x, low_y, high_y = _box(xi[s], cx, cy, w)
            if not (low_x >= 0 and low_y >= 0 and high_x <= columns - 1 and high_y <= rows - 1):
                code[s] = OUTSIDE
                break
            if high_x - low_x > 8 * far + 50 or high_y - low_y > 8 * far + 50:
                break
            if (
                low_x < x0 + _RIM
                or low_y < y0 + _RIM
                or high_x > x0 + width - _RIM - 1
                or high_y > y0 + height - _RIM - 1
            ):
                x0, y0 = int(low_x) - _RIM - _ROOM, int(low_y) - _RIM - _ROOM
                width = int(high_x) - x0 + _RIM + _ROOM + 2
                height = int(high_y) - y0 + _RIM + _ROOM + 2
                c = _coefficients(picture, x0, y0, width, height)
            mean_g = 0.0
            for k in range(p):
                a, b = xi[s, k, 0], xi[s, k, 1]
                g = _value(
                    c,
                    cx + w[0] + (1.0 + w[2]) * a + w[3] * b - x0,
                    cy + w[1] + w[4] * a + (1.0 + w[5]) * b - y0,
                )
                found[k] = g
                mean_g += g / p
            norm_g = cross = 0.0
            for k in range(p):
                norm_g += (found[k] - mean_g) ** 2
                cross += (found[k] - mean_g) * (value[s, k] - mean_f)
            norm_g = np.sqrt(norm_g)
            if norm_g < 1e-6 * norm_f or norm_g == 0.0:
                break
            zncc[s] = cross / (norm_f * norm_g)
            if code[s] == FOUND:  # the residual of the last step is known now
                gain = norm_f / norm_g
                residual2 = 0.0
                for k in range(p):
                    residual2 += (gain * (found[k] - mean_g) - (value[s, k] - mean_f)) ** 2
                break
            if iteration == iterations or (iteration >= _HOPE_AFTER and zncc[s] < _HOPE):
                break
            gain = norm_f / norm_g
            right = np.zeros(6)
            for k in range(p):
                error = gain * (found[k] - mean_g) - (value[s, k] - mean_f)
                a, b = xi[s, k, 0], xi[s, k, 1]
                gx, gy = slope[s, k, 0] * error, slope[s, k, 1] * error
                right[0] += gx
                right[1] += gy
                right[2] += gx * a
                right[3] += gx * b
                right[4] += gy * a
                right[5] += gy * b
            d = inverse @ right
            # w <- w o d^-1
            e11, e12, e21, e22 = 1.0 + d[2], d[3], d[4], 1.0 + d[5]
            det = e11 * e22 - e12 * e21
            if det < 0.2 or det > 5.0:
                break
            i11, i12, i21, i22 = e22 / det, -e12 / det, -e21 / det, e11 / det
            a11, a12, a21, a22 = 1.0 + w[2], w[3], w[4], 1.0 + w[5]
            n11, n12 = a11 * i11 + a12 * i21, a11 * i12 + a12 * i22
            n21, n22 = a21 * i11 + a22 * i21, a21 * i12 + a22 * i22
            w[0] -= n11 * d[0] + n12 * d[1]
            w[1] -= n21 * d[0] + n22 * d[1]
            w[2], w[3], w[4], w[5] = n11 - 1.0, n12, n21, n22 - 1.0
            moved = max(abs(w[0] - start[s, 0]), abs(w[1] - start[s, 1]))
            if not moved <= reach:
                break
            step = max(
                abs(d[0]) + far * (abs(d[2]) + abs(d[3])), abs(d[1]) + far * (abs(d[4]) + abs(d[5]))
            )
            if step < tolerance:
                code[s] = FOUND
        if code[s] == FOUND:
            variance = residual2 / max(p - 8, 1)
            sd[s, 0] = np.sqrt(variance * inverse[0, 0])
            sd[s, 1] = np.sqrt(variance * inverse[1, 1])
        else:
            zncc[s] = 0.0
    return warp, zncc, sd, code
