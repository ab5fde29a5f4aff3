"""LightGBM's gradient boosting, an optional extra."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

FloatArray = NDArray[np.float64]


class LightGBM(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """LightGBM's regressor behind scikit-learn's own checks of the input, deterministic.

    Args:
        n_estimators: trees.
        learning_rate: shrinkage of each tree.
        num_leaves: leaves of a tree.
        min_child_samples: least rows of a leaf.
        n_jobs: threads.
        random_state: seed.
    """

    def __init__(
        self,
        *,
        n_estimators: int = 400,
        learning_rate: float = 0.1,
        num_leaves: int = 31,
        min_child_samples: int = 10,
        n_jobs: int = 1,
        random_state: int | None = 0,
    ) -> None:
        self.n_estimators = n_estimators
        self.learning_rate = learning_rate
        self.num_leaves = num_leaves
        self.min_child_samples = min_child_samples
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> LightGBM:
        """Boost on (n, d) rows and (n,) targets."""
        import lightgbm

        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        data = lightgbm.Dataset(X_, y_, params={"verbosity": -1}, free_raw_data=True)
        seed = 0 if self.random_state is None else self.random_state
        self.booster_ = lightgbm.train(
            {
                "objective": "regression",
                "learning_rate": self.learning_rate,
                "num_leaves": self.num_leaves,
                # A leaf must be able to hold less than the rows of a tiny table.
                "min_data_in_leaf": min(self.min_child_samples, max(1, len(X_) // 5)),
                "deterministic": True,
                "force_row_wise": True,
                "num_threads": self.n_jobs,
                "seed": seed,
                "verbosity": -1,
            },
            data,
            num_boost_round=self.n_estimators,
        )
        return self

    def predict(self, X: ArrayLike) -> FloatArray:
        """The boosted trees at (t, d) points."""
        check_is_fitted(self, "booster_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(self.booster_.predict(X_, num_threads=self.n_jobs), dtype=np.float64)
