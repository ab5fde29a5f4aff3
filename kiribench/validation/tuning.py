"""Nested tuning: settings chosen inside the training rows, by folds of whole groups.

What is tuned on the rows that it is scored on is flattered. Here the choice is a part of the
fit: inner folds divide the training groups alone, the test rows of the outer fold are never
seen, and each outer fold may choose differently (Varma & Simon 2006,
doi:10.1186/1471-2105-7-91).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import UsageError
from kiribench.surrogate.registry import Regressor, make
from kiribench.validation.point_scores import rmse
from kiribench.validation.protocols.grouped import deal

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
INNER_FOLDS = 4
VARIANT = "tuned"

GRIDS: dict[str, dict[str, tuple[Any, ...]]] = {
    "polynomial": {"degree": (1, 2, 3, 4, 5, 6, 7, 8)},
    "rbf": {"kernel": ("cubic", "thin_plate_spline", "quintic"), "neighbors": (50, 100)},
    "random_forest": {"min_samples_leaf": (1, 3, 10), "max_features": (0.5, 1.0)},
    "gradient_boosting": {"max_depth": (3, 5, 7), "n_estimators": (100, 300)},
    "hist_gradient_boosting": {"max_leaf_nodes": (15, 31, 63), "min_samples_leaf": (5, 20)},
    "lightgbm": {"num_leaves": (15, 31, 63), "min_child_samples": (5, 20)},
}


@dataclass(frozen=True, eq=False)
class Tuned:
    """A fitted model with the settings that the inner folds chose.

    Attributes:
        model: fitted to all training rows.
        settings: the choice.
        inner_rmse: of the choice, unit of the targets.
    """

    model: Regressor
    settings: dict[str, Any]
    inner_rmse: float


def tuned_names() -> tuple[str, ...]:
    """The names of the models that can be tuned, as a person types them."""
    return tuple(f"{name}:{VARIANT}" for name in GRIDS)


def grid_of(name: str) -> list[dict[str, Any]]:
    """The settings that are tried for a model, the first being kept where several are equal.

    Raises:
        UsageError: the model has no such grid.
    """
    if name not in GRIDS:
        raise UsageError(
            "model-not-tunable",
            "There are no settings to choose among for this model.",
            remedy="Name one of the expected models; Gaussian processes tune themselves by "
            "their likelihood.",
            got=f"{name}:{VARIANT}",
            expected=", ".join(tuned_names()),
        )
    grid = GRIDS[name]
    return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]


def _affordable(
    name: str, settings: list[dict[str, Any]], rows: int, inputs: int
) -> list[dict[str, Any]]:
    """Without polynomials of more terms than rows: they fit anything, at great cost."""
    if name != "polynomial":
        return settings
    return [one for one in settings if comb(inputs + one["degree"], inputs) <= rows] or settings[:1]


def fit_tuned(
    name: str, X: FloatArray, y: FloatArray, group: IntArray, *, seed: int, device: str
) -> Tuned:
    """Choose among :func:`grid_of` by inner folds of whole groups, then fit all rows.

    Args:
        name: of the registry.
        X: (n, d) training inputs.
        y: (n,) training targets.
        group: (n,) any labels.
        seed: of the inner division and of the model.
        device: ``cpu`` or ``cuda``.
    """
    labels, number = np.unique(group, return_inverse=True)
    count = min(INNER_FOLDS, len(labels))
    settings = _affordable(name, grid_of(name), *X.shape)
    if count < 2:
        return Tuned(make(name, seed=seed, device=device, **settings[0]).fit(X, y), settings[0], 0)
    rng = np.random.default_rng([seed, 4000])
    label = deal(number.ravel().astype(np.int64), len(labels), count, rng)
    errors = []
    for choice in settings:
        predicted = np.empty(len(y))
        for fold in range(count):
            test = label == fold
            model = make(name, seed=seed, device=device, **choice).fit(X[~test], y[~test])
            predicted[test] = model.predict(X[test])
        errors.append(rmse(y, predicted))
    best = int(np.argmin(errors))
    model = make(name, seed=seed, device=device, **settings[best]).fit(X, y)
    return Tuned(model, settings[best], errors[best])
