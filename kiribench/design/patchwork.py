"""A response on a grid as bicubic patches: what the search walks on before the last steps.

Hermite patches with slopes by differences of fourth order, so that a point costs 16 numbers
instead of one correlation a design of the table. With steps of 2.5 % they err by some 1e-5 of
Poisson's ratio: no answer, but a start from which Newton's method on the surrogate itself needs
two or three steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Scalars = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class Patchwork:
    """Bicubic patches over the square of a grid, for n cells.

    Attributes:
        ticks: (A,) evenly spaced from 0, of both axes.
        nodes: (n, A, A, 4) value, derivative by a, by b and by both, each per step.
    """

    ticks: FloatArray
    nodes: FloatArray

    @classmethod
    def of(cls, ticks: FloatArray, values: FloatArray) -> Patchwork:
        """Through (n, A, A) values on at least five ticks."""
        nodes = np.empty((*values.shape, 4))
        _fill(np.ascontiguousarray(values), nodes)
        return cls(ticks, nodes)

    @property
    def step(self) -> float:
        """Between two ticks."""
        return float(self.ticks[1] - self.ticks[0])


@njit(cache=True, error_model="numpy")
def _fill(values: FloatArray, nodes: FloatArray) -> None:
    count = values.shape[1]
    # Rows: the five-point stencils at the first, second, any inner, last but one, last tick.
    stencils = np.array(
        [
            [-25.0, 48.0, -36.0, 16.0, -3.0],
            [-3.0, -10.0, 18.0, -6.0, 1.0],
            [1.0, -8.0, 0.0, 8.0, -1.0],
            [-1.0, 6.0, -18.0, 10.0, 3.0],
            [3.0, -16.0, 36.0, -48.0, 25.0],
        ]
    ) / 12.0  # fmt: skip
    for n in range(values.shape[0]):
        for i in range(count):
            first = min(max(i - 2, 0), count - 5)
            s = stencils[i - first]
            for j in range(count):
                nodes[n, i, j, 0] = values[n, i, j]
                nodes[n, i, j, 1] = (
                    s[0] * values[n, first, j]
                    + s[1] * values[n, first + 1, j]
                    + s[2] * values[n, first + 2, j]
                    + s[3] * values[n, first + 3, j]
                    + s[4] * values[n, first + 4, j]
                )
        for i in range(count):
            for j in range(count):
                first = min(max(j - 2, 0), count - 5)
                s = stencils[j - first]
                by_b = by_both = 0.0
                for m in range(5):
                    by_b += s[m] * nodes[n, i, first + m, 0]
                    by_both += s[m] * nodes[n, i, first + m, 1]
                nodes[n, i, j, 2] = by_b
                nodes[n, i, j, 3] = by_both


@njit(inline="always")
def _hermite(u: float) -> tuple[float, float, float, float]:
    """Value left, slope left, value right, slope right."""
    v = 1.0 - u
    return v * v * (1.0 + 2.0 * u), u * v * v, u * u * (3.0 - 2.0 * u), -u * u * v


@njit(inline="always")
def _hermite_slope(u: float) -> tuple[float, float, float, float]:
    v = 1.0 - u
    return -6.0 * u * v, v * (1.0 - 3.0 * u), 6.0 * u * v, u * (3.0 * u - 2.0)


@njit(inline="always")
def _hermite_curvature(u: float) -> tuple[float, float, float, float]:
    return 12.0 * u - 6.0, 6.0 * u - 4.0, 6.0 - 12.0 * u, 6.0 * u - 2.0


@njit(inline="always")
def _combined(
    nodes: FloatArray,
    i: int,
    j: int,
    p: tuple[float, float, float, float],
    q: tuple[float, float, float, float],
) -> float:
    c00, c01 = nodes[i, j], nodes[i, j + 1]
    c10, c11 = nodes[i + 1, j], nodes[i + 1, j + 1]
    value: float = (
        p[0] * (q[0] * c00[0] + q[1] * c00[2] + q[2] * c01[0] + q[3] * c01[2])
        + p[1] * (q[0] * c00[1] + q[1] * c00[3] + q[2] * c01[1] + q[3] * c01[3])
        + p[2] * (q[0] * c10[0] + q[1] * c10[2] + q[2] * c11[0] + q[3] * c11[2])
        + p[3] * (q[0] * c10[1] + q[1] * c10[3] + q[2] * c11[1] + q[3] * c11[3])
    )
    return value


@njit(cache=True, error_model="numpy")
def patch_jet(nodes: FloatArray, step: float, x: float, y: float) -> Scalars:
    """Value, derivatives by a, b, aa, ab, bb at one point of one cell's (A, A, 4) nodes."""
    count = nodes.shape[0]
    i = min(max(int(x / step), 0), count - 2)
    j = min(max(int(y / step), 0), count - 2)
    return patch_jet_in(nodes, step, x, y, i, j)


@njit(cache=True, error_model="numpy")
def patch_jet_in(nodes: FloatArray, step: float, x: float, y: float, i: int, j: int) -> Scalars:
    """The same by the patch that begins at node (i, j), wherever the point is."""
    u, v = x / step - i, y / step - j
    p0, p1, p2 = _hermite(u), _hermite_slope(u), _hermite_curvature(u)
    q0, q1, q2 = _hermite(v), _hermite_slope(v), _hermite_curvature(v)
    square = step * step
    return (
        _combined(nodes, i, j, p0, q0),
        _combined(nodes, i, j, p1, q0) / step,
        _combined(nodes, i, j, p0, q1) / step,
        _combined(nodes, i, j, p2, q0) / square,
        _combined(nodes, i, j, p1, q1) / square,
        _combined(nodes, i, j, p0, q2) / square,
    )
