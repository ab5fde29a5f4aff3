"""The sum that ``balanced`` makes small, with its slope and its matrix of second derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array

from kiribench.design.response import Jet, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

UNIQUE_SD = 10.0
EMPTY = 1e-9  # curvature of the force of a column in which no cell is pulled


@dataclass(frozen=True, eq=False)
class Terms:
    """The parts of the sum over the N = R C cells of a patch, in row-major order.

    Attributes:
        nu: Poisson's ratio of the N cells.
        stress: ln (nominal stress / strain) of the N cells, stress in MPa.
        target: (N,) of Poisson's ratio.
        log_strain: (N,).
        nu_weight: (N,) 1 / poisson_sd; 0 without a target.
        force_weight: (N,) 1 / force_sd; 0 without a strain.
        smooth: (N, N) quadratic form of the neighbours' differences and of the uniqueness, the
            same for a and for b.
        shape: (R, C).
        high: longest cut, fraction.
    """

    nu: Response
    stress: Response
    target: FloatArray
    log_strain: FloatArray
    nu_weight: FloatArray
    force_weight: FloatArray
    smooth: csr_array
    shape: tuple[int, int]
    high: float

    @property
    def column(self) -> IntArray:
        """(N,) column of each cell."""
        return np.arange(len(self.target)) % self.shape[1]

    def force_of(self, log_stress: FloatArray) -> FloatArray:
        """(C,) means of ln stress over the cells of each column that are pulled."""
        pulled = (self.force_weight > 0).astype(np.float64)
        count = np.bincount(self.column, pulled, self.shape[1])
        total = np.bincount(self.column, pulled * log_stress, self.shape[1])
        return np.asarray(total / np.maximum(count, 1.0))

    def log_stress(self, x: FloatArray) -> FloatArray:
        """(N,) ln of the nominal stress in MPa at (N, 2) cuts."""
        return self.log_strain + self.stress.jet(x).value

    def own(self, points: FloatArray, cells: IntArray, force: FloatArray) -> Jet:
        """Each cell's own two squares at (k, 2) points for (k,) cells and given (C,) forces."""
        nu, stress = self.nu.jet(points, cells), self.stress.jet(points, cells)
        miss = self.nu_weight[cells] * (nu.value - self.target[cells])
        level = self.log_strain[cells] - force[cells % self.shape[1]]
        uneven = self.force_weight[cells] * (stress.value + level)
        slope, curvature = np.zeros((len(cells), 2)), np.zeros((len(cells), 2, 2))
        for residual, weight, jet in (
            (miss, self.nu_weight[cells], nu),
            (uneven, self.force_weight[cells], stress),
        ):
            by = weight[:, None] * jet.slope
            slope += 2.0 * residual[:, None] * by
            curvature += 2.0 * by[:, :, None] * by[:, None, :]
            curvature += 2.0 * (residual * weight)[:, None, None] * jet.curvature
        return Jet(miss**2 + uneven**2, slope, curvature)

    def at(self, x: FloatArray) -> At:
        """The sum at (N, 2) cuts, the columns' forces at their best for them."""
        every = np.arange(len(x))
        stress = self.stress.jet(x)
        force = self.force_of(self.log_strain + stress.value)
        own = self.own(x, every, force)
        pull = self.smooth @ x
        by_force = -2.0 * self.force_weight[:, None] ** 2 * stress.slope
        return At(
            x=x,
            force=force,
            value=float(own.value.sum() + np.sum(x * pull)),
            slope=(own.slope + 2.0 * pull).ravel(),
            matrix=self._matrix(own.curvature, by_force),
        )

    def _matrix(self, blocks: FloatArray, by_force: FloatArray) -> csc_array:
        """(2 N + C, 2 N + C) by the cuts and, behind them, the columns' forces."""
        n, c = len(self.target), self.shape[1]
        smooth = self.smooth.tocoo()
        i, j = smooth.coords
        first = 2 * np.arange(n)
        force = np.repeat(2 * n + self.column, 2)
        cut = np.arange(2 * n)
        last = 2 * n + np.arange(c)
        stiffness = 2.0 * np.bincount(self.column, self.force_weight**2, c)
        entries = [
            (2 * i, 2 * j, 2.0 * smooth.data),
            (2 * i + 1, 2 * j + 1, 2.0 * smooth.data),
            (first, first, blocks[:, 0, 0]),
            (first, first + 1, blocks[:, 0, 1]),
            (first + 1, first, blocks[:, 1, 0]),
            (first + 1, first + 1, blocks[:, 1, 1]),
            (cut, force, by_force.ravel()),
            (force, cut, by_force.ravel()),
            (last, last, np.maximum(stiffness, EMPTY)),
        ]
        row, column, entry = (np.concatenate(part) for part in zip(*entries, strict=True))
        return coo_array((entry, (row, column)), shape=(2 * n + c,) * 2).tocsc()


@dataclass(frozen=True, eq=False)
class At:
    """The sum at a place.

    Attributes:
        x: (N, 2) cuts.
        force: (C,) best ln forces for them.
        value: of the sum.
        slope: (2 N,) by the cuts; by the forces it is 0 here.
        matrix: (2 N + C, 2 N + C) second derivatives by cuts and forces.
    """

    x: FloatArray
    force: FloatArray
    value: float
    slope: FloatArray
    matrix: csc_array


def smoothness(shape: tuple[int, int], neighbour_sd: float) -> csr_array:
    """(N, N) form of ``((a - a') / neighbour_sd)^2`` over common sides and ``(a / 10)^2``.

    >>> smoothness((1, 2), 0.5).toarray()
    array([[ 4.01, -4.  ],
           [-4.  ,  4.01]])
    """
    rows, columns = shape
    index = np.arange(rows * columns).reshape(shape)
    one = np.concatenate([index[:-1].ravel(), index[:, :-1].ravel()])
    two = np.concatenate([index[1:].ravel(), index[:, 1:].ravel()])
    number = np.arange(len(one))
    unit = np.full(len(one), 1.0 / neighbour_sd)
    apart = coo_array(
        (
            np.concatenate([unit, -unit]),
            (np.concatenate([number, number]), np.concatenate([one, two])),
        ),
        shape=(len(one), rows * columns),
    ).tocsr()
    return csr_array(apart.T @ apart + diags_array(np.full(rows * columns, UNIQUE_SD**-2)))
