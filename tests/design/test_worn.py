"""The worn design: Gauss-Newton on a stand-in in closed form, and its parts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from worn_stand_in import StandIn

from kiribench.design.convex_box import newton_in_box
from kiribench.design.limits import Limits
from kiribench.design.regularisation import Regularisation
from kiribench.design.worn import SHORTEST, WornOptions, design_worn, distances
from kiribench.design.worn_record import worn_table
from kiribench.errors import NotConvergedError, UsageError
from kiribench.lattice import CutMap
from kiribench.schema.patch_design import PatchDesign

FREE = WornOptions(levels=((10, 12),), trust=0.3, barrier_mm2=1e-12, smoothness_mm2=0.0, worth=1e-9)


def start(value: float = 0.5) -> CutMap:
    return CutMap.uniform(value, value, 4, 3, 15.0)


def cuts_of(found: CutMap) -> np.ndarray:
    return np.concatenate([found.a.ravel(), found.b.ravel()])


def test_the_linear_problem_is_solved_in_one_step() -> None:
    model = StandIn()
    found = design_worn(model, start(), options=FREE)
    assert found.iterations[1].rms_mm < 1e-6
    assert cuts_of(found.cut_map) == pytest.approx(model.best, abs=1e-7)
    assert found.iterations[0].rms_mm > 0.5
    assert found.iterations[0].step == 0.0
    assert found.iterations[1].step == pytest.approx(np.abs(model.best - 0.5).max(), abs=1e-6)


def test_a_curved_problem_converges_quadratically() -> None:
    model = StandIn(curvature=0.5)
    found = design_worn(model, start(), options=FREE)
    rms = [one.rms_mm for one in found.iterations]
    assert rms[-1] < 1e-6
    assert all(after < before for before, after in pairwise(rms))
    assert cuts_of(found.cut_map) == pytest.approx(model.best, abs=1e-6)
    # Quadratic: each error is at most a constant times the square of the one before it.
    assert rms[2] < 2.0 * rms[1] ** 2 / rms[0]


def test_steps_stay_in_the_trust_region_and_in_the_bounds() -> None:
    best = np.full(24, 0.99)  # beyond the longest cut allowed
    model = StandIn(best=best)
    options = WornOptions(levels=((10, 30),), trust=0.05, barrier_mm2=1e-4)
    found = design_worn(model, start(), Limits(), options)
    longest = Limits().longest(15.0)
    for before, after in pairwise(found.iterations):
        assert np.abs(after.a - before.a).max() <= 0.05 + 1e-12
        assert max(after.a.max(), after.b.max()) < longest
        assert min(after.a.min(), after.b.min()) > SHORTEST
    # It gains what the bounds allow: the best of the box, by an independent solver.
    exact = lsq_linear(model.matrix, model.matrix @ best, (SHORTEST, longest))
    reached = 2 * exact.cost / model.target_q_mm.size
    last = found.iterations[-1]
    apart = (last.corner_q_mm - model.target_q_mm).ravel()
    assert (apart**2).mean() == pytest.approx(reached, rel=0.1)


def test_the_barrier_keeps_cuts_off_their_bounds() -> None:
    model = StandIn(best=np.full(24, 0.9))
    weak = design_worn(model, start(), options=FREE)
    strong = design_worn(model, start(), options=WornOptions(levels=((10, 12),), barrier_mm2=0.05))
    longest = Limits().longest(15.0)
    assert (longest - cuts_of(strong.cut_map)).min() > 5 * (longest - cuts_of(weak.cut_map)).min()
    assert strong.at_bounds < weak.at_bounds


def test_directions_that_move_no_corner_stay_smooth() -> None:
    model = StandIn(rank=12)
    smooth = WornOptions(levels=((10, 12),), trust=0.3, barrier_mm2=1e-9, smoothness_mm2=1e-5)
    found = design_worn(model, start(), options=smooth)
    rms, _ = distances(found.iterations[-1].corner_q_mm, model)
    assert rms < 0.02
    rough = Regularisation((4, 3), 0.02, 0.9, 0.0, 1.0)
    assert rough.value(cuts_of(found.cut_map)) < 0.7 * rough.value(np.asarray(model.best))


def test_corners_without_a_node_do_not_count() -> None:
    model = StandIn()
    for lost in ((0, 0), (2, 1)):
        model.weight[lost] = 0.0
        model.target_q_mm[lost] = (np.nan, 100.0)
    found = design_worn(model, start(), options=FREE)
    seen = model.weight > 0
    last = found.iterations[-1].corner_q_mm
    assert np.abs((last - model.target_q_mm)[seen]).max() < 1e-5
    model.weight[2, 1], model.target_q_mm[2, 1] = 1.0, (30.0, 0.0)
    pulled = design_worn(model, start(), options=FREE)
    assert pulled.iterations[-1].rms_mm > 0.1


def test_a_step_without_equilibrium_is_shortened() -> None:
    model = StandIn(fails_beyond=0.1)
    found = design_worn(model, start(), options=FREE)
    assert np.abs(cuts_of(found.cut_map) - 0.5).max() <= 0.1
    assert found.iterations[-1].rms_mm < found.iterations[0].rms_mm
    assert found.reason == "no shorter step made it better"


def test_a_start_without_equilibrium_is_refused() -> None:
    with pytest.raises(NotConvergedError) as error:
        design_worn(StandIn(fails_beyond=-1.0), start())
    assert error.value.code == "worn-start"


def test_meshes_follow_the_schedule_and_are_never_compared() -> None:
    model = StandIn(mesh_mm=3.0)
    options = WornOptions(
        levels=((6, 2), (10, 2)), trust=0.3, barrier_mm2=1e-12, smoothness_mm2=0.0,
        worth=0.0,
    )  # fmt: skip
    found = design_worn(model, start(), options=options)
    meshes = [one.elements for one in found.iterations]
    assert meshes[:4] == [6, 6, 6, 10]
    assert set(meshes[3:]) == {10}
    restart = meshes.index(10)
    assert found.iterations[restart].step == 0.0
    assert np.array_equal(found.iterations[restart].a, found.iterations[restart - 1].a)
    # It ends at the best fit of the last mesh, whose error no cuts can undo.
    wanted = model.matrix @ model.best - 3.0 / 10
    exact = lsq_linear(model.matrix, wanted).cost
    off = (found.iterations[-1].corner_q_mm - model.target_q_mm).ravel()
    assert 0.5 * off @ off == pytest.approx(exact, rel=1e-6)


def test_a_level_ends_where_a_step_is_not_worth_its_time() -> None:
    model = StandIn()
    slow = replace(FREE, trust=0.05, worth=0.0)
    value = [one.objective_mm2 for one in design_worn(model, start(), options=slow).iterations]
    gain = 1 - value[1] / value[0]
    assert len(value) > 3
    for worth, states in ((1.01 * gain, 2), (0.99 * gain, len(value))):
        found = design_worn(model, start(), options=replace(slow, worth=worth))
        assert len(found.iterations) == pytest.approx(states, abs=1 if states > 2 else 0)
    early = design_worn(model, start(), options=replace(slow, worth=1.01 * gain))
    assert early.reason.startswith("the last step gained less than")


def test_limits_without_a_range_are_refused() -> None:
    with pytest.raises(UsageError, match="no range"):
        design_worn(StandIn(), start(), Limits(ligament_mm=7.2))
    with pytest.raises(UsageError, match="trust"):
        WornOptions(trust=0.0)


def test_slopes_of_the_regularisation_are_those_of_its_value() -> None:
    rng = np.random.default_rng(5)
    regular = Regularisation((4, 3), 0.02, 0.9, 0.3, 0.7)
    p = rng.uniform(0.1, 0.8, 24)
    gradient, hessian = regular.jet(p)
    step = 1e-6
    for k in range(24):
        unit = step * np.eye(24)[k]
        slope = (regular.value(p + unit) - regular.value(p - unit)) / (2 * step)
        assert gradient[k] == pytest.approx(slope, abs=1e-8)
        turn = (regular.jet(p + unit)[0] - regular.jet(p - unit)[0]) / (2 * step)
        assert hessian[k] == pytest.approx(turn, abs=1e-6)


def test_the_box_newton_agrees_with_an_independent_solver() -> None:
    rng = np.random.default_rng(8)
    matrix, wanted = rng.normal(size=(30, 12)), 3 * rng.normal(size=30)
    low, high = np.full(12, -0.2), np.full(12, 0.3)

    def jet(x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        left = matrix @ x - wanted
        return 0.5 * float(left @ left), matrix.T @ left, matrix.T @ matrix

    found = newton_in_box(jet, np.zeros(12), low, high)
    exact = lsq_linear(matrix, wanted, (low, high), tol=1e-14).x
    assert found == pytest.approx(exact, abs=1e-7)
    assert ((found == low) | (found == high)).sum() >= 2


def test_the_table_keeps_the_targets_and_no_prediction() -> None:
    shape = (4, 3)
    words = np.full(shape, "P")
    design = PatchDesign(
        participant="S1", method="balanced", side="right", cell_mm=15.0, thickness_mm=2.0,
        strain_measure="log", a=np.full(shape, 0.5), b=np.full(shape, 0.5), region=words,
        reason=np.full(shape, ""),
        quantities={
            "target_poisson_ratio": np.full(shape, -0.3),
            "predicted_poisson_ratio": np.full(shape, -0.2),
        },
    )  # fmt: skip
    model = StandIn()
    found = design_worn(model, start(), options=FREE)
    table = worn_table(design, found)
    assert table.method == "worn"
    assert set(table.quantities) == {"target_poisson_ratio"}
    assert np.array_equal(table.a, found.cut_map.a)
    assert table.settings["MethodSettings"]["Start"] == "balanced"
    assert table.settings["MethodSettings"]["RmsMm"] == found.iterations[-1].rms_mm
