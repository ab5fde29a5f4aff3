"""Leave folds out of a Gaussian process in closed form, hyperparameters kept.

See :mod:`kiribench.surrogate.closed_form` for the identity (Dubrule 1983).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from sklearn.utils.validation import check_is_fitted

from kiribench.errors import UsageError
from kiribench.surrogate import sparse_bound
from kiribench.surrogate.closed_form import FoldPrediction, folds_left_out
from kiribench.surrogate.devices import torch_threads
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.svgp import SparseVariationalGP

__all__ = ["FoldPrediction", "leave_folds_out"]

IntArray = NDArray[np.int64]


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
            return tuple(_from_sparse(model, folds))
        checked = [_row_numbers(fold, model.rows_) for fold in folds]
        return tuple(folds_left_out(model._state, checked))


def _from_sparse(
    model: SparseVariationalGP, folds: Sequence[ArrayLike]
) -> Iterator[FoldPrediction]:
    learnt, state = model.hyperparameters_, model._state
    for fold in folds:
        rows = _row_numbers(fold, len(model._rows))
        place = state.inducing.device
        inputs = torch.as_tensor(learnt.scale_inputs(model._rows[rows]), device=place)
        values = torch.as_tensor(learnt.scale_targets(model._values[rows]), device=place)
        mean, variance = sparse_bound.leave_rows_out(learnt, state, inputs, values)
        yield FoldPrediction.of(learnt, rows, mean, variance)


def _row_numbers(fold: ArrayLike, count: int) -> IntArray:
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
