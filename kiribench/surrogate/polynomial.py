"""The paper's cubic polynomial: least squares on all monomials up to degree 3."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.preprocessing import PolynomialFeatures
from sklearn.utils.validation import check_is_fitted, validate_data

FloatArray = NDArray[np.float64]


class Polynomial(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Ordinary least squares on all monomials of the inputs up to ``degree``.

    Inputs are mapped to [-1, 1] first: the same polynomial, solved without cancellation.

    Args:
        degree: 3 in the paper.
    """

    def __init__(self, *, degree: int = 3) -> None:
        self.degree = degree

    def fit(self, X: ArrayLike, y: ArrayLike) -> Polynomial:
        """Least squares on (n, d) rows and (n,) targets."""
        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True)
        self.input_middle_ = 0.5 * (X_.max(axis=0) + X_.min(axis=0))
        half = 0.5 * np.ptp(X_, axis=0)
        self.input_half_span_ = np.where(half > 0.0, half, 1.0)
        self._features = PolynomialFeatures(self.degree).fit(X_)
        solution, _, self.rank_, _ = np.linalg.lstsq(self._design(X_), y_, rcond=None)
        self.coefficients_: FloatArray = solution
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """The polynomial at (t, d) points."""
        check_is_fitted(self, "coefficients_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(self._design(X_) @ self.coefficients_)

    def _design(self, X: FloatArray) -> FloatArray:
        scaled = (X - self.input_middle_) / self.input_half_span_
        return np.asarray(self._features.transform(scaled))
