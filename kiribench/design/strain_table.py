"""A surrogate tabulated over cut lengths and strain: one small table for any number of cells.

The posterior mean at 10,000 cells, each at its own strain, costs 441 correlations a cell. It is one
smooth function of three variables, so a tensor-product cubic spline of it costs 64 numbers a cell.
With 61 x 61 x 61 nodes it errs by some 1e-5 of Poisson's ratio and of ln stress (1e-4 at most): no
answer, but a place from which one or two steps on the surrogate itself are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, NdBSpline, make_interp_spline
from scipy.sparse import csr_array

from kiribench.design.response import Jet, KernelResponse
from kiribench.surrogate.kept_model import KeptModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NODES = 61  # along each axis: 1.5 % of the cell edge
_ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


@dataclass(frozen=True, eq=False)
class StrainTable:
    """A tabulated response at the strains of n cells.

    Attributes:
        spline: of (strain, a, b); a and b are fractions.
        strain: (n,) within the surrogate's data.
    """

    spline: NdBSpline
    strain: FloatArray

    @classmethod
    def of(cls, kept: KeptModel, strain: FloatArray, high: float) -> StrainTable:
        """The mean of a kept model at (n,) strains, for cuts up to ``high``.

        Raises:
            UsageError: the model is no exact Gaussian process of (a, b, strain).
        """
        strains = np.linspace(kept.low[2], kept.high[2], NODES)
        ticks = np.linspace(0.0, high, NODES)
        table = KernelResponse.of(kept, strains).on_grid(ticks, ticks)
        knots = []
        for place, nodes in enumerate((strains, ticks, ticks)):
            along = make_interp_spline(nodes, table, axis=place)
            table = np.moveaxis(along.c, 0, place)
            knots.append(along.t)
        return cls(NdBSpline(tuple(knots), np.ascontiguousarray(table), 3), strain)

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return len(self.strain)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        by_a, by_b = (_basis(x, self.spline.t[1 + side]) for side, x in enumerate((a, b)))
        levels = by_a.toarray() @ self.spline.c @ by_b.toarray().T
        strain = self.strain if cells is None else self.strain[cells]
        values = _basis(strain, self.spline.t[0]) @ levels.reshape(len(levels), -1)
        return np.asarray(values).reshape(len(strain), len(a), len(b))

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        strain = self.strain if cells is None else self.strain[cells]
        at = np.column_stack([strain, points])
        f, fa, fb, faa, fab, fbb = (self.spline(at, nu=(0, *order)) for order in _ORDERS)
        return Jet(
            value=f,
            slope=np.stack([fa, fb], axis=-1),
            curvature=np.stack([faa, fab, fab, fbb], axis=-1).reshape(-1, 2, 2),
        )


def _basis(x: FloatArray, knots: FloatArray) -> csr_array:
    return csr_array(BSpline.design_matrix(x, knots, 3))
