"""A surrogate at fixed strains: smooth functions of (a, b), one a cell, with two derivatives.

At one strain the posterior mean of a Gaussian process with a product kernel is a short sum over
the table's designs, ``m(a, b) = mean + sum_p W_p k((a, b), (a_p, b_p))``: the strain enters W
alone, which is computed once a cell. So a value with all derivatives costs 441 correlations for
the paper's table, whatever the number of load steps; on a grid that is kept, one product with the
weights of the table's 25 strains.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.design.design_part import DesignPart, design_part
from kiribench.errors import UsageError
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.kept_model import KeptModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Jet:
    """Values and derivatives at k points, by a and b as fractions of the cell edge.

    Attributes:
        value: (k,).
        slope: (k, 2).
        curvature: (k, 2, 2).
    """

    value: FloatArray
    slope: FloatArray
    curvature: FloatArray


class Response(Protocol):
    """A smooth function of (a, b) for each of n cells; a and b are fractions."""

    @property
    def count(self) -> int:
        """Number of cells, n."""
        ...

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        ...

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        ...


@dataclass(frozen=True, eq=False)
class KernelResponse:
    """The posterior mean of an exact Gaussian process at one strain a cell.

    Attributes:
        part: of the process, the same for every strain.
        strain_weights: (n, t) or (n, p), what the strains make of it, a row a cell.
        weights: (n, p) of the table's p designs.
    """

    part: DesignPart
    strain_weights: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, kept: KeptModel, strain: FloatArray) -> KernelResponse:
        """The mean of a kept model at (n,) strains, in the model's measure.

        Raises:
            UsageError: the model is no exact Gaussian process of (a, b, strain).
        """
        estimator = kept.estimator
        if not isinstance(estimator, ExactGP) or len(kept.low) != 3:
            raise UsageError(
                "surrogate-not-smooth",
                "The surrogate is no exact Gaussian process; the search needs its derivatives.",
                remedy="Fit the table with --model gp_kronecker (the default) or gp.",
                got=kept.name,
            )
        part = design_part(estimator)
        by_strain = part.weights_at(strain)
        weights = by_strain if part.by_strain is None else by_strain @ part.by_strain
        return cls(part, by_strain, weights)

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return len(self.weights)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        weights = self.strain_weights if cells is None else self.strain_weights[cells]
        values = weights @ self.part.on_grid(a, b)
        values += self.part.mean
        return values.reshape(len(weights), len(a), len(b))

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        which = np.arange(len(points)) if cells is None else cells
        return Jet(*self.part.jets(points, self.weights, which))
