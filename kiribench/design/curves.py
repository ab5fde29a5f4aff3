"""The curve of all designs of a cell that have one and the same Poisson's ratio."""

from __future__ import annotations

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from kiribench.design.level import onto_level
from kiribench.design.reachable import axis
from kiribench.design.response import Response

FloatArray = NDArray[np.float64]

BLOCK = 500  # cells at a time


def equivalent_designs(
    response: Response, target: FloatArray, high: float
) -> list[tuple[FloatArray, ...]]:
    """For each of n cells the polylines (k, 2) of ``response = target`` within the limits.

    Contours of the coarse grid, then each point moved onto the curve to 1e-9. A cell whose
    target is out of reach has none.
    """
    ticks = axis(high)
    found: list[tuple[FloatArray, ...]] = []
    for start in range(0, response.count, BLOCK):
        some = np.arange(start, min(start + BLOCK, response.count))
        grid = response.on_grid(ticks, ticks, some)
        lines = [
            [np.asarray(line)[:, ::-1] for line in contour_generator(ticks, ticks, z).lines(level)]
            for z, level in zip(grid, target[some], strict=True)
        ]
        points = [np.concatenate(of) if of else np.zeros((0, 2)) for of in lines]
        cells = np.repeat(some, [len(p) for p in points])
        moved = onto_level(
            response, np.clip(np.concatenate(points), 0.0, high), cells, target[cells], high
        )
        sizes = [[len(line) for line in of] for of in lines]
        at = 0
        for of in sizes:
            pieces = []
            for size in of:
                piece = moved[at : at + size]
                at += size
                pieces.append(piece[np.isfinite(piece).all(axis=1)])
            found.append(tuple(piece for piece in pieces if len(piece) > 1))
    return found
