"""The corrected resampled t-test against a published example, by hand and by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student
from sklearn.datasets import make_moons
from sklearn.model_selection import RepeatedStratifiedKFold, cross_val_score
from sklearn.svm import SVC

from kiribench.validation.significance import compare, holm


def test_the_published_example_of_scikit_learn() -> None:
    """scikit-learn's "Statistical comparison of models using grid search".

    Published there: corrected t 0.750 and one-sided p 0.227; Bayesian probabilities .773 of
    "rbf better than linear" and .432 of practical equivalence within .01.
    """
    X, y = make_moons(noise=0.352, random_state=1, n_samples=100)
    folds = RepeatedStratifiedKFold(n_splits=10, n_repeats=10, random_state=0)
    rbf, linear = (
        cross_val_score(SVC(kernel=kernel, random_state=0), X, y, scoring="roc_auc", cv=folds)
        for kernel in ("rbf", "linear")
    )
    found = compare(rbf, linear, test_over_train=1 / 9)
    assert found.statistic == pytest.approx(0.750, abs=5e-4)
    assert found.p_value / 2 == pytest.approx(0.227, abs=5e-4)
    assert found.p_worse == pytest.approx(0.773, abs=5e-4)
    assert compare(rbf, linear, test_over_train=1 / 9, rope=0.01).p_equivalent == pytest.approx(
        0.432, abs=5e-4
    )


def test_by_hand() -> None:
    # d = 1, 2, 3, 4: mean 2.5, variance 5/3; (1/4 + 1/3) 5/3 = 35/36.
    found = compare([2, 4, 6, 8], [1, 2, 3, 4], test_over_train=1 / 3)
    assert found.difference == 2.5
    assert found.standard_error == pytest.approx(math.sqrt(35 / 36), rel=1e-14)
    assert found.statistic == pytest.approx(2.5 / math.sqrt(35 / 36), rel=1e-14)
    assert found.p_value == pytest.approx(2 * student.sf(found.statistic, 3), rel=1e-12)
    reach = 3.182446305284263 * math.sqrt(35 / 36)  # t of 3 degrees, 97.5 %, from tables
    assert (found.low, found.high) == pytest.approx((2.5 - reach, 2.5 + reach), rel=1e-9)


@given(
    st.lists(st.floats(-1, 1), min_size=2, max_size=12),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.5),
)
def test_probabilities_add_up_and_turn_round(d, ratio, rope) -> None:
    zero = [0.0] * len(d)
    one = compare(d, zero, test_over_train=ratio, rope=rope)
    other = compare(zero, d, test_over_train=ratio, rope=rope)
    assert one.p_worse + one.p_equivalent + one.p_better == pytest.approx(1.0, abs=1e-9)
    assert one.p_worse == pytest.approx(other.p_better, abs=1e-9)
    assert one.p_value == pytest.approx(other.p_value, abs=1e-9)


def test_equal_models_and_constant_differences() -> None:
    same = compare([1.0, 2.0], [1.0, 2.0], test_over_train=0.1, rope=0.1)
    assert (same.p_value, same.p_equivalent) == (1.0, 1.0)
    shifted = compare([2.0, 3.0], [1.0, 2.0], test_over_train=0.1, rope=0.1)
    assert (shifted.p_value, shifted.p_worse) == (0.0, 1.0)
    with pytest.raises(ValueError, match="two folds"):
        compare([1.0], [2.0], test_over_train=0.1)


def test_the_plain_test_is_too_sure_and_the_corrected_one_is_not() -> None:
    """Two equal learners (means of different halves of the inputs' noise) on overlapping folds."""
    rng = np.random.default_rng(5)
    rejected = {0.0: 0, 1 / 9: 0}
    trials = 200
    for _ in range(trials):
        x = rng.normal(size=(60, 2))
        y = x.sum(axis=1) + rng.normal(size=60)
        errors = np.empty((30, 2))
        for split in range(30):
            if split % 10 == 0:
                order = rng.permutation(60)
            test = order[6 * (split % 10) : 6 * (split % 10) + 6]
            train = np.setdiff1d(order, test)
            for model in (0, 1):  # each sees one of two equally good inputs
                slope = x[train, model] @ y[train] / (x[train, model] @ x[train, model])
                errors[split, model] = np.mean((y[test] - slope * x[test, model]) ** 2)
        for ratio in rejected:
            rejected[ratio] += compare(*errors.T, test_over_train=ratio).p_value < 0.05
    assert rejected[0.0] / trials > 0.2  # the plain test cries wolf
    assert rejected[1 / 9] / trials < 0.1


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm([]) == []
