"""The methods side by side: targets recovered, forces balanced, limits held, reasons given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_toys import drawn_problem, problem, surrogates
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import OPTIMUM

from kiribench.design.cells import cells_of
from kiribench.design.fill import filled_from_neighbours
from kiribench.design.limits import Limits
from kiribench.design.methods import METHODS, design_patch
from kiribench.design.options import DesignOptions
from kiribench.design.result import Designed
from kiribench.design.sensitivity import cutting_error
from kiribench.design.summary import design_object, design_text
from kiribench.design.surrogates import Surrogates
from kiribench.errors import UsageError
from kiribench.lattice import CutMap

OWN = ("paper", "exact", "balanced", "uniform")
WIDE = Limits(0.1, 0.0, 95.0)
FEW = (4, 2)


def designed(
    method: str, seed: int = 1, shape: tuple[int, int] = (5, 4), **options: object
) -> Designed:
    return design_patch(
        method, drawn_problem(seed, *shape)[0], surrogates(), WIDE, DesignOptions(**options)
    )


def test_each_method_has_its_line() -> None:
    assert set(OWN) <= set(METHODS)
    with pytest.raises(UsageError) as caught:
        designed("guess")
    assert caught.value.code == "method-unknown"


@pytest.mark.parametrize(("method", "worst"), [("paper", 0.02), ("exact", 0.0050001)])
def test_targets_of_known_designs_are_met(method: str, worst: float) -> None:
    result = designed(method, shape=FEW)
    assert np.abs(result.error).max() <= worst
    assert (result.design.quantity("distance") == 0).all()
    kept = surrogates().poisson
    again = kept.predict(
        100 * result.design.a.ravel(), 100 * result.design.b.ravel(), result.strain.ravel()
    )
    np.testing.assert_allclose(
        result.design.quantity("predicted_poisson_ratio").ravel(), again.mean, atol=1e-9
    )
    np.testing.assert_allclose(
        result.design.quantity("predicted_poisson_ratio_sd").ravel(), again.sd, atol=1e-12
    )


def test_least_cuts_are_less_than_those_that_made_the_targets() -> None:
    for seed in (1, 2):
        made = drawn_problem(seed)[1]
        found = designed("exact", seed).design
        assert (np.hypot(found.a, found.b) <= np.hypot(*np.moveaxis(made, -1, 0)) + 1e-9).all()


def test_cma_es_ends_at_the_optimum_of_its_objective_and_keeps_its_course() -> None:
    result = designed("paper", shape=FEW)
    exact = designed("exact", shape=FEW, penalty=1e-3)
    told = result.design.settings["MethodSettings"]
    assert told["AtGlobalOptimum"] >= 7  # of 8: it may end in another branch
    objective = [r.error**2 + 1e-3 * (r.design.a**2 + r.design.b**2) for r in (result, exact)]
    assert (objective[1] <= objective[0] + 1e-12).all()
    assert int((objective[0] <= objective[1] + 1e-8).sum()) == told["AtGlobalOptimum"]
    course = result.generations
    assert course is not None
    assert (np.diff(course.best, axis=0) <= 0).all()
    np.testing.assert_allclose(course.best[-1], objective[0].ravel(), atol=1e-9)
    assert course.population.shape[1:] == (8, 6, 2)
    for cell, stop in enumerate(course.stopped):
        assert np.isfinite(course.objective[:stop, cell]).all()
        assert np.isnan(course.objective[stop:, cell]).all()
    again = designed("paper", shape=FEW)
    np.testing.assert_array_equal(again.design.a, result.design.a)
    short = designed("paper", shape=FEW, max_generations=3).generations
    assert short is not None
    np.testing.assert_array_equal(short.population, course.population[:3])
    other = design_patch(
        "paper", result.problem, surrogates(), WIDE, DesignOptions(seed=5, max_generations=3)
    ).generations
    assert other is not None and (other.population != short.population).any()


def test_a_penalty_on_percents_would_leave_no_cuts() -> None:
    # lambda = 1e-3 with a and b in percent is 10 with fractions.
    result = designed("exact", penalty=10.0)
    assert max(result.design.a.max(), result.design.b.max()) < 0.12


def test_uniform_is_the_best_single_pair() -> None:
    result = designed("uniform")
    assert np.ptp(result.design.a) == 0 and np.ptp(result.design.b) == 0
    mine = float((result.error**2).sum())
    asked = drawn_problem(1)[0]
    cells = cells_of(asked, surrogates(), WIDE, DesignOptions())
    ticks = np.linspace(0, 0.95, 191)
    values = cells.poisson.on_grid(ticks, ticks) - cells.target[:, None, None]
    assert mine <= (values**2).sum(axis=0).min() + 1e-12


@pytest.mark.parametrize("method", OWN)
def test_reasons_and_fills(method: str) -> None:
    strain = np.full((3, 3), 0.2)
    nu = np.full((3, 3), 0.1)
    nu[0, 0], nu[0, 1], nu[0, 2] = 0.9, -2.0, np.nan
    strain[1, 0], strain[1, 1] = 0.02, 0.9
    options = DesignOptions(max_generations=60)
    result = design_patch(method, problem(strain, nu), surrogates(), WIDE, options)
    reason, distance = result.design.reason, result.design.quantity("distance")
    assert reason[0].tolist() == [
        "target-above-reachable",
        "target-below-reachable",
        "node-missing",
    ]
    assert reason[1, :2].tolist() == ["strain-below-data", "strain-beyond-data"]
    high = result.design.quantity("reachable_high")
    assert distance[0, 0] == pytest.approx(0.9 - high[0, 0])
    assert result.design.quantity("reachable_low")[0, 1] - distance[0, 1] == pytest.approx(-2.0)
    if method == "exact":
        assert result.error[0, 0] == pytest.approx(-distance[0, 0], abs=1e-9)
        assert (reason[2] == "").all()
    assert np.isnan(result.error[0, 2]) and np.isfinite(result.design.a).all()
    told = design_object(result)
    assert (told["with_target"], told["cells"], told["out_of_reach"]) == (8, 9, 2)
    # A strain that was never simulated counts as met in no method.
    seen = ~np.char.startswith(reason, "strain-") & np.isfinite(result.error)
    met = np.abs(result.error[seen]) <= options.tolerance + 1e-9
    assert (told["within_tolerance"], told["unseen_strain"]) == (int(met.sum()), 2)
    words = design_text(result)
    assert "2 are out of reach" in words and "1 cells had none and are filled in" in words
    verdict = words.splitlines()[-1]
    assert verdict.startswith("  Verdict: ") and "every target" not in verdict
    assert "2 ask for strains that the surrogate has not seen" in verdict


def test_a_filled_cell_lies_between_its_neighbours() -> None:
    values = np.array([[0.0, np.nan, 0.6], [0.3, np.nan, np.nan]])
    filled = filled_from_neighbours(values)
    known = np.isfinite(values)
    np.testing.assert_array_equal(filled[known], values[known])
    # (0,1): neighbours 0, .6, (1,1); (1,1): .3, (0,1), (1,2); (1,2): .6, (1,1).
    x, y, z = filled[0, 1], filled[1, 1], filled[1, 2]
    np.testing.assert_allclose([3 * x - y, 3 * y - x - z, 2 * z - y], [0.6, 0.3, 0.6])


@settings(max_examples=12, deadline=None)
@given(
    method=st.sampled_from(["exact", "balanced", "uniform"]),
    ligament=st.floats(0.1, 3.0),
    kerf=st.floats(0.0, 0.5),
    longest=st.floats(20.0, 99.0),
    seed=st.integers(0, 100),
)
def test_limits_are_never_violated(
    method: str, ligament: float, kerf: float, longest: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    asked = problem(rng.uniform(0.03, 0.7, (3, 3)), rng.uniform(-1.2, 0.6, (3, 3)))
    limits = Limits(ligament, kerf, longest)
    result = design_patch(method, asked, surrogates(), limits)
    cut_map = CutMap(result.design.a, result.design.b, 15.0)
    assert cut_map.feasible(ligament, kerf)
    assert max(result.design.a.max(), result.design.b.max()) <= longest / 100
    assert min(result.design.a.min(), result.design.b.min()) >= 0


def test_the_papers_search_holds_the_limits_too() -> None:
    asked = problem(np.full((1, 3), 0.2), np.array([[-2.0, -0.5, 0.9]]))
    options = DesignOptions(max_generations=40)
    result = design_patch("paper", asked, surrogates(), Limits(2.0, 0.2, 90.0), options)
    assert max(result.design.a.max(), result.design.b.max()) <= 1 - 4.2 / 15


def test_cutting_errors_by_finite_differences_and_insensitive_designs() -> None:
    plain = designed("exact")
    steady = designed("exact", prefer="insensitive")
    kept, asked = surrogates().poisson, drawn_problem(1)[0]
    strain, step = asked.longitudinal_strain.ravel(), 1e-3
    for result in (plain, steady):
        a, b = 100 * result.design.a.ravel(), 100 * result.design.b.ravel()
        by_a = kept.predict(a + step, b, strain).mean - kept.predict(a - step, b, strain).mean
        by_b = kept.predict(a, b + step, strain).mean - kept.predict(a, b - step, strain).mean
        by_a, by_b = by_a / (2 * step), by_b / (2 * step)  # a percent of the cell edge
        kerf = 100 * 0.05 / 15
        expected = np.sqrt(by_a**2 + by_b**2 + (kerf * (by_a + by_b)) ** 2)
        np.testing.assert_allclose(
            result.design.quantity("cutting_error").ravel(), expected, rtol=1e-4, atol=1e-7
        )
    assert np.abs(steady.error).max() < 0.005
    after = steady.design.quantity("cutting_error").ravel()
    curves = designed("exact", curves=True).curves
    response = cells_of(asked, surrogates(), WIDE, DesignOptions()).poisson
    shares = []
    for k, curve in enumerate(curves):
        points = np.concatenate(curve.pieces)
        slope = response.jet(points, np.full(len(points), k)).slope
        along = cutting_error(slope, 0.01, 0.05 / 15)
        assert after[k] <= along.min() + 1e-12
        assert after[k] >= along.min() - 0.1 * (along.max() - along.min())
        shares.append(along.min() / along.max())
    assert min(shares) < 0.5  # there was something to choose


def test_curves_of_equivalent_designs_pass_through_the_target() -> None:
    result = designed("exact", curves=True)
    response = cells_of(result.problem, surrogates(), WIDE, DesignOptions()).poisson
    assert len(result.curves) == 20
    for k, curve in enumerate(result.curves):
        row, column = curve.cell
        assert 4 * row + column == k
        for piece in curve.pieces:
            value = response.jet(piece, np.full(len(piece), k)).value
            np.testing.assert_allclose(value, result.problem.poisson_ratio.ravel()[k], atol=1e-8)
            assert (piece >= 0).all() and (piece <= 0.95).all()


def test_mixed_strain_measures_are_refused_and_a_missing_stress_is_no_hindrance() -> None:
    asked = replace(drawn_problem(1)[0], strain_measure="engineering")
    with pytest.raises(UsageError) as caught:
        design_patch("exact", asked, surrogates())
    assert caught.value.code == "strain-measure-mixed"
    assert "engineering" in str(caught.value)
    without = Surrogates(replace(surrogates().poisson, stress=None))
    assert np.isnan(design_patch("exact", drawn_problem(1)[0], without).nominal_stress_mpa).all()


@pytest.mark.parametrize(
    "change",
    [
        {"tolerance": 0.0},
        {"penalty": -1.0},
        {"penalty": 1e-3, "prefer": "insensitive"},
        {"population": 2},
        {"max_generations": 0},
    ],
)
def test_senseless_options_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        DesignOptions(**change)


@pytest.mark.parametrize("limits", [(-1.0, 0.2, 90.0), (0.5, 0.2, 100.0), (0.5, np.nan, 90.0)])
def test_senseless_limits_are_refused(limits: tuple[float, float, float]) -> None:
    with pytest.raises(UsageError):
        Limits(*limits)


def test_limits_that_allow_no_cut_are_refused_and_the_bound_is_the_lattices() -> None:
    with pytest.raises(UsageError) as caught:
        Limits(8.0, 0.2, 90.0).longest(15.0)
    assert caught.value.code == "limits-leave-nothing"
    assert Limits(1.0, 0.4, 90.0).longest(15.0) == pytest.approx(1 - 2.4 / 15, abs=OPTIMUM)
    assert Limits(0.1, 0.0, 90.0).longest(15.0) == 0.9
