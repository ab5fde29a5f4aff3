"""Histogram gradient boosting, scikit-learn's."""

from __future__ import annotations

from sklearn.ensemble import HistGradientBoostingRegressor


class HistGradientBoosting(HistGradientBoostingRegressor):  # type: ignore[misc]
    """scikit-learn's histogram gradient boosting, without early stopping on random rows.

    scikit-learn stops early by a random split of the rows, which leaks between rows of one
    design and stops too late; a fixed number of trees does not. The other parameters are
    :class:`sklearn.ensemble.HistGradientBoostingRegressor`'s.
    """

    def __init__(
        self,
        *,
        max_iter: int = 400,
        learning_rate: float = 0.1,
        max_leaf_nodes: int | None = 31,
        min_samples_leaf: int = 10,
        l2_regularization: float = 0.0,
        early_stopping: bool = False,
        random_state: int | None = 0,
    ) -> None:
        super().__init__(
            max_iter=max_iter,
            learning_rate=learning_rate,
            max_leaf_nodes=max_leaf_nodes,
            min_samples_leaf=min_samples_leaf,
            l2_regularization=l2_regularization,
            early_stopping=early_stopping,
            random_state=random_state,
        )
