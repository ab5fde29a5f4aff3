"""A surrogate at fixed strains: smooth functions of (a, b), one a cell, with two derivatives.

At one strain the posterior mean of a Gaussian process with a product kernel is a short sum over
the table's designs, ``m(a, b) = mean + sum_p W_p k((a, b), (a_p, b_p))``: the strain enters W
alone, which is computed once a cell. So a value with all derivatives costs 441 correlations for
the paper's table, whatever the number of load steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.design.coordinates import Coordinates, correlation, correlation_parts
from kiribench.errors import UsageError
from kiribench.surrogate.closed_form import GridState
from kiribench.surrogate.devices import torch_threads
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.keep import KeptModel
from kiribench.surrogate.kernel_form import TorchParameters, strain_correlation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CHUNK = 256  # points at a time: 0.9 MB an array for the paper's table, what a cache holds
FARTHEST = 200.0  # exp(-200) = 1e-87; numbers so small that they are denormal cost a hundredfold


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
        weights: (n, p) of the table's p designs, a row a cell.
        mean: constant that is added.
        coordinates: of the kernel.
        nodes: (p, C) the designs in these coordinates.
        family: of the kernel.
    """

    weights: FloatArray
    mean: float
    coordinates: Coordinates
    nodes: FloatArray
    family: str

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
        learnt = estimator.hyperparameters_
        coordinates = Coordinates.of(learnt)
        return cls(
            weights,
            learnt.target_mean,
            coordinates,
            coordinates.jet(designs)[0],
            estimator._state.form.design_family,
        )

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return len(self.weights)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        weights = self.weights if cells is None else self.weights[cells]
        values = np.empty((len(weights), len(a), len(b)))
        sides = self._along(0, a), self._along(1, b)
        rows = max(1, CHUNK // len(b))
        for start in range(0, len(a), rows):
            # The correlations with the table's designs are the same in every cell.
            part = slice(start, start + rows)
            k = sides[0][part, None, :] * sides[1][None, :, :]
            if len(self.coordinates.lengths) > 2:
                k *= self._across(a[part], b)
            values[:, part] = (weights @ k.reshape(-1, k.shape[2]).T).reshape(
                len(weights), -1, len(b)
            )
        return values + self.mean

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        return self._jets(points, cells, curved=True)

    def gradient(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """The same without the curvature (NaN), at half the cost."""
        return self._jets(points, cells, curved=False)

    def _jets(self, points: FloatArray, cells: IntArray | None, *, curved: bool) -> Jet:
        which = np.arange(len(points)) if cells is None else cells
        parts = []
        for start in range(0, max(len(points), 1), CHUNK):
            part = slice(start, start + CHUNK)
            parts.append(self._jet(points[part], self.weights[which[part]], curved=curved))
        if len(parts) == 1:
            return parts[0]
        return Jet(
            np.concatenate([part.value for part in parts]),
            np.concatenate([part.slope for part in parts]),
            np.concatenate([part.curvature for part in parts]),
        )

    def _along(self, column: int, x: FloatArray) -> FloatArray:
        """(k, p) correlations by one cut length alone."""
        points = np.zeros((len(x), 2))
        points[:, column] = x
        at = self.coordinates.jet(self.coordinates.scaled(points))[0][:, column]
        return self._correlation(np.subtract.outer(at, self.nodes[:, column]))

    def _across(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """(A, B, p) correlations by the angle."""
        points = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
        at = self.coordinates.jet(self.coordinates.scaled(points))[0][:, 2]
        k = self._correlation(np.subtract.outer(at, self.nodes[:, 2]))
        return k.reshape(len(a), len(b), -1)

    def _correlation(self, gap: FloatArray) -> FloatArray:
        exponent, factor = correlation(self.family, gap)
        return np.asarray(factor * np.exp(-np.minimum(exponent, FARTHEST)))

    def _jet(self, points: FloatArray, weights: FloatArray, *, curved: bool) -> Jet:
        at, first, second = self.coordinates.jet(self.coordinates.scaled(points))
        count = at.shape[1]
        gaps = [np.subtract.outer(at[:, c], self.nodes[:, c]) for c in range(count)]
        parts = [correlation_parts(self.family, gap, curved=curved) for gap in gaps]
        terms = weights.copy()
        exponent = np.zeros_like(weights)
        for part in parts:
            exponent += part.exponent
            terms *= part.factor
        np.minimum(exponent, FARTHEST, out=exponent)
        terms *= np.exp(-exponent)
        value = terms.sum(axis=1) + self.mean
        if not curved:
            slope = np.column_stack([np.vecdot(terms, part.slope) for part in parts])
            nothing = np.full((len(at), 2, 2), np.nan)
            return Jet(value, np.einsum("kc,kci->ki", slope, first), nothing)
        slope = np.empty((len(at), count))
        curvature = np.empty((len(at), count, count))
        for c in range(count):
            pulled = terms * parts[c].slope
            slope[:, c] = pulled.sum(axis=1)
            curvature[:, c, c] = np.vecdot(terms, parts[c].curvature)
            for d in range(c):
                curvature[:, c, d] = curvature[:, d, c] = np.vecdot(pulled, parts[d].slope)
        return Jet(
            value=value,
            slope=np.einsum("kc,kci->ki", slope, first),
            curvature=np.swapaxes(first, 1, 2) @ curvature @ first
            + np.einsum("kc,kcij->kij", slope, second),
        )


def _weights(estimator: ExactGP, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(p, 2) scaled designs, and (n, p) their weights in the mean at each strain."""
    learnt, state = estimator.hyperparameters_, estimator._state
    form = state.form
    at = torch.as_tensor((strain - learnt.input_low[2]) / learnt.input_span[2])[:, None]
    if isinstance(state, GridState):
        designs, strains = state.designs.cpu(), state.strains.cpu()
        parameters = TorchParameters.of(learnt.kernel_parameters(), designs)
        f, alpha = state.conditioned.factors, state.conditioned.alpha
        solved = (f.u @ alpha @ f.v.T).cpu()
        weights = strain_correlation(form, at, strains, parameters) @ solved.T
    else:
        inputs = state.inputs.cpu()
        parameters = TorchParameters.of(learnt.kernel_parameters(), inputs)
        by_strain = strain_correlation(form, at, inputs[:, 2:], parameters)
        designs, of_row = torch.unique(inputs[:, :2], dim=0, return_inverse=True)
        weights = torch.zeros((len(at), len(designs)), dtype=at.dtype)
        weights.index_add_(1, of_row, by_strain * state.conditioned.alpha.cpu())
    return designs.numpy(), (weights * learnt.target_scale).numpy()
