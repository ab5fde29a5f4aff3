"""Coverage of the intervals, the known noise bias, and determinism."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import INTERVAL_COVERAGE, NOISE_BIAS

from kiribench.conformability.montecarlo import (
    FlatCells,
    changed_grades,
    score_quads,
    vary,
)

CELL = 7.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
AXES = np.eye(3)[None, None, :2]
GRID = (2, 2)


def one_cell(skin: np.ndarray, patch: np.ndarray) -> FlatCells:
    return FlatCells(skin[None, None], patch[None, None], AXES)


@pytest.mark.parametrize(("sd", "reads"), [(0.1, 0.988), (0.3, 0.964), (0.5, 0.941)])
def test_a_perfect_fit_reads_less_by_the_known_amount(sd: float, reads: float) -> None:
    # science: node sd .1 / .3 / .5 mm on both grids reads .988 / .964 / .941.
    cells = one_cell(CELL, CELL)
    found = vary(
        cells,
        np.ones((1, 1)),
        np.full(GRID, sd),
        np.full(GRID, sd),
        None,
        definition="paper",
        alignment="global",
        samples=4000,
        rng=np.random.default_rng(0),
    )
    assert float(found.perfect_fit_reading[0, 0]) == pytest.approx(reads, abs=NOISE_BIAS)


@pytest.mark.parametrize(
    "patch",
    [
        CELL,
        CELL + np.array([0.3, 0.3]),
        CELL + np.array([1.0, 1.0]),
        CELL * [0.93, 0.85],
        CELL * 1.03,
    ],
    ids=["perfect", "near", "shifted", "shrunk", "oversized"],
)
def test_interval_covers_the_truth(patch: np.ndarray) -> None:
    rng = np.random.default_rng(9)
    truth = float(score_quads(CELL, patch, "paper", "global"))
    sd = np.full(GRID, 0.25)
    hits = 0
    for _ in range(300):
        cells = one_cell(
            CELL + 0.25 * rng.normal(size=(4, 2)), patch + 0.25 * rng.normal(size=(4, 2))
        )
        reading = score_quads(cells.skin, cells.patch, "paper", "global")
        found = vary(
            cells,
            reading,
            sd,
            sd,
            None,
            definition="paper",
            alignment="global",
            samples=250,
            rng=rng,
        )
        hits += bool(found.low[0, 0] - 1e-12 <= truth <= found.high[0, 0] + 1e-12)
    assert hits / 300 >= INTERVAL_COVERAGE


def test_probabilities_sum_to_one_and_the_seed_decides() -> None:
    cells = one_cell(CELL, CELL + np.array([0.112 * 15.0, 0.0]))
    runs = [
        vary(
            cells,
            np.full((1, 1), 0.888),
            np.full(GRID, 0.25),
            np.full(GRID, 0.25),
            None,
            definition="paper",
            alignment="global",
            samples=200,
            rng=np.random.default_rng(seed),
        )
        for seed in (1, 1, 2)
    ]
    np.testing.assert_allclose(runs[0].probability.sum(axis=-1), 1.0)
    # A true overlap at the limit, .90, reads .888 on average with this noise (study of 400
    # repeats): there the grade is a coin toss.
    assert 0.3 < float(runs[0].probability[0, 0, 0]) < 0.7
    np.testing.assert_array_equal(runs[0].draws, runs[1].draws)
    assert not np.array_equal(runs[0].draws, runs[2].draws)


def test_a_cell_that_is_not_scored_stays_so() -> None:
    nan = np.full((4, 2), np.nan)
    cells = FlatCells(
        np.stack([CELL, nan])[None], np.stack([CELL, nan])[None], np.tile(AXES, (1, 2, 1, 1))
    )
    found = vary(
        cells,
        np.array([[1.0, np.nan]]),
        np.full((2, 3), 0.25),
        np.full((2, 3), 0.25),
        None,
        definition="iou",
        alignment="global",
        samples=20,
        rng=np.random.default_rng(0),
    )
    assert np.isfinite(found.low[0, 0])
    assert np.isnan(found.low[0, 1])
    assert np.isnan(found.probability[0, 1]).all()


def test_per_cell_alignment_removes_the_shift() -> None:
    moved = CELL * 0.9 + [4.0, -3.0]
    assert float(score_quads(CELL, moved, "paper", "per-cell")) == pytest.approx(0.81)
    assert float(score_quads(CELL, moved, "paper", "global")) < 0.6


def test_registration_alone_changes_grades_only_near_a_limit() -> None:
    rng = np.random.default_rng(3)
    rigid = np.zeros((400, 2, 2, 3))
    rigid[..., 0] = 0.3 * rng.normal(size=(400, 1, 1))
    for shift, risky in ((1.4, True), (0.3, False)):
        cells = one_cell(CELL, CELL + np.array([shift, 0.0]))
        nominal = np.full((1, 1), 1.0 - shift / 15.0)
        changed = changed_grades(cells, nominal, rigid, definition="paper", alignment="global")
        # The grade changes when the shift passes 1.5 mm: 0.1 mm = 1/3 sd away, or 4 sd.
        assert (float(changed[0, 0]) > 0.3) is risky
