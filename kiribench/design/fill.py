"""Cuts for cells without a target: as smooth as their neighbours allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

FloatArray = NDArray[np.float64]


def filled_from_neighbours(values: FloatArray) -> FloatArray:
    """(R, C) with every NaN the mean of its neighbours, the filled ones among them.

    A discrete harmonic function: it stays within the range of the known values, so limits that
    hold for them hold for the filled ones too.

    >>> filled_from_neighbours(np.array([[0.0, np.nan, 1.0]]))
    array([[0. , 0.5, 1. ]])
    """
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values.copy()
    rows, columns = values.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    pairs = np.concatenate(
        [
            np.column_stack([index[:-1].ravel(), index[1:].ravel()]),
            np.column_stack([index[:, :-1].ravel(), index[:, 1:].ravel()]),
        ]
    )
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    count = rows * columns
    weights = coo_array((np.ones(len(one)), (one, two)), shape=(count, count)).tocsr()
    degree = np.asarray(weights.sum(axis=1)).ravel()
    open_ = np.flatnonzero(~known.ravel())
    flat = np.where(known, values, 0.0).ravel()
    matrix = -weights[open_][:, open_].tolil()
    matrix.setdiag(degree[open_])
    right = weights[open_] @ flat
    result = flat.copy()
    result[open_] = np.atleast_1d(spsolve(matrix.tocsc(), right))
    # Rounding must not leave the range.
    low, high = values[known].min(), values[known].max()
    return np.asarray(np.clip(result, low, high).reshape(rows, columns))
