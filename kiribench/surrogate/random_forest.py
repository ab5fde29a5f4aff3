"""Random forest (the paper's RF), scikit-learn's."""

from __future__ import annotations

from sklearn.ensemble import RandomForestRegressor

# The paper gives no settings, and no common default comes down to table 1's R2 = .5120:
# two levels of a tree do. A guess, shown as one.
PAPER_GUESS = {"max_depth": 2, "n_estimators": 100}


class RandomForest(RandomForestRegressor):  # type: ignore[misc]
    """scikit-learn's random forest, fully grown, all inputs tried at every split.

    The other parameters are :class:`sklearn.ensemble.RandomForestRegressor`'s.
    """

    def __init__(
        self,
        *,
        n_estimators: int = 100,
        max_depth: int | None = None,
        min_samples_leaf: int = 1,
        max_features: float = 1.0,
        n_jobs: int | None = None,
        random_state: int | None = 0,
    ) -> None:
        super().__init__(
            n_estimators=n_estimators,
            max_depth=max_depth,
            min_samples_leaf=min_samples_leaf,
            max_features=max_features,
            n_jobs=n_jobs,
            random_state=random_state,
        )
