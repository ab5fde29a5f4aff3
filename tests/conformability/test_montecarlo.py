"""Coverage of the intervals, the known noise bias, and determinism."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import INTERVAL_COVERAGE, NOISE_BIAS, RATIO_COVERAGE

from kiribench.conformability.grades import grade_of, region_score
from kiribench.conformability.montecarlo import (
    FlatCells,
    cell_corners,
    changed_grades,
    compatible,
    displacements,
    score_quads,
    vary,
)
from kiribench.conformability.result import GradeBy

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


MISFITS = {
    "perfect": CELL,
    "near": CELL + np.array([0.3, 0.3]),
    "shifted": CELL + np.array([1.0, 1.0]),
    "along": CELL + np.array([1.2, 0.0]),
    "shrunk": CELL * [0.93, 0.85],
    "narrow": CELL * [1.0, 0.9],
    "turned": CELL @ np.array([[0.996, -0.090], [0.090, 0.996]]),
    "mixed": CELL * [1.05, 0.92] + np.array([0.3, -0.4]),
    "irregular": CELL + 0.7 * np.random.default_rng(5).normal(size=(4, 2)),
    "oversized": CELL * 1.03,
}


def coverage(patch: np.ndarray, sd: float, definition: GradeBy, repeats: int) -> float:
    """The share of repeated simulations whose interval contains the true overlap."""
    rng = np.random.default_rng(9)
    truth = float(score_quads(CELL, patch, definition, "global"))
    size = (1, repeats, 4, 2)
    cells = FlatCells(
        CELL + sd * rng.normal(size=size),
        patch + sd * rng.normal(size=size),
        np.tile(AXES, (1, repeats, 1, 1)),
    )
    found = compatible(
        cells,
        score_quads(cells.skin, cells.patch, definition, "global"),
        sd * rng.normal(size=(250, *size)),
        sd * rng.normal(size=(250, *size)),
        definition=definition,
        alignment="global",
    )
    inside = (found.low - 1e-9 <= truth) & (truth <= found.high + 1e-9)
    return float(inside.mean())


@pytest.mark.parametrize("name", ["perfect", "near", "along", "shrunk", "irregular"])
def test_interval_covers_the_truth(name: str) -> None:
    assert coverage(MISFITS[name], 0.25, "paper", 300) >= INTERVAL_COVERAGE


SHORT = pytest.mark.xfail(
    reason="some misfits are covered in 92 % only by this definition, a known shortfall",
    strict=True,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("definition", "sd"),
    [
        ("paper", 0.1),
        ("paper", 0.25),
        ("paper", 0.5),
        ("strict", 0.1),
        pytest.param("strict", 0.25, marks=SHORT),
        ("strict", 0.5),
        pytest.param("iou", 0.1, marks=SHORT),
        pytest.param("iou", 0.25, marks=SHORT),
        ("iou", 0.5),
    ],
)
def test_interval_covers_the_truth_of_every_misfit(definition: GradeBy, sd: float) -> None:
    least = {name: coverage(patch, sd, definition, 400) for name, patch in MISFITS.items()}
    assert min(least.values()) >= INTERVAL_COVERAGE, least


def knee_like_patch(seed: int) -> FlatCells:
    """12 x 6 cells under a smooth misfit, worst at the sides, that leaves some 80 % fair."""
    rng = np.random.default_rng(seed)
    y, x = np.meshgrid(np.arange(13.0), np.arange(7.0), indexing="ij")
    nodes = 15.0 * np.stack([y, x], axis=-1)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    edge = 5.0 * np.abs(x / 3.0 - 1.0) ** 6 * np.sign(x - 3.0)
    moved = nodes + np.stack(
        [0.9 * np.sin(x / 2.0 + phase[0]), edge * (0.6 + 0.4 * np.sin(y / 3.0 + phase[1]))], axis=-1
    )
    moved += 0.5 * np.sin(y / 4.0 + phase[2])[..., None]
    axes = np.tile(np.eye(3)[:2], (12, 6, 1, 1))
    return FlatCells(cell_corners(nodes), cell_corners(moved), axes)


@pytest.mark.slow
@pytest.mark.parametrize("sd", [0.1, 0.25, 0.5])
def test_interval_of_the_satisfactory_ratio_covers_the_truth(sd: float) -> None:
    assert ratio_coverage(sd, 100) >= RATIO_COVERAGE


def ratio_coverage(sd: float, repeats: int) -> float:
    rng = np.random.default_rng(4)
    hits = 0
    everywhere = np.ones((12, 6), dtype=bool)
    for repeat in range(repeats):
        true = knee_like_patch(repeat)
        overlap = score_quads(true.skin, true.patch, "paper", "global")
        moves = [displacements(true, sd * rng.normal(size=(1, 13, 7, 3)))[0] for _ in range(2)]
        cells = FlatCells(true.skin + moves[0], true.patch + moves[1], true.axes)
        reading = score_quads(cells.skin, cells.patch, "paper", "global")
        found = vary(
            cells, reading, np.full((13, 7), sd), np.full((13, 7), sd), None,
            definition="paper", alignment="global", samples=200, rng=rng,
        )  # fmt: skip
        score = region_score("all", everywhere, reading, grade_of(reading), found.draws)
        assert score.satisfactory_low is not None and score.satisfactory_high is not None
        truth = float((overlap >= 0.75 - 1e-9).mean())
        hits += score.satisfactory_low - 1e-9 <= truth <= score.satisfactory_high + 1e-9
    return hits / repeats


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
