"""Exact Gaussian processes ready to predict, and folds left out of them in closed form.

Dubrule 1983 (doi:10.1007/BF01033030): with Q the inverse covariance of all rows,
``y_I - mu_I = Q_II^-1 (Q y)_I`` and the covariance of that residual is ``Q_II^-1``. It
equals refitting without the fold at the same hyperparameters, to rounding, and costs one
small factorisation a fold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.errors import DataError
from kiribench.surrogate import dense, kronecker
from kiribench.surrogate.grid import DesignGrid
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.kernel_form import (
    KernelForm,
    TorchParameters,
    design_correlation,
    full_correlation,
    strain_correlation,
)

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class GridState:
    """A process on a grid, ready to predict: scaled tensors and the conditioned process."""

    form: KernelForm
    learnt: Hyperparameters
    grid: DesignGrid
    designs: Tensor
    strains: Tensor
    conditioned: kronecker.Conditioned


@dataclass(frozen=True, eq=False)
class DenseState:
    """A process on scattered rows, ready to predict.

    Attributes:
        inputs: (k, d) scaled, of the rows that it is conditioned on.
        every: (n, d) scaled, of all rows of the training table.
        kept: (k,) which of all rows these are.
    """

    form: KernelForm
    learnt: Hyperparameters
    inputs: Tensor
    conditioned: dense.DenseConditioned
    every: Tensor
    kept: IntArray


@dataclass(frozen=True, eq=False)
class FoldPrediction:
    """The rows of a fold, predicted from all other rows.

    Attributes:
        rows: (q,) row numbers of the training table.
        mean: (q,) unit of the targets.
        sd: (q,) standard deviation of an observation, noise included, unit of the targets.
    """

    rows: IntArray
    mean: FloatArray
    sd: FloatArray

    @classmethod
    def of(
        cls, learnt: Hyperparameters, rows: IntArray, mean: Tensor, variance: Tensor
    ) -> FoldPrediction:
        """From scaled means and noise-free variances."""
        return cls(
            rows,
            np.asarray(mean.cpu().numpy() * learnt.target_scale + learnt.target_mean),
            learnt.observation_sd(variance.cpu().numpy()),
        )


def folds_left_out(
    state: GridState | DenseState, folds: Sequence[IntArray]
) -> Iterator[FoldPrediction]:
    """Each fold predicted from the other rows, hyperparameters kept.

    Args:
        state: conditioned on all rows.
        folds: row numbers, checked.

    Raises:
        DataError: the rows were resampled and a fold cuts through a design's curve.
    """
    if isinstance(state, DenseState):
        return _from_dense(state, folds)
    return _from_grid(state, folds)


def _from_dense(state: DenseState, folds: Sequence[IntArray]) -> Iterator[FoldPrediction]:
    at, learnt = state.conditioned, state.learnt
    inverse = torch.cholesky_inverse(at.root)
    theta = TorchParameters.of(learnt.kernel_parameters(), state.inputs)
    place = np.full(len(state.every), -1)
    place[state.kept] = np.arange(len(state.kept))
    for rows in folds:
        if len(state.kept) < len(state.every):
            _refuse_cut_curves(state.every, rows)
        fold = torch.as_tensor(place[rows][place[rows] >= 0], device=inverse.device)
        points = state.every[torch.as_tensor(rows, device=inverse.device)]
        cross = full_correlation(state.form, points, state.inputs, theta)
        mean, variance = dense.leave_rows_out(at, inverse, fold, cross)
        yield FoldPrediction.of(learnt, rows, mean, variance)


def _refuse_cut_curves(every: Tensor, rows: IntArray) -> None:
    _, design = torch.unique(every[:, :-1], dim=0, return_inverse=True)
    left = torch.zeros(len(every), dtype=torch.bool)
    left[torch.as_tensor(rows)] = True
    touched = torch.isin(design.cpu(), design.cpu()[left])
    if int(touched.sum()) > len(rows):
        raise _cut_curve("thinned")


def _cut_curve(how: str) -> DataError:
    return DataError(
        "leave-out-cuts-resampled-curve",
        f"The table's curves were {how}, and the fold holds a part of a design's curve only.",
        remedy="Refit for such folds, or leave out whole designs.",
    )


def _from_grid(state: GridState, folds: Sequence[IntArray]) -> Iterator[FoldPrediction]:
    grid, at, learnt, form = state.grid, state.conditioned, state.learnt, state.form
    place = state.designs.device
    theta = TorchParameters.of(learnt.kernel_parameters(), state.designs)
    rows_of_design = np.bincount(grid.row_design, minlength=len(grid.designs))
    strain_scaled = (grid.row_strain - learnt.input_low[-1]) / learnt.input_span[-1]
    for rows in folds:
        designs, row_design = np.unique(grid.row_design[rows], return_inverse=True)
        whole = np.bincount(row_design.ravel()) == rows_of_design[designs]
        if grid.resampled and not whole.all():
            raise _cut_curve("resampled to a common strain grid")
        left = torch.as_tensor(designs, device=place)
        position = torch.as_tensor(row_design.ravel(), device=place)
        strains = torch.as_tensor(strain_scaled[rows][:, None], device=place)
        by_design = design_correlation(form, state.designs[left], state.designs, theta)
        by_strain = strain_correlation(form, strains, state.strains, theta)
        if whole.all():
            mean, variance = kronecker.leave_designs_out(at, left, position, by_design, by_strain)
        else:
            entries = grid.row_design[rows] * len(grid.curve) + grid.row_curve[rows]
            hidden = torch.as_tensor(entries, device=place)
            mean, variance = kronecker.leave_entries_out(at, hidden, by_design, by_strain, position)
        yield FoldPrediction.of(learnt, rows, mean, variance)
