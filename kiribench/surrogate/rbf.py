"""Radial basis function interpolation, scipy's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.errors import NotConvergedError

FloatArray = NDArray[np.float64]


class RadialBasis(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """:class:`scipy.interpolate.RBFInterpolator` on inputs scaled to their range.

    The polynomial that the kernel wants is singular among rows of which all share a column's
    value: an input of two values, say, among near neighbours. Then all rows take part where
    they are no more than ``max_rows``, and else (or where that is singular as well) the linear
    kernel with a constant, which needs no slopes. ``solved_by_`` says which it was.

    Args:
        kernel: one of scipy's that needs no length scale.
        neighbors: nearest rows that take part in a prediction.
        smoothing: 0 interpolates.
        degree: of the added polynomial; scipy's default for the kernel where ``None``.
        max_rows: most rows that take part at once.
    """

    def __init__(
        self,
        *,
        kernel: str = "cubic",
        neighbors: int = 100,
        smoothing: float = 1e-8,
        degree: int | None = None,
        max_rows: int = 3000,
    ) -> None:
        self.kernel = kernel
        self.neighbors = neighbors
        self.smoothing = smoothing
        self.degree = degree
        self.max_rows = max_rows

    def fit(self, X: ArrayLike, y: ArrayLike) -> RadialBasis:
        """Keep (n, d) rows and (n,) targets; equal rows become one with their mean."""
        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True)
        self.input_low_ = X_.min(axis=0)
        span = np.ptp(X_, axis=0)
        # A constant input carries no information, and would make the polynomial singular.
        self._varying = span > 0.0
        self.input_span_ = np.where(self._varying, span, 1.0)
        rows, same = np.unique(self._scaled(X_), axis=0, return_inverse=True)
        counts = np.bincount(same.ravel())
        self.target_mean_ = float(y_.mean())
        means = np.bincount(same.ravel(), y_ - self.target_mean_) / counts
        self._rows, self._values = rows, means
        self.solved_by_ = "neighbours"
        self._interpolator = self._build(rows, means, self.kernel, self.neighbors, self.degree)
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """The interpolant at (t, d) points."""
        check_is_fitted(self, "input_span_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        points = self._scaled(X_)
        if self._interpolator is None:
            _, nearest = KDTree(self._rows).query(points) if self._rows.shape[1] else (0, 0)
            values = self._values[np.broadcast_to(nearest, len(points))]
        else:
            values = self._interpolated(points)
        return np.asarray(values + self.target_mean_, dtype=np.float64)

    def _scaled(self, X: FloatArray) -> FloatArray:
        return np.asarray(((X - self.input_low_) / self.input_span_)[:, self._varying])

    def _interpolated(self, points: FloatArray) -> FloatArray:
        rows, targets = self._rows, self._values
        few = len(rows) <= self.max_rows
        attempts: list[tuple[str, str, int, int | None]] = [
            ("neighbours", self.kernel, self.neighbors, self.degree)
        ]
        if few:
            attempts.append(("all rows", self.kernel, len(rows), self.degree))
        attempts.append(("linear kernel", "linear", len(rows) if few else self.neighbors, 0))
        tried = [name for name, *_ in attempts].index(self.solved_by_)
        for name, kernel, near, degree in attempts[tried:]:
            try:
                if name != self.solved_by_:
                    self._interpolator = self._build(rows, targets, kernel, near, degree)
                    self.solved_by_ = name
                return np.asarray(self._interpolator(points), dtype=np.float64)
            except np.linalg.LinAlgError:
                continue
        raise NotConvergedError(
            "rbf-singular",
            "The interpolation equations are singular.",
            remedy="Raise smoothing, or leave out columns that hardly vary.",
        )

    def _build(
        self, rows: FloatArray, values: FloatArray, kernel: str, near: int, degree: int | None
    ) -> Any:
        inputs = rows.shape[1]
        # scipy needs as many rows as the polynomial has terms.
        if inputs == 0 or len(rows) < inputs + 1:
            return None
        settings: dict[str, Any] = {
            "kernel": kernel,
            "neighbors": near if near < len(rows) else None,
            "smoothing": self.smoothing,
            "degree": degree,
        }
        return RBFInterpolator(rows, values, **settings)
