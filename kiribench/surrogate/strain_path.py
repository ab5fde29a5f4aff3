"""Strain along a design's own path: 0 at its first step, 1 at its last.

Sheets that are pulled to common displacements end at strains of their own, which are smooth
functions of the cut lengths. On a common grid of strains whatever lies beyond the shortest
curve would be lost to all designs, and predicted by extrapolation. Along their paths all
curves reach from 0 to 1, and the designs are a complete grid again. The path is a choice of
coordinate and no prediction: that a design ends a little off the polynomial costs nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Path = tuple[tuple[float, ...], ...]

HIGHEST_DEGREE = 6
LEAST_FULL = 0.6  # of the designs must have the usual number of steps
COEFFICIENT_SHARE = 4  # designs for each coefficient, at least
WORTH = 0.5  # left-out ends are off by less than that of what one end for all is off
NARROWEST = 0.2  # a path is nowhere shorter than that of the median one


def strain_path(X: FloatArray) -> Path:
    """The first and last strains as polynomials in a and b, learnt from curves.

    The degree is the one that predicts left-out designs' ends best. The last strains are those
    of the designs with the usual number of steps: others stopped early.

    Args:
        X: (n, 3) rows: a, b, strain.

    Returns:
        Two rows of Chebyshev coefficients over the scaled cut lengths, see :func:`along`; or
        nothing where the ends are no smooth function of the cut lengths, or are all the same.
    """
    designs, row_design = np.unique(X[:, :2], axis=0, return_inverse=True)
    row_design = row_design.ravel()
    counts = np.bincount(row_design)
    full = counts == np.bincount(counts).argmax()
    if full.sum() < LEAST_FULL * len(designs) or (np.ptp(designs, axis=0) == 0.0).any():
        return ()
    scaled = (designs - designs.min(axis=0)) / np.ptp(designs, axis=0)
    first, last = np.full(len(designs), np.inf), np.full(len(designs), -np.inf)
    np.minimum.at(first, row_design, X[:, 2])
    np.maximum.at(last, row_design, X[:, 2])
    path = _polynomial(scaled, first), _polynomial(scaled[full], last[full])
    if max(map(len, path)) == 1:
        return ()
    length = _value(path[1], scaled) - _value(path[0], scaled)
    return path if length.min() > NARROWEST * np.median(length) else ()


def along(path: Path, designs: FloatArray, strain: FloatArray) -> FloatArray:
    """(n,) strains along the paths of their designs.

    Args:
        path: of :func:`strain_path`.
        designs: (n, 2) scaled to [0, 1]; beyond it the path of the nearest point is taken.
        strain: (n,) in the table's measure.
    """
    first, last = (_value(coefficients, designs) for coefficients in path)
    return np.asarray((strain - first) / (last - first))


def _polynomial(designs: FloatArray, ends: FloatArray) -> tuple[float, ...]:
    best: tuple[float, FloatArray] | None = None
    for degree in range(HIGHEST_DEGREE + 1):
        basis = _basis(designs, degree)
        if degree and COEFFICIENT_SHARE * basis.shape[1] > len(ends):
            break
        q, r = np.linalg.qr(basis)
        if np.abs(np.diag(r)).min() < 1e-9 * np.abs(np.diag(r)).max():
            break  # too few levels of a or b for this degree
        # Allen's PRESS: the error at each design when it is left out.
        left_out = (ends - q @ (q.T @ ends)) / (1.0 - np.square(q).sum(axis=1))
        rms = float(np.sqrt(np.mean(left_out**2)))
        if best is None or rms < (best[0] if len(best[1]) > 1 else WORTH * best[0]):
            best = rms, np.linalg.solve(r, q.T @ ends)
    return () if best is None else tuple(best[1].tolist())


def _value(coefficients: tuple[float, ...], designs: FloatArray) -> FloatArray:
    degree = round((np.sqrt(8 * len(coefficients) + 1) - 3) / 2)
    return np.asarray(_basis(designs, degree) @ np.array(coefficients))


def _basis(designs: FloatArray, degree: int) -> FloatArray:
    """(n, (degree + 1)(degree + 2) / 2): products of Chebyshev polynomials up to a total degree."""
    x = 2.0 * np.clip(designs, 0.0, 1.0) - 1.0
    by_a, by_b = chebvander(x[:, 0], degree), chebvander(x[:, 1], degree)
    return np.column_stack(
        [by_a[:, i] * by_b[:, j] for i in range(degree + 1) for j in range(degree + 1 - i)]
    )
