"""A response on a grid as bicubic patches: what the search walks on before the last steps.

A cubic spline through the grid's values (not-a-knot, in both directions) as Hermite patches. A
point costs 16 numbers instead of one correlation a design of the table. With steps of 2 % it errs
by some 1e-5 of Poisson's ratio: no answer, but a start from which Newton's method on the surrogate
itself needs two or three steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from kiribench.design.response import Jet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Patchwork:
    """Bicubic patches over the square of a grid, for n cells.

    Attributes:
        ticks: (A,) evenly spaced from 0, of both axes.
        nodes: (n, A, A, 2, 2) value, derivative by a, by b and by both, each per step.
    """

    ticks: FloatArray
    nodes: FloatArray

    @classmethod
    def of(cls, ticks: FloatArray, values: FloatArray) -> Patchwork:
        """Through (n, A, A) values on the ticks."""
        slopes = _slopes(len(ticks))
        by_a = slopes @ values
        nodes = np.empty((*values.shape, 2, 2))
        nodes[..., 0, 0], nodes[..., 1, 0] = values, by_a
        nodes[..., 0, 1], nodes[..., 1, 1] = values @ slopes.T, by_a @ slopes.T
        return cls(ticks, nodes)

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return len(self.nodes)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        which = np.arange(self.count) if cells is None else cells
        points = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        every = self.jet(np.tile(points, (len(which), 1)), np.repeat(which, len(points)))
        return every.value.reshape(len(which), len(a), len(b))

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        which = np.arange(len(points)) if cells is None else cells
        step = self.ticks[1] - self.ticks[0]
        place = points / step
        index = np.clip(place.astype(np.int64), 0, len(self.ticks) - 2)
        by_a, by_b = _hermite(place[:, 0] - index[:, 0]), _hermite(place[:, 1] - index[:, 1])
        i, j = index.T
        corners = np.empty((len(points), 4, 4))
        for side_a in range(2):
            for side_b in range(2):
                block = self.nodes[which, i + side_a, j + side_b]
                corners[:, side_a::2, side_b::2] = block
        table = by_a @ corners @ by_b.transpose(0, 2, 1)
        d = table / step ** np.add.outer(np.arange(3), np.arange(3))
        return Jet(
            value=d[:, 0, 0],
            slope=np.stack([d[:, 1, 0], d[:, 0, 1]], axis=-1),
            curvature=np.stack([d[:, 2, 0], d[:, 1, 1], d[:, 1, 1], d[:, 0, 2]], axis=-1).reshape(
                -1, 2, 2
            ),
        )


@cache
def _slopes(count: int) -> FloatArray:
    """(A, A): values on evenly spaced ticks to the spline's derivative there, per step."""
    ticks = np.arange(count, dtype=np.float64)
    spline = make_interp_spline(ticks, np.eye(count), k=min(3, count - 1))
    slopes = np.asarray(spline.derivative()(ticks))
    slopes.setflags(write=False)
    return slopes


def _hermite(u: FloatArray) -> FloatArray:
    """(k, 3, 4) basis and two derivatives; order: value left, right, slope left, right."""
    rows = np.array(
        [[1.0, 0, -3, 2], [0, 0, 3, -2], [0, 1, -2, 1], [0, 0, -1, 1]]
    )  # by powers of u
    one, zero = np.ones_like(u), np.zeros_like(u)
    powers = np.stack(
        [
            np.stack([one, u, u * u, u**3], axis=-1),
            np.stack([zero, one, 2 * u, 3 * u * u], axis=-1),
            np.stack([zero, zero, 2 * one, 6 * u], axis=-1),
        ],
        axis=1,
    )
    return np.asarray(powers @ rows.T)
