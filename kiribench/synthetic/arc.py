"""Geodesics of a smooth surface between given points, as boundary value problems.

q'' + Gamma(q)(q', q') = 0 with q(0), q(1) given, collocated at Chebyshev points and solved
by Picard iteration with the inverse of the second-derivative matrix; spectral accuracy, all
pairs at once (Trefethen, Spectral Methods in MATLAB, 2000, chapters 6 and 13). Made for
short arcs: a few centimetres at radii of curvature that are no smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.errors import NotConvergedError
from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.smooth import SmoothSurface

COLLOCATION_POINTS = 16
"""Chebyshev points a geodesic; 20 change no length by more than 1e-9 mm on the knees."""


@dataclass(frozen=True, eq=False)
class Arcs:
    """Geodesics between pairs of points.

    Attributes:
        q: (k, n, 2) parameters (u, v) at n Chebyshev points, from the start to the end.
        length_mm: (k,) lengths.
    """

    q: FloatArray
    length_mm: FloatArray

    def sampled(self, pieces: int) -> FloatArray:
        """(k, pieces + 1, 2) parameters at equal steps of arc length, ends included."""
        matrix = _interpolation(self.q.shape[1], np.linspace(0.0, 1.0, pieces + 1))
        out = np.einsum("mn,knc->kmc", matrix, self.q)
        out[:, 0], out[:, -1] = self.q[:, 0], self.q[:, -1]
        return np.asarray(out)


def geodesic_arcs(
    surface: SmoothSurface,
    start: FloatArray,
    end: FloatArray,
    *,
    points: int = COLLOCATION_POINTS,
    tolerance_mm: float = 1e-10,
    iterations: int = 200,
) -> Arcs:
    """The geodesics from each start to its end that are nearest to straight parameter lines.

    Args:
        surface: the smooth surface.
        start, end: (k, 2) parameters (u, v).
        points: collocation points a geodesic.
        tolerance_mm: largest change of the last iteration.
        iterations: give up after so many.

    Raises:
        NotConvergedError: ``geodesic-not-converged``; the arcs are too long for their
            curvature: join nearer points.
    """
    t, d1 = _chebyshev(points)
    inverse = np.linalg.inv((d1 @ d1)[1:-1, 1:-1])
    weights = _quadrature(points)
    straight = start[:, None, :] + t[None, :, None] * (end - start)[:, None, :]
    q = straight.copy()
    change = np.inf
    for _ in range(iterations):
        velocity = np.einsum("mn,knc->kmc", d1, q)
        _, gamma = surface.metric_and_christoffel(q[:, 1:-1])
        inner = velocity[:, 1:-1]
        force = np.einsum("...kij,...i,...j->...k", gamma, inner, inner)
        new = straight.copy()
        new[:, 1:-1] -= np.einsum("mn,knc->kmc", inverse, force)
        change = float(np.max(np.abs(new - q), initial=0.0))
        q = new
        if change < tolerance_mm:
            break
    else:
        raise NotConvergedError(
            "geodesic-not-converged",
            "A geodesic of a closed-form surface was not found.",
            got=f"last change {change:.3g} mm",
            expected=f"below {tolerance_mm:.3g} mm",
            remedy="Join nearer points: the arcs must be short against the radii of curvature.",
        )
    velocity = np.einsum("mn,knc->kmc", d1, q)
    g = surface.metric(q)
    speed = np.sqrt(np.einsum("...ij,...i,...j", g, velocity, velocity))
    return Arcs(q, np.asarray(speed @ weights))


def _chebyshev(n: int) -> tuple[FloatArray, FloatArray]:
    """Chebyshev points on [0, 1] in ascending order, and the differentiation matrix."""
    k = np.arange(n)
    x = 0.5 - 0.5 * np.cos(np.pi * k / (n - 1))
    c = np.ones(n)
    c[[0, -1]] = 2.0
    c *= (-1.0) ** k
    difference = x[:, None] - x[None, :] + np.eye(n)
    d = np.outer(c, 1.0 / c) / difference
    d -= np.diag(d.sum(axis=1))
    return x, d


def _quadrature(n: int) -> FloatArray:
    """Clenshaw-Curtis weights of the Chebyshev points on [0, 1]."""
    degree = np.arange(n)
    x = np.cos(np.pi * np.arange(n) / (n - 1))[::-1]
    vandermonde = np.cos(np.arccos(x)[None, :] * degree[:, None])
    even = degree % 2 == 0
    moments = np.where(even, 1.0 / np.where(even, 1.0 - degree.astype(float) ** 2, 1.0), 0.0)
    return np.asarray(np.linalg.solve(vandermonde, moments))


def _interpolation(n: int, targets: FloatArray) -> FloatArray:
    """(m, n) barycentric interpolation from the Chebyshev points to the targets."""
    x, _ = _chebyshev(n)
    w = (-1.0) ** np.arange(n)
    w[[0, -1]] *= 0.5
    difference = targets[:, None] - x[None, :]
    exact = np.abs(difference) < 1e-14
    ratio = w / np.where(exact, 1.0, difference)
    matrix = ratio / ratio.sum(axis=1, keepdims=True)
    hit = exact.any(axis=1)
    matrix[hit] = exact[hit]
    return np.asarray(matrix)
