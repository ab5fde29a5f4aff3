"""Histogram gradient boosting, scikit-learn's."""

from __future__ import annotations

from sklearn.ensemble import HistGradientBoostingRegressor

from kiribench.surrogate.wrapped import Wrapped


class HistGradientBoosting(Wrapped):
    """scikit-learn's histogram gradient boosting, without early stopping on random rows.

    scikit-learn stops early by a random split of the rows, which leaks between rows of one
    design and stops too late; a fixed number of trees does not. The parameters are
    :class:`sklearn.ensemble.HistGradientBoostingRegressor`'s.
    """

    def __init__(
        self,
        *,
        max_iter: int = 300,
        learning_rate: float = 0.1,
        max_leaf_nodes: int | None = 31,
        min_samples_leaf: int = 10,
        l2_regularization: float = 0.0,
        early_stopping: bool = False,
        random_state: int | None = 0,
    ) -> None:
        self.max_iter = max_iter
        self.learning_rate = learning_rate
        self.max_leaf_nodes = max_leaf_nodes
        self.min_samples_leaf = min_samples_leaf
        self.l2_regularization = l2_regularization
        self.early_stopping = early_stopping
        self.random_state = random_state

    def _build(self, rows: int) -> HistGradientBoostingRegressor:
        return HistGradientBoostingRegressor(**self.get_params())

    @property
    def n_iter_(self) -> int:
        """Number of trees that were grown."""
        return int(self.inner_.n_iter_)
