"""A fitted estimator as plain arrays, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.surrogate.closed_form import DenseState, GridState
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.grid import DesignGrid
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.kept_file import Arrays
from kiribench.surrogate.registry import Regressor
from kiribench.surrogate.svgp import SparseVariationalGP

FloatArray = NDArray[np.float64]


def state_of(estimator: Regressor, X: FloatArray, y: FloatArray) -> Arrays:
    """What must be kept of an estimator that was fitted to (n, d) rows, sorted by design.

    A grid: designs, strains, values (88 kB for 441 x 25 in float64; nothing is rounded, so
    a loaded model predicts to rounding what the fitted one did). A sparse GP: inducing
    points and the triangle of its posterior. Anything else: the rows, each design once.
    """
    if isinstance(estimator, ExactGP) and isinstance(estimator._state, GridState):
        grid = estimator._state.grid
        arrays: Arrays = {
            "designs": grid.designs,
            "strains": grid.curve,
            "values": grid.values,
        }
        if len(grid.missing):
            arrays["observed"] = np.packbits(grid.observed)
        return arrays
    if isinstance(estimator, SparseVariationalGP):
        state = estimator._state
        triangle = torch.tril_indices(len(state.inducing), len(state.inducing))
        packed = state.precision.cpu()[triangle[0], triangle[1]].numpy()
        return {
            "inducing": state.inducing.cpu().numpy(),
            "precision": packed,
            "weighted": state.weighted.cpu().numpy(),
        }
    if isinstance(estimator, ExactGP) and isinstance(estimator._state, DenseState):
        X, y = X[estimator._state.kept], y[estimator._state.kept]
    starts = np.flatnonzero(
        np.concatenate(([True], (np.diff(X[:, :-1], axis=0) != 0.0).any(axis=1)))
    )
    return {
        "designs": X[starts, :-1],
        "counts": np.diff(np.append(starts, len(X))).astype(np.int32),
        "strains": X[:, -1],
        "targets": y,
    }


def with_state(estimator: Regressor, record: dict[str, Any], arrays: Arrays) -> Regressor:
    """The estimator as it was: conditioned anew, or fitted anew to the kept rows."""
    summary = record["summary"]
    learnt = (
        Hyperparameters.from_dict(summary["hyperparameters"])
        if "hyperparameters" in summary
        else None
    )
    if isinstance(estimator, SparseVariationalGP) and learnt is not None:
        return estimator.restore(learnt, arrays["inducing"], _square(arrays), arrays["weighted"])
    if isinstance(estimator, ExactGP) and learnt is not None:
        if "values" in arrays:
            grid = _grid(arrays, resampled=summary["structure"] == "resampled")
            return estimator.restore(learnt, grid, float(summary["resampling_rms"]))
        X, y = _rows(arrays)
        return estimator.restore_rows(learnt, X, y)
    X, y = _rows(arrays)
    return estimator.fit(X, y)


def _rows(arrays: Arrays) -> tuple[FloatArray, FloatArray]:
    designs = np.repeat(arrays["designs"], arrays["counts"], axis=0)
    return np.column_stack([designs, arrays["strains"]]), arrays["targets"]


def _square(arrays: Arrays) -> FloatArray:
    m = len(arrays["inducing"])
    square = np.zeros((m, m))
    square[np.tril_indices(m)] = arrays["precision"]
    return square + np.tril(square, -1).T


def _grid(arrays: Arrays, *, resampled: bool) -> DesignGrid:
    values = arrays["values"]
    p, m = values.shape
    observed = np.ones((p, m), dtype=bool)
    if "observed" in arrays:
        observed = np.unpackbits(arrays["observed"], count=p * m).astype(bool).reshape(p, m)
    design, strain = np.nonzero(observed)
    return DesignGrid(
        designs=arrays["designs"],
        curve=arrays["strains"],
        values=values,
        observed=observed,
        row_design=design.astype(np.int64),
        row_strain=arrays["strains"][strain],
        row_curve=strain.astype(np.int64),
        resampled=resampled,
        resampling_rms=0.0,
    )
