"""What each protocol trains on and tests."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiribench.errors import UsageError
from kiribench.validation.protocols import plan, protocol_names
from kiribench.validation.protocols.grouped import deal
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable

SETTINGS = CvSettings(folds=4, repeats=2)


def folds_of(table: CvTable, name: str, settings: CvSettings = SETTINGS):
    return plan(table, replace(settings, protocols=(name,))).folds[name]


def test_train_and_test_never_share_a_row(table: CvTable) -> None:
    planned = plan(table, SETTINGS).folds
    assert set(planned) == set(protocol_names()) - {"own-folds"}
    for folds in planned.values():
        for fold in folds:
            assert len(np.intersect1d(fold.train, fold.test)) == 0
            assert len(fold.train) and len(fold.test)
        assert len({fold.name for fold in folds}) == len(folds)


@pytest.mark.parametrize("name", ["grouped", "leave-design-out", "shuffled", "contiguous"])
def test_every_row_is_tested_once_a_repeat(table: CvTable, name: str) -> None:
    folds = folds_of(table, name)
    repeats = 1 + max(fold.repeat for fold in folds)
    assert repeats == (2 if name == "grouped" else 1)
    for repeat in range(repeats):
        tested = np.concatenate([fold.test for fold in folds if fold.repeat == repeat])
        assert np.array_equal(np.sort(tested), np.arange(len(table.y)))


@given(
    sizes=st.lists(st.integers(1, 9), min_size=2, max_size=40),
    folds=st.integers(2, 8),
    seed=st.integers(0, 99),
)
def test_dealing_keeps_groups_whole_and_folds_even(sizes, folds, seed) -> None:
    folds = min(folds, len(sizes))
    group = np.repeat(np.arange(len(sizes)), sizes)
    label = deal(group, len(sizes), folds, np.random.default_rng(seed))
    for one in range(len(sizes)):
        assert len(np.unique(label[group == one])) == 1
    rows = np.bincount(label, minlength=folds)
    assert rows.min() >= 1
    # Greedy filling, largest first: no fold exceeds another by more than the largest group.
    assert np.ptp(rows) <= max(sizes)


def test_repeats_and_seeds_divide_differently(table: CvTable) -> None:
    first, second = (
        [fold for fold in folds_of(table, "grouped") if fold.repeat == repeat] for repeat in (0, 1)
    )
    assert not np.array_equal(first[0].test, second[0].test)
    other = folds_of(table, "grouped", replace(SETTINGS, seed=1))
    assert not np.array_equal(first[0].test, other[0].test)
    again = folds_of(table, "grouped")
    assert np.array_equal(first[0].test, again[0].test)


def test_levels_are_whole_lines(table: CvTable) -> None:
    for name, column in (("leave-level-a-out", 0), ("leave-level-b-out", 1)):
        folds = folds_of(table, name)
        assert len(folds) == 6
        for fold in folds:
            level = np.unique(table.X[fold.test, column])
            assert len(level) == 1
            assert not (table.X[fold.train, column] == level[0]).any()
    assert folds_of(table, "leave-level-a-out")[1].label == "a = 23 %"


def test_blocks_are_rectangles(table: CvTable) -> None:
    folds = folds_of(table, "blocks")
    assert len(folds) == 9
    for fold in folds:
        low, high = (f(table.X[fold.test, :2], axis=0) for f in (np.min, np.max))
        train = table.X[fold.train, :2]
        assert not ((train >= low) & (train <= high)).all(axis=1).any()
    assert folds[0].label == "a 5 to 23, b 5 to 23 %"


def test_the_edge_is_95_percent_and_more(table: CvTable) -> None:
    (fold,) = folds_of(table, "edge")
    assert (table.X[fold.test, :2].max(axis=1) >= 95.0).all()
    assert (table.X[fold.train, :2].max(axis=1) < 95.0).all()
    inner = replace(table, X=table.X * [0.9, 0.9, 1.0])
    assert "edge" in plan(inner, SETTINGS).left_out
    with pytest.raises(UsageError, match="protocol-does-not-apply"):
        folds_of(inner, "edge")


def test_learning_curve_parts_are_nested_and_grow(table: CvTable) -> None:
    folds = folds_of(table, "learning-curve")
    for draw in range(3):
        mine = [fold for fold in folds if fold.repeat == draw]
        assert [fold.size for fold in mine] == sorted({fold.size for fold in mine})
        for small, large in pairwise(mine):
            assert np.isin(small.train, large.train).all()
            assert np.array_equal(small.test, large.test)
        for fold in mine:
            assert len(np.unique(table.group[fold.train])) == fold.size
            assert not np.isin(table.group[fold.train], table.group[fold.test]).any()


def test_contiguous_folds_are_stretches(table: CvTable) -> None:
    for fold in folds_of(table, "contiguous"):
        assert np.array_equal(fold.test, np.arange(fold.test[0], fold.test[-1] + 1))


def test_one_row_uses_each_design_once(table: CvTable) -> None:
    folds = folds_of(table, "one-row")
    tested = np.concatenate([fold.test for fold in folds])
    assert np.array_equal(np.sort(table.group[tested]), np.arange(table.groups))
    for fold in folds:
        assert np.isin(fold.train, tested).all()


def test_own_folds(table: CvTable) -> None:
    own = replace(table, own_fold=table.group % 3, fold_names=("x", "y", "z"))
    folds = folds_of(own, "own-folds")
    assert [fold.label for fold in folds] == ["x", "y", "z"]
    assert np.array_equal(folds[1].test, np.flatnonzero(table.group % 3 == 1))


def test_a_plain_table_has_no_cuts_and_no_groups(table: CvTable) -> None:
    rows = len(table.y)
    plain = replace(
        table,
        features=("p", "q", "r"),
        group=np.arange(rows),
        group_names=tuple(map(str, range(rows))),
        group_word="row",
    )
    planned = plan(plain, SETTINGS)
    assert set(planned.folds) == {"grouped", "learning-curve", "contiguous"}
    assert "a_percent" in planned.left_out["blocks"]
    assert "own group" in planned.left_out["shuffled"]


def test_unknown_protocols_are_refused(table: CvTable) -> None:
    with pytest.raises(UsageError, match="protocol-unknown"):
        folds_of(table, "loocv")
