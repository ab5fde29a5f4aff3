"""How much Poisson's ratio changes when the cuts come out wrong, and designs that mind least."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.design.curves import equivalent_designs
from kiribench.design.level import onto_level
from kiribench.design.response import Response

FloatArray = NDArray[np.float64]

FINER = 21  # points looked at between two neighbours of the best one


def cutting_error(slope: FloatArray, cut_error: float, kerf_error: float) -> FloatArray:
    """Standard deviation of Poisson's ratio by cutting errors, to first order.

    Args:
        slope: (k, 2) derivatives by a and b as fractions.
        cut_error: standard deviation of each cut length, fraction of the cell edge.
        kerf_error: the same of what lengthens all cuts alike.
    """
    each = cut_error**2 * (slope**2).sum(axis=1)
    return np.asarray(np.sqrt(each + (kerf_error * slope.sum(axis=1)) ** 2))


def least_sensitive(
    response: Response,
    target: FloatArray,
    high: float,
    cut_error: float,
    kerf_error: float,
) -> FloatArray:
    """(n, 2) of all cuts with the target Poisson's ratio those that cutting errors change least.

    NaN where no cuts have it (the target is at or beyond the end of the reachable range).
    """
    best = np.full((response.count, 2), np.nan)
    for cell, pieces in enumerate(equivalent_designs(response, target, high)):
        if not pieces:
            continue
        points = np.concatenate(pieces)
        found = _best(response, points, cell, cut_error, kerf_error)
        # Once more between the neighbours of the best point of its piece.
        piece = next(p for p in pieces if (p == found).all(axis=1).any())
        at = int(np.flatnonzero((piece == found).all(axis=1))[0])
        ends = piece[max(at - 1, 0)], piece[min(at + 1, len(piece) - 1)]
        share = np.linspace(0.0, 1.0, FINER)[:, None]
        finer = onto_level(
            response,
            np.concatenate(
                [(1 - share) * ends[0] + share * found, (1 - share) * found + share * ends[1]]
            ),
            np.full(2 * FINER, cell),
            np.full(2 * FINER, target[cell]),
            high,
        )
        finer = finer[np.isfinite(finer).all(axis=1)]
        best[cell] = _best(response, np.vstack([finer, found]), cell, cut_error, kerf_error)
    return best


def _best(
    response: Response, points: FloatArray, cell: int, cut_error: float, kerf_error: float
) -> FloatArray:
    slope = response.jet(points, np.full(len(points), cell)).slope
    return np.asarray(points[int(np.argmin(cutting_error(slope, cut_error, kerf_error)))])
