"""What of a Gaussian process depends on the cut lengths alone: made once, used for every strain.

At a strain e the posterior mean is ``mean + sum_t k(e, e_t) sum_p C_tp k((a, b), (a_p, b_p))``
over the table's strains e_t and designs p. C and the inner sums on a grid of cut lengths are the
same for every cell, target and patch, so they are kept as long as the process is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.design.coordinates import Coordinates
from kiribench.design.correlations import CHUNK, COORDINATES, correlations, weighted_jets
from kiribench.surrogate.closed_form import DenseState, GridState
from kiribench.surrogate.devices import torch_threads
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.kernel_form import (
    TorchParameters,
    design_correlation,
    strain_correlation,
)
from kiribench.surrogate.strain_path import along

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

KEPT_POINTS = 4096
"""Grids up to this size are kept: 0.8 MB for the paper's table."""
KEPT_GRIDS = 4
INTERPOLATION_JITTER = 1e-10
"""Of the kernel's variance; rounding leaves eigenvalues of about -1e-14."""


@dataclass(frozen=True, eq=False)
class DesignPart:
    """The part of a posterior mean that depends on a and b.

    Attributes:
        mean: constant that is added.
        coordinates: of the kernel.
        nodes: (3, p) the table's designs in these coordinates; rows beyond theirs are 0.
        family: of the kernel.
        by_strain: (t, p) C, where t strains are common to all designs; else None, and the
            weights of a strain are already those of the p designs.
        weights_at: (n,) strains in the model's measure to (n, t) or (n, p) weights.
    """

    mean: float
    coordinates: Coordinates
    nodes: FloatArray
    family: str
    by_strain: FloatArray | None
    weights_at: Callable[[FloatArray], FloatArray]
    _grids: dict[tuple[bytes, bytes], FloatArray] = field(default_factory=dict)

    def on_grid(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """(t, A B) or (p, A B) sums on the product of two axes, a row a weight."""
        key = a.tobytes(), b.tobytes()
        if key in self._grids:
            return self._grids[key]
        rows = len(self.by_strain) if self.by_strain is not None else self.nodes.shape[1]
        values = np.empty((rows, len(a) * len(b)))
        at = self._at(np.column_stack([np.repeat(a, len(b)), np.tile(b, len(a))]))[0]
        for start in range(0, len(at), CHUNK):
            part = slice(start, start + CHUNK)
            k = correlations(self.family, at[part], self.nodes).T
            values[:, part] = k if self.by_strain is None else self.by_strain @ k
        if values.shape[1] <= KEPT_POINTS:
            while len(self._grids) >= KEPT_GRIDS:
                self._grids.pop(next(iter(self._grids)))
            self._grids[key] = values
        return values

    def jets(
        self, points: FloatArray, weights: FloatArray, cells: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value (k,), slope (k, 2) and curvature (k, 2, 2) at (k, 2) points, by fractions.

        Args:
            points: a and b, fractions.
            weights: (n, p).
            cells: (k,) which row of the weights each point takes.
        """
        at, first, second = self._at(points)
        sums = weighted_jets(self.family, at, self.nodes, weights, cells)
        slope, count = sums[:, 1:4], first.shape[1]
        bend = sums[:, [[4, 7, 8], [7, 5, 9], [8, 9, 6]]][:, :count, :count]
        slope = slope[:, None, :count]
        return (
            sums[:, 0] + self.mean,
            (slope @ first)[:, 0],
            np.swapaxes(first, 1, 2) @ bend @ first
            + (slope @ second.reshape(-1, count, 4)).reshape(-1, 2, 2),
        )

    def _at(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(k, 3) coordinates of fractions, and their derivatives."""
        value, first, second = self.coordinates.jet(self.coordinates.scaled(points))
        return with_three(value), first, second


def with_three(coordinates: FloatArray) -> FloatArray:
    """(k, 3) coordinates from two or three: what is absent is 0, at the same place for all."""
    at = np.zeros((len(coordinates), COORDINATES))
    at[:, : coordinates.shape[1]] = coordinates
    return at


_PARTS: WeakKeyDictionary[GridState | DenseState, DesignPart] = WeakKeyDictionary()


def design_part(estimator: ExactGP) -> DesignPart:
    """The design part of a fitted process over (a, b, strain); made once for each fit."""
    state = estimator._state
    if state not in _PARTS:
        _PARTS[state] = _of_grid(state) if isinstance(state, GridState) else _of_rows(state)
    return _PARTS[state]


def _of_grid(state: GridState) -> DesignPart:
    learnt, form = state.learnt, state.form
    designs, strains = state.designs.cpu(), state.strains.cpu()
    parameters = TorchParameters.of(learnt.kernel_parameters(), designs)
    with torch_threads(1):
        f, alpha = state.conditioned.factors, state.conditioned.alpha
        solved = ((f.u @ alpha) @ f.v.T).cpu().numpy().T * learnt.target_scale

    def weights(strain: FloatArray) -> FloatArray:
        at = torch.as_tensor((strain - learnt.input_low[2]) / learnt.input_span[2])[:, None]
        with torch_threads(1):
            return np.asarray(strain_correlation(form, at, strains, parameters).numpy())

    coordinates = Coordinates.of(learnt)
    nodes = _nodes(coordinates, designs.numpy())
    weights_at = _through_designs(state, solved) if learnt.path else weights
    return DesignPart(
        learnt.target_mean,
        coordinates,
        nodes,
        form.design_family,
        None if learnt.path else np.ascontiguousarray(solved),
        weights_at,
    )


def _through_designs(state: GridState, solved: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Weights of the mean at a strain where the process is one of strains along paths.

    At one strain such a mean is no sum over the designs' kernels alone: how far along its path a
    design is changes with a and b as well. It is interpolated through its own values at the
    table's designs with the process's own kernel.
    """
    learnt, form = state.learnt, state.form
    designs, strains = state.designs.cpu(), state.strains.cpu()
    parameters = TorchParameters.of(learnt.kernel_parameters(), designs)
    with torch_threads(1):
        k = design_correlation(form, designs, designs, parameters)
        at_designs = torch.as_tensor(solved) @ k  # (t, p)
        k.diagonal().add_(INTERPOLATION_JITTER)
        root = torch.linalg.cholesky(k)

    def weights(strain: FloatArray) -> FloatArray:
        values = torch.empty((len(strain), len(designs)), dtype=designs.dtype)
        with torch_threads(1):
            for row, one in enumerate(strain):
                here = along(learnt.path, designs.numpy(), np.full(len(designs), one))
                scaled = (here - learnt.input_low[2]) / learnt.input_span[2]
                by_strain = strain_correlation(
                    form, torch.as_tensor(scaled)[:, None], strains, parameters
                )
                values[row] = (by_strain * at_designs.T).sum(1)
            return np.ascontiguousarray(torch.cholesky_solve(values.T, root).T.numpy())

    return weights


def _of_rows(state: DenseState) -> DesignPart:
    learnt, form = state.learnt, state.form
    inputs, alpha = state.inputs.cpu(), state.conditioned.alpha.cpu()
    parameters = TorchParameters.of(learnt.kernel_parameters(), inputs)
    designs, of_row = torch.unique(inputs[:, :2], dim=0, return_inverse=True)

    def weights(strain: FloatArray) -> FloatArray:
        at = torch.as_tensor((strain - learnt.input_low[2]) / learnt.input_span[2])[:, None]
        with torch_threads(1):
            by_row = strain_correlation(form, at, inputs[:, 2:], parameters) * alpha
            of_design = torch.zeros((len(at), len(designs)), dtype=at.dtype)
            of_design.index_add_(1, of_row, by_row)
            return np.asarray((of_design * learnt.target_scale).numpy())

    coordinates = Coordinates.of(learnt)
    return DesignPart(
        learnt.target_mean,
        coordinates,
        _nodes(coordinates, designs.numpy()),
        form.design_family,
        None,
        weights,
    )


def _nodes(coordinates: Coordinates, designs: FloatArray) -> FloatArray:
    return np.ascontiguousarray(with_three(coordinates.jet(designs)[0]).T)
