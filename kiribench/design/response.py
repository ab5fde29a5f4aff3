"""A surrogate at fixed strains: smooth functions of (a, b), one a cell, with two derivatives.

At one strain the posterior mean of a Gaussian process with a product kernel is a short sum over
the table's designs, ``m(a, b) = mean + sum_ij W_ij k_a(a, a_i) k_b(b, b_j)``: the strain enters W
alone, which is computed once a cell. So a value with all derivatives costs two products of 21 x 21
numbers for the paper's table, whatever the number of load steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.design.factors import Factor
from kiribench.errors import UsageError
from kiribench.surrogate import likelihood
from kiribench.surrogate.devices import torch_threads
from kiribench.surrogate.exact_gp import ExactGP, GridState
from kiribench.surrogate.keep import KeptModel
from kiribench.surrogate.likelihood import TorchParameters

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CHUNK = 20_000  # points at a time: 70 MB of weights for the paper's table


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
        weights: (n, P, Q) over a lattice of designs, or (n, p) over scattered ones.
        mean: constant that is added.
        factors: of a over P or p nodes, and of b over Q or p.
    """

    weights: FloatArray
    mean: float
    factors: tuple[Factor, Factor]

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
        with torch_threads(1):
            designs, weights = _weights(estimator, strain)
        learnt, form = estimator.hyperparameters_, estimator._kernel_form(3)
        nodes = (designs[:, 0], designs[:, 1])
        (a, at_a), (b, at_b) = (np.unique(node, return_inverse=True) for node in nodes)
        if len(a) * len(b) <= 4 * len(designs):
            lattice = np.zeros((len(weights), len(a), len(b)))
            lattice[:, at_a, at_b] = weights
            weights, nodes = lattice, (a, b)
        return cls(
            weights,
            learnt.target_mean,
            (Factor.of(form, learnt, 0, nodes[0]), Factor.of(form, learnt, 1, nodes[1])),
        )

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return len(self.weights)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        weights = self.weights if cells is None else self.weights[cells]
        by_a, by_b = self.factors[0].values(a), self.factors[1].values(b)
        if weights.ndim == 3:
            return np.asarray(by_a @ (weights @ by_b.T) + self.mean)
        return np.stack([(by_a * row) @ by_b.T for row in weights]) + self.mean

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        which = np.arange(len(points)) if cells is None else cells
        parts = [
            self._table(points[start : start + CHUNK], which[start : start + CHUNK])
            for start in range(0, max(len(points), 1), CHUNK)
        ]
        d = np.concatenate(parts)
        return Jet(
            value=d[:, 0, 0] + self.mean,
            slope=np.stack([d[:, 1, 0], d[:, 0, 1]], axis=-1),
            curvature=np.stack([d[:, 2, 0], d[:, 1, 1], d[:, 1, 1], d[:, 0, 2]], axis=-1).reshape(
                -1, 2, 2
            ),
        )

    def _table(self, points: FloatArray, cells: IntArray) -> FloatArray:
        """(k, 3, 3) derivatives: entry (i, j) is the i-th by a and the j-th by b."""
        by_a, by_b = self.factors[0].jet(points[:, 0]), self.factors[1].jet(points[:, 1])
        weights = self.weights[cells]
        if weights.ndim == 3:
            return np.asarray(by_a @ weights @ by_b.transpose(0, 2, 1))
        return np.asarray((by_a * weights[:, None, :]) @ by_b.transpose(0, 2, 1))


def _weights(estimator: ExactGP, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, 2) scaled designs, and (n, p) their weights in the mean at each strain."""
    learnt, state = estimator.hyperparameters_, estimator._state
    form = estimator._kernel_form(3)
    at = torch.as_tensor((strain - learnt.input_low[2]) / learnt.input_span[2])[:, None]
    if isinstance(state, GridState):
        designs, strains = state.designs.cpu(), state.strains.cpu()
        parameters = TorchParameters.of(learnt.kernel_parameters(), designs)
        f, alpha = state.conditioned.factors, state.conditioned.alpha
        solved = (f.u @ alpha @ f.v.T).cpu()
        weights = likelihood.strain_correlation(form, at, strains, parameters) @ solved.T
    else:
        inputs = state.inputs.cpu()
        parameters = TorchParameters.of(learnt.kernel_parameters(), inputs)
        by_strain = likelihood.strain_correlation(form, at, inputs[:, 2:], parameters)
        designs, of_row = torch.unique(inputs[:, :2], dim=0, return_inverse=True)
        weights = torch.zeros((len(at), len(designs)), dtype=at.dtype)
        weights.index_add_(1, of_row, by_strain * state.conditioned.alpha.cpu())
    return designs.numpy(), (weights * learnt.target_scale).numpy()
