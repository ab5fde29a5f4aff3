"""Limits of the grades, and counts."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.conformability.grades import grade_of, region_score, region_scores


def test_limits_are_the_papers() -> None:
    overlap = np.array([1.0, 0.9, 0.9 - 1e-6, 0.75, 0.75 - 1e-6, 0.0, np.nan])
    assert grade_of(overlap).tolist() == ["good", "good", "fair", "fair", "poor", "poor", ""]


def test_exactly_three_quarters_is_fair_whatever_the_rounding() -> None:
    # 0.75 as ratios of areas that computers give.
    ratios = np.array([(0.1 + 0.2) / 0.4, 11.25 * 15.0 / (15.0 * 15.0), 3 * 0.25 - 1e-16])
    assert set(grade_of(ratios)) == {"fair"}


def test_counts_use_scored_cells_as_the_denominator() -> None:
    overlap = np.array([[0.95, 0.80], [0.70, np.nan]])
    grade = grade_of(overlap)
    draws = np.stack([overlap, overlap - 0.06])
    whole = region_score("all", np.ones((2, 2), dtype=bool), overlap, grade, draws)
    assert (whole.cells, whole.scored, whole.good, whole.fair, whole.poor) == (4, 3, 1, 1, 1)
    assert whole.satisfactory == pytest.approx(2 / 3)
    # Draws: 2 of 3, then 1 of 3 satisfactory.
    assert whole.satisfactory_low == pytest.approx(1 / 3, abs=0.02)
    assert whole.satisfactory_high == pytest.approx(2 / 3, abs=0.02)
    assert whole.mean_overlap == pytest.approx((0.95 + 0.80 + 0.70) / 3)


def test_a_region_without_scores_has_no_ratio() -> None:
    region = np.array([["S", "S"], ["P", "S"]])
    overlap = np.array([[0.95, 0.80], [np.nan, 0.9]])
    scores = region_scores(region, overlap, grade_of(overlap), overlap[None])
    assert [score.label for score in scores] == ["S", "P"]
    assert scores[0].satisfactory == 1.0
    assert scores[1].cells == 1
    assert scores[1].scored == 0
    assert scores[1].satisfactory is None
    assert scores[1].mean_overlap is None
