"""Another library's regressor behind this package's checks of the input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

FloatArray = NDArray[np.float64]


class Wrapped(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Fits what ``_build`` gives; the library's regressor is ``inner_`` afterwards."""

    def _build(self, rows: int) -> Any:
        raise NotImplementedError

    def fit(self, X: ArrayLike, y: ArrayLike) -> Wrapped:
        """Fit on (n, d) rows and (n,) targets; at least two rows."""
        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        self.inner_ = self._build(len(X_)).fit(X_, y_)
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """The regressor at (t, d) points."""
        check_is_fitted(self, "inner_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(self.inner_.predict(X_), dtype=np.float64)
