"""Every model passes scikit-learn's own checks and gives the same numbers for a seed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from kiribench.errors import UsageError
from kiribench.surrogate.registry import make, model_names, spec

# Settings that keep tiny data quick; what is checked does not depend on them.
QUICK: dict[str, dict[str, Any]] = {
    "gp": {"max_evaluations": 15},
    "gp:paper": {"max_evaluations": 15},
    "gp:shared-sigma": {"max_evaluations": 15},
    "gp_kronecker": {"max_evaluations": 15},
    "svgp": {"max_evaluations": 30, "inducing": 40},
    "gradient_boosting": {"n_estimators": 30},
    "random_forest": {"n_estimators": 20},
    "hist_gradient_boosting": {"max_iter": 30},
    "lightgbm": {"n_estimators": 30},
    "mlp_ensemble": {"members": 2, "max_steps": 150, "width": 32},
}
VARIANTS = ("gp:paper", "gradient_boosting:paper", "random_forest:paper")


@parametrize_with_checks(
    [make(name, **QUICK.get(name, {})) for name in model_names() if name not in VARIANTS]
)
def test_scikit_learn_checks(estimator: Any, check: Any) -> None:
    check(estimator)


@pytest.mark.parametrize("name", model_names())
def test_same_seed_same_numbers(name: str, curves: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = curves
    settings = QUICK.get(name, {})
    first = make(name, seed=3, **settings).fit(X, y)
    second = make(name, seed=3, **settings).fit(X, y)
    points = X[::7] + 1e-3
    np.testing.assert_array_equal(first.predict(points), second.predict(points))


@pytest.mark.parametrize("name", [n for n in model_names() if spec(n).has_uncertainty])
def test_standard_deviation_is_positive_and_grows_away_from_data(
    name: str, curves: tuple[np.ndarray, np.ndarray]
) -> None:
    X, y = curves
    model = make(name, **QUICK.get(name, {})).fit(X, y)
    _, inside = model.predict(X, return_std=True)  # type: ignore[call-arg]
    far = X.max(axis=0) + 2.0 * np.ptp(X, axis=0)
    _, outside = model.predict(far[None, :], return_std=True)  # type: ignore[call-arg]
    assert (inside > 0.0).all()
    assert outside[0] > 3.0 * np.median(inside) or name == "gp:shared-sigma"


def test_unknown_model_lists_the_names() -> None:
    with pytest.raises(UsageError, match="gp_kronecker") as caught:
        make("kriging")
    assert caught.value.code == "model-unknown"


def test_settings_override_the_variant() -> None:
    assert make("random_forest:paper").get_params()["max_depth"] == 2
    assert make("random_forest:paper", max_depth=4).get_params()["max_depth"] == 4


def test_every_model_is_checked() -> None:
    """The optional ones too: where they are not installed this says so instead of passing."""
    absent = [name for name in model_names(available_only=False) if not spec(name).available]
    if absent:
        pytest.skip(f"not installed: {', '.join(absent)}")
    checked = {type(make(name)) for name in model_names() if name not in VARIANTS}
    assert checked == {type(make(name)) for name in model_names(available_only=False)}
    assert len(checked) == 10
