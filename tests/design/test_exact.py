"""The least cuts that meet a target: closed forms, conditions of optimality, brute force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from design_toys import Toy, drawn_problem, hill, plane, product, surrogates
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import BRUTE_STEP, ON_TARGET, OPTIMUM

from kiribench.dataset import Dataset
from kiribench.design.exact import least_cuts, least_penalised
from kiribench.design.problem import problem_from_subject
from kiribench.design.reachable import reachable
from kiribench.design.response import KernelResponse
from kiribench.schema.design_space import read_design_space
from kiribench.surrogate import fit_table

DATA = Path(__file__).parents[2] / "data/synthetic"


def test_a_plane_is_met_at_the_foot_of_the_perpendicular() -> None:
    target = np.array([1.0, 2.0, 3.0])
    found = least_cuts(Toy(plane, np.ones(3)), target, 0.9, 0.01)
    expected = (target - 0.01)[:, None] * np.array([3.0, 4.0]) / 25
    np.testing.assert_allclose(found.cuts, expected, atol=OPTIMUM)


def test_bounds_are_held_and_the_other_length_makes_up_for_it() -> None:
    # The foot of 3 a + 4 b = 4.99 is (.599, .798): beyond a bound of .7, b stays there.
    found = least_cuts(Toy(plane, np.ones(1)), np.array([5.0]), 0.75, 0.01)
    np.testing.assert_allclose(found.cuts[0], [(4.99 - 4 * 0.75) / 3, 0.75], atol=OPTIMUM)


def test_a_hyperbola_is_met_on_the_diagonal() -> None:
    found = least_cuts(Toy(product, np.ones(2)), np.array([0.3, 0.6]), 0.9, 0.005)
    expected = np.sqrt(np.array([0.295, 0.595]))
    np.testing.assert_allclose(found.cuts, np.column_stack([expected] * 2), atol=OPTIMUM)


def test_no_cuts_where_none_are_needed() -> None:
    found = least_cuts(Toy(plane, np.ones(2)), np.array([0.004, 0.006]), 0.9, 0.005)
    assert found.cuts[0].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(found.cuts[1], 0.001 * np.array([3, 4]) / 25, atol=OPTIMUM)


def test_an_island_around_a_maximum_is_found() -> None:
    # f = target - tolerance is a circle about (.6, .3) of radius .2 sqrt(-2 ln .998): 2.5 %.
    toy = Toy(hill, np.ones(1))
    found = least_cuts(toy, np.array([1.0]), 0.9, 0.002)
    centre = np.array([0.6, 0.3])
    radius = 0.2 * np.sqrt(-2 * np.log(0.998))
    nearest = centre * (1 - radius / np.hypot(*centre))
    np.testing.assert_allclose(found.cuts[0], nearest, atol=OPTIMUM)


@pytest.mark.parametrize("beyond", [1.2, 1.0049])
def test_out_of_reach_is_the_nearest_there_is(beyond: float) -> None:
    found = least_cuts(Toy(hill, np.ones(1)), np.array([beyond]), 0.9, 0.005)
    value = Toy(hill, np.ones(1)).jet(found.cuts).value[0]
    if beyond > 1.005:
        np.testing.assert_allclose(found.cuts[0], [0.6, 0.3], atol=1e-5)
        assert found.reachable.distance(np.array([beyond]))[0] == pytest.approx(beyond - 1)
    else:
        assert value == pytest.approx(beyond - 0.005, abs=ON_TARGET)


def test_the_reachable_range_in_closed_form() -> None:
    span = reachable(Toy(plane, np.array([1.0, -2.0])), 0.8)
    np.testing.assert_allclose(span.low, [0.0, -11.2])
    np.testing.assert_allclose(span.high, [5.6, 0.0])
    assert span.nearest(np.array([9.0, -1.0])).tolist() == [5.6000000000000005, -1.0]


def test_the_papers_objective_on_a_plane() -> None:
    # min (3a + 4b - t)^2 + l (a^2 + b^2): along (3, 4) with length 5 t / (25 + l).
    target, penalty = np.array([1.0, 2.5]), 0.1
    found = least_penalised(Toy(plane, np.ones(2)), target, 0.9, penalty)
    expected = (5 * target / (25 + penalty))[:, None] * np.array([0.6, 0.8])
    np.testing.assert_allclose(found.cuts, expected, atol=OPTIMUM)


def test_conditions_of_optimality_hold_in_every_cell() -> None:
    problem, _ = drawn_problem(3, 8, 5)
    target = problem.poisson_ratio.ravel()
    response = KernelResponse.of(surrogates().poisson, problem.longitudinal_strain.ravel())
    high, tolerance = 0.9, 0.005
    cuts = least_cuts(response, target, high, tolerance).cuts
    at = response.jet(cuts)
    error = at.value - target
    assert np.abs(error).max() <= tolerance + ON_TARGET
    for x, slope, miss in zip(cuts, at.slope, error, strict=True):
        if not x.any():
            continue
        assert abs(miss) == pytest.approx(tolerance, abs=ON_TARGET)
        free = (x > 0) & (x < high)
        multiplier = -2 * (x[free] @ slope[free]) / (slope[free] @ slope[free])
        # The tolerance pushes outwards, the free variables balance, bounds push inwards.
        assert multiplier * np.sign(miss) >= -1e-9
        rest = 2 * x + multiplier * slope
        np.testing.assert_allclose(rest[free], 0, atol=1e-5)
        assert (rest[x >= high] <= 1e-6).all()
        assert (rest[x <= 0] >= -1e-6).all()


def _brute(
    response: KernelResponse, target: np.ndarray, high: float, tolerance: float, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least a^2 + b^2 on a fine grid, and the smallest and largest value, slab by slab."""
    ticks = np.linspace(0.0, high, 1 + round(high / step))
    least = np.full(len(target), np.inf)
    low, top = np.full(len(target), np.inf), np.full(len(target), -np.inf)
    for start in range(0, len(ticks), 20):
        slab = ticks[start : start + 20]
        values = response.on_grid(slab, ticks)
        low = np.minimum(low, values.min(axis=(1, 2)))
        top = np.maximum(top, values.max(axis=(1, 2)))
        size = slab[:, None] ** 2 + ticks**2
        met = np.abs(values - target[:, None, None]) <= tolerance
        least = np.minimum(least, np.where(met, size, np.inf).min(axis=(1, 2)))
    return np.sqrt(least), low, top


def _against_brute_force(response: KernelResponse, target: np.ndarray, step: float) -> None:
    high, tolerance = 0.9, 0.005
    found = least_cuts(response, target, high, tolerance)
    least, low, top = _brute(response, target, high, tolerance, step)
    assert (found.reachable.low <= low + ON_TARGET).all()
    assert (found.reachable.high >= top - ON_TARGET).all()
    distance = found.reachable.distance(target)
    error = np.abs(response.jet(found.cuts).value - target)
    assert (error <= np.maximum(tolerance, distance) + ON_TARGET).all()
    inside = np.isfinite(least) & (distance < tolerance)
    if not inside.any():
        return
    gain = least[inside] - np.hypot(*found.cuts[inside].T)
    assert gain.min() >= -1e-9  # never worse than the best of the grid
    assert gain.max() <= 2 * step


def test_every_cell_is_at_the_global_optimum_of_the_stand_in() -> None:
    problem, _ = drawn_problem(5, 9, 8)
    rng = np.random.default_rng(0)
    target = problem.poisson_ratio.ravel() + (rng.random(72) < 0.2) * rng.normal(0, 0.4, 72)
    response = KernelResponse.of(surrogates().poisson, problem.longitudinal_strain.ravel())
    _against_brute_force(response, target, 0.003)


@pytest.mark.slow
@pytest.mark.parametrize("table", ["cell", "sheet"])
def test_72_of_72_at_the_global_optimum_of_the_simulated_tables(table: str) -> None:
    kept = fit_table(read_design_space(DATA / f"design_space/{table}.parquet"))
    low, high = kept.low[2], kept.high[2]
    dataset = Dataset.open(DATA)
    for participant in dataset.participants:
        problem = problem_from_subject(dataset.subject(participant))
        strain = np.clip(problem.longitudinal_strain[problem.wanted], low, high)
        assert len(strain) == 72
        response = KernelResponse.of(kept, strain)
        _against_brute_force(response, problem.poisson_ratio[problem.wanted], BRUTE_STEP)
    rng = np.random.default_rng(7)
    response = KernelResponse.of(kept, rng.uniform(low, high, 72))
    target = response.jet(rng.uniform(0, 0.95, (72, 2))).value
    target += (rng.random(72) < 0.15) * rng.normal(0, 0.3, 72)
    _against_brute_force(response, target, BRUTE_STEP)
    # At and about both ends of the reachable range, where only a small island is left.
    span = reachable(response, 0.9)
    ends = np.where(rng.random(72) < 0.5, span.low, span.high)
    outwards = np.where(ends == span.low, -1.0, 1.0)
    for beyond in (0.0051, 0.00499, 0.004, 0.0, -0.004, -0.0051):
        _against_brute_force(response, ends + beyond * outwards, BRUTE_STEP)


@pytest.mark.slow
def test_the_papers_objective_has_no_lower_point_on_a_fine_grid() -> None:
    kept = fit_table(read_design_space(DATA / "design_space/cell.parquet"))
    rng = np.random.default_rng(8)
    response = KernelResponse.of(kept, rng.uniform(kept.low[2], kept.high[2], 72))
    target = response.jet(rng.uniform(0, 0.95, (72, 2))).value
    target += (rng.random(72) < 0.15) * rng.normal(0, 0.3, 72)
    penalties = (1e-4, 1e-3, 1e-2, 0.1, 10.0)
    least = np.full((len(penalties), 72), np.inf)
    ticks = np.linspace(0.0, 0.9, 1 + round(0.9 / BRUTE_STEP))
    for start in range(0, len(ticks), 20):
        slab = ticks[start : start + 20]
        miss = (response.on_grid(slab, ticks) - target[:, None, None]) ** 2
        square = slab[:, None] ** 2 + ticks**2
        for row, penalty in zip(least, penalties, strict=True):
            np.minimum(row, (miss + penalty * square).min(axis=(1, 2)), out=row)
    for row, penalty in zip(least, penalties, strict=True):
        cuts = least_penalised(response, target, 0.9, penalty).cuts
        value = (response.jet(cuts).value - target) ** 2 + penalty * (cuts**2).sum(axis=1)
        assert (value <= row + 1e-12).all()
        assert (row - value).max() < 1e-4


@settings(max_examples=25, deadline=None)
@given(target=st.floats(-3.0, 3.0), high=st.floats(0.1, 0.95), tolerance=st.floats(1e-4, 0.1))
def test_limits_and_tolerance_hold_whatever_is_asked(
    target: float, high: float, tolerance: float
) -> None:
    toy = Toy(hill, np.array([1.0, -1.5]))
    targets = np.array([target, -target])
    found = least_cuts(toy, targets, high, tolerance)
    assert (found.cuts >= 0).all() and (found.cuts <= high).all()
    miss = np.abs(toy.jet(found.cuts).value - targets)
    distance = found.reachable.distance(targets)
    assert (miss <= np.maximum(tolerance, distance) + ON_TARGET).all()
