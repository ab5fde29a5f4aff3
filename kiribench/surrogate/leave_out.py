"""Leave folds out of a Gaussian process in closed form, hyperparameters kept.

Dubrule 1983 (doi:10.1007/BF01033030): with Q the inverse covariance of all rows,
``y_I - mu_I = Q_II^-1 (Q y)_I`` and the covariance of that residual is ``Q_II^-1``. It
equals refitting without the fold at the same hyperparameters, to rounding, and costs one
small factorisation a fold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from sklearn.utils.validation import check_is_fitted

from kiribench.errors import DataError, UsageError
from kiribench.surrogate import dense, kronecker, likelihood
from kiribench.surrogate.devices import torch_threads
from kiribench.surrogate.exact_gp import DenseState, ExactGP, GridState
from kiribench.surrogate.hyperparameters import Hyperparameters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FoldPrediction:
    """The rows of a fold, predicted from all other rows.

    Attributes:
        rows: (q,) row numbers of the training table.
        mean: (q,) unit of the targets.
        sd: (q,) standard deviation of an observation, noise included, unit of the targets.
    """

    rows: NDArray[np.int64]
    mean: FloatArray
    sd: FloatArray


def leave_folds_out(model: object, folds: Sequence[ArrayLike]) -> tuple[FoldPrediction, ...]:
    """Predict each fold from the other rows of the model's training table.

    Args:
        model: a fitted ``PaperGP``, ``KroneckerGP`` or ``SparseVariationalGP``.
        folds: row numbers of each fold; folds may overlap and need not cover the table.

    Raises:
        DataError: the rows were resampled to a strain grid and a fold cuts through a
            design's curve: its other rows have helped to make the grid's values.
        UsageError: the model is no Gaussian process, or a fold is not a set of row numbers.
    """
    from kiribench.surrogate.svgp import SparseVariationalGP

    if not isinstance(model, (ExactGP, SparseVariationalGP)):
        raise UsageError(
            "leave-out-no-gp",
            "The closed form exists for Gaussian processes only.",
            remedy="Refit the model for each fold.",
            got=type(model).__name__,
        )
    check_is_fitted(model, "hyperparameters_")
    with torch_threads(model.threads):
        if isinstance(model, SparseVariationalGP):
            return _from_sparse(model, folds)
        state = model._state
        if isinstance(state, DenseState):
            return _from_dense(model.hyperparameters_, state, folds)
        return _from_grid(model, state, folds)


def _from_dense(
    learnt: Hyperparameters, state: DenseState, folds: Sequence[ArrayLike]
) -> tuple[FoldPrediction, ...]:
    at = state.conditioned
    inverse = torch.cholesky_inverse(at.root)
    results = []
    for fold in folds:
        rows = _row_numbers(fold, len(at.values))
        mean, variance = dense.leave_rows_out(
            at, inverse, torch.as_tensor(rows, device=inverse.device)
        )
        results.append(_result(learnt, rows, mean, variance))
    return tuple(results)


def _from_sparse(model: object, folds: Sequence[ArrayLike]) -> tuple[FoldPrediction, ...]:
    from kiribench.surrogate import svgp

    if not isinstance(model, svgp.SparseVariationalGP):
        raise TypeError("a sparse model is needed")
    learnt, state = model.hyperparameters_, model._state
    results = []
    for fold in folds:
        rows = _row_numbers(fold, len(model._rows))
        place = state.inducing.device
        inputs = torch.as_tensor(learnt.scale_inputs(model._rows[rows]), device=place)
        values = torch.as_tensor(learnt.scale_targets(model._values[rows]), device=place)
        mean, variance = svgp.leave_rows_out(learnt, state, inputs, values)
        results.append(_result(learnt, rows, mean, variance))
    return tuple(results)


def _from_grid(
    model: ExactGP, state: GridState, folds: Sequence[ArrayLike]
) -> tuple[FoldPrediction, ...]:
    grid, at, learnt = state.grid, state.conditioned, model.hyperparameters_
    form = model._kernel_form(len(learnt.input_low))
    place = state.designs.device
    theta = likelihood.TorchParameters.of(learnt.kernel_parameters(), state.designs)
    rows_of_design = np.bincount(grid.row_design, minlength=len(grid.designs))
    strain_scaled = (grid.row_strain - learnt.input_low[-1]) / learnt.input_span[-1]
    results = []
    for fold in folds:
        rows = _row_numbers(fold, len(grid.row_design))
        designs, row_design = np.unique(grid.row_design[rows], return_inverse=True)
        whole = np.bincount(row_design.ravel()) == rows_of_design[designs]
        if grid.resampled and not whole.all():
            raise DataError(
                "leave-out-cuts-resampled-curve",
                "The table was resampled to a common strain grid, and the fold holds a part "
                "of a design's curve only.",
                remedy="Refit for such folds, or leave out whole designs.",
            )
        if not whole.all():
            entries = grid.row_design[rows] * len(grid.curve) + grid.row_curve[rows]
            mean, variance = kronecker.leave_entries_out(at, torch.as_tensor(entries, device=place))
            results.append(_result(learnt, rows, mean, variance))
            continue
        left = torch.as_tensor(designs, device=place)
        strains = torch.as_tensor(strain_scaled[rows][:, None], device=place)
        mean, variance = kronecker.leave_designs_out(
            at,
            left,
            torch.as_tensor(row_design.ravel(), device=place),
            likelihood.design_correlation(form, state.designs[left], state.designs, theta),
            likelihood.strain_correlation(form, strains, state.strains, theta),
        )
        results.append(_result(learnt, rows, mean, variance))
    return tuple(results)


def _row_numbers(fold: ArrayLike, count: int) -> NDArray[np.int64]:
    rows = np.asarray(fold)
    wrong = (
        rows.ndim != 1
        or len(rows) == 0
        or not np.issubdtype(rows.dtype, np.integer)
        or rows.min() < 0
        or rows.max() >= count
        or len(np.unique(rows)) < len(rows)
    )
    if wrong or len(rows) >= count:
        raise UsageError(
            "leave-out-bad-fold",
            "A fold is not a set of row numbers of the training table.",
            remedy="Give each fold as distinct integers, at least one and not all rows.",
            expected=f"integers from 0 to {count - 1}",
        )
    return rows.astype(np.int64)


def _result(
    learnt: Hyperparameters,
    rows: NDArray[np.int64],
    mean: torch.Tensor,
    variance: torch.Tensor,
) -> FoldPrediction:
    noisy = variance.cpu().numpy() + learnt.signal_variance * learnt.noise_ratio
    return FoldPrediction(
        rows,
        np.asarray(mean.cpu().numpy() * learnt.target_scale + learnt.target_mean),
        np.asarray(np.sqrt(noisy) * learnt.target_scale),
    )
