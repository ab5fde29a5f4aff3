"""The robust design: its poses, its derivatives, and what it gains over the nominal one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from worn_stand_in import StandIn, worn_patch

from kiribench.design.robust import ROBUST, Spread, design_robust
from kiribench.design.worn import EXACT
from kiribench.design.worn_record import worn_settings
from kiribench.errors import NotConvergedError
from kiribench.fem.wear import WearSensitivities, WornPatch
from kiribench.lattice import CutMap


@dataclass(eq=False)
class Posed(StandIn):
    """The stand-in, moved rigidly by the pose, and farther across the more the first cut opens.

    Attributes:
        slides: millimetres farther across for a millimetre of offset and a cut of 1.
        stuck: the pose that has no equilibrium.
    """

    slides: float = 0.0
    stuck: Any = None

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        return self.sensitivities(cut_map, elements, **pose).worn

    def sensitivities(self, cut_map: CutMap, elements: int, **pose: Any) -> WearSensitivities:
        at = super().sensitivities(cut_map, elements)
        across, along = pose.get("offset_mm", (0.0, 0.0))
        shift = np.array([across * (1 + self.slides * cut_map.a[0, 0]), along])
        corner = at.worn.corner_q_mm + shift
        corner[..., 1] -= pose.get("strap_slip_mm", 0.0) * self.node_q_mm[..., 1] / 60.0
        derivative = at.corner_q.copy()
        derivative[::2, 0] += across * self.slides
        status = "not-converged" if pose == self.stuck else at.worn.status
        return WearSensitivities(worn_patch(corner, status=status), derivative, 0.0)


def cuts(values: np.ndarray) -> CutMap:
    a, b = values.reshape(2, 4, 3)
    return CutMap(a, b, 15.0)


def cuts_of(found: CutMap) -> np.ndarray:
    return np.concatenate([found.a.ravel(), found.b.ravel()])


def square_over(model: Posed, cut_map: CutMap, poses: Any) -> float:
    """Mean square of the corners' components over poses, mm^2."""
    worn = [model.worn(cut_map, 6, **pose).corner_q_mm for pose in poses]
    return float(((np.stack(worn) - model.target_q_mm) ** 2).mean())


def test_the_poses_have_the_moments_of_the_errors() -> None:
    spread = Spread(along_mm=2.0, across_mm=0.5, turn_deg=3.0, slip_mm=4.0)
    nominal, *wrong = spread.poses()
    assert nominal == {}
    table = np.array([[*p["offset_mm"], p["turn_deg"], p["strap_slip_mm"]] for p in wrong])
    assert len(table) == 8
    # The half-normal distribution: mean sd sqrt(2/pi), variance sd^2 (1 - 2/pi).
    mean = np.array([0, 0, 0, 4 * np.sqrt(2 / np.pi)])
    assert table.mean(axis=0) == pytest.approx(mean)
    off = table - mean
    assert off.T @ off / 8 == pytest.approx(np.diag([0.25, 4.0, 9.0, 16 * (1 - 2 / np.pi)]))
    third = np.einsum("ki,kj,kl->ijl", off, off, off)
    assert np.abs(third).max() < 1e-9
    assert (table[:, 3] > 0).all()


def test_random_poses_are_those_errors_too() -> None:
    spread = Spread(along_mm=2.0, across_mm=0.5, turn_deg=3.0, slip_mm=4.0)
    drawn = spread.draw(4000, np.random.default_rng(1))
    table = np.array([[*p["offset_mm"], p["turn_deg"], p["strap_slip_mm"]] for p in drawn])
    assert table[:, :3].std(axis=0) == pytest.approx([0.5, 2.0, 3.0], rel=0.05)
    assert table[:, 3].min() >= 0
    assert np.sqrt((table[:, 3] ** 2).mean()) == pytest.approx(4.0, rel=0.05)


def test_an_error_left_out_needs_no_pose() -> None:
    only = Spread(along_mm=0.0, across_mm=0.0, turn_deg=0.0, slip_mm=3.0).poses()
    assert len(only) == 3
    assert len(Spread(slip_mm=0.0).poses()) == 9


def test_it_gains_on_average_and_never_loses() -> None:
    model = Posed(curvature=0.5, slides=1.0)
    start = CutMap.uniform(0.5, 0.5, 4, 3, 15.0)
    found = design_robust(
        model,
        start,
        options=replace(ROBUST, levels=((6, 8),), barrier_mm2=1e-5, smoothness_mm2=0.0),
    )
    objective = [one.objective_mm2 for one in found.iterations]
    assert all(after < before for before, after in pairwise(objective))
    # On poses of its own and on others better than the best nominal cuts.
    best = cuts(np.asarray(model.best))
    for poses in (Spread().poses(), Spread().draw(50, np.random.default_rng(4))):
        assert square_over(model, found.cut_map, poses) < square_over(model, best, poses)
    # What it says is what it is.
    poses = Spread().poses()
    last = found.iterations[-1]
    assert last.posed_rms_mm**2 / 2 == pytest.approx(square_over(model, found.cut_map, poses))
    assert last.rms_mm**2 / 2 == pytest.approx(square_over(model, found.cut_map, [EXACT]))


def test_a_one_sided_error_is_designed_for() -> None:
    # The strap only slips back: in a linear model the best cuts answer its mean.
    model = Posed()
    spread = Spread(along_mm=0.0, across_mm=0.0, turn_deg=0.0, slip_mm=2.0)
    start = cuts(np.asarray(model.best))
    free = replace(ROBUST, levels=((6, 12),), barrier_mm2=1e-9, smoothness_mm2=0.0, worth=1e-6)
    found = design_robust(model, start, options=free, spread=spread)
    poses = spread.poses()
    moved = np.stack([model.worn(start, 6, **pose).corner_q_mm for pose in poses])
    off = (moved.mean(axis=0) - model.target_q_mm).ravel()
    answer = np.linalg.lstsq(model.matrix, -off, rcond=None)[0]
    assert cuts_of(found.cut_map) - np.asarray(model.best) == pytest.approx(answer, abs=1e-4)
    # Paid for in the exact pose, where the start was perfect.
    assert found.iterations[-1].rms_mm > found.iterations[0].rms_mm + 0.1


def test_cuts_that_let_the_patch_slide_farther_are_closed() -> None:
    # The first cut moves no corner in the exact pose. Only the derivatives in the other poses
    # know that it multiplies an offset across.
    model = Posed(slides=2.0)
    model.matrix[:, 0] = 0.0
    spread = Spread(along_mm=0.0, across_mm=1.0, turn_deg=0.0, slip_mm=0.0)
    start = cuts(np.r_[0.7, np.asarray(model.best)[1:]])
    options = replace(ROBUST, levels=((6, 12),), worth=1e-6, barrier_mm2=1e-6, smoothness_mm2=0.0)
    found = design_robust(model, start, options=options, spread=spread)
    assert found.cut_map.a[0, 0] < 0.03
    assert cuts_of(found.cut_map)[1:] == pytest.approx(np.asarray(model.best)[1:], abs=1e-3)
    drawn = spread.draw(50, np.random.default_rng(4))
    # Offsets were carried 2.4-fold and are carried 1.04-fold.
    ratio = square_over(model, found.cut_map, drawn) / square_over(model, start, drawn)
    assert ratio == pytest.approx((1.04 / 2.4) ** 2, rel=0.05)


def test_noise_of_the_nodes_adds_the_same_to_every_design() -> None:
    # Which is why there is none in the objective: independent of the cuts, 2 sd^2 a corner.
    model = Posed(slides=1.0)
    noise = 0.25 * np.random.default_rng(2).standard_normal((20000, *model.target_q_mm.shape))
    poses = Spread().poses()
    for values in (np.full(24, 0.5), np.asarray(model.best)):
        worn = np.stack([model.worn(cuts(values), 6, **p).corner_q_mm for p in poses])
        off = worn[np.arange(len(noise)) % len(poses)] + noise - model.target_q_mm
        added = (off**2).mean() - square_over(model, cuts(values), poses)
        assert added == pytest.approx(0.25**2, rel=0.02)


def test_steps_without_equilibrium_in_a_pose_are_shortened() -> None:
    model = Posed(fails_beyond=0.05)
    start = CutMap.uniform(0.5, 0.5, 4, 3, 15.0)
    found = design_robust(model, start)
    last = found.iterations[-1]
    assert max(np.abs(last.a - 0.5).max(), np.abs(last.b - 0.5).max()) <= 0.05
    assert last.objective_mm2 < found.iterations[0].objective_mm2


def test_a_pose_without_equilibrium_is_left_out_and_told() -> None:
    stuck = Spread().poses()[6]
    model = Posed(stuck=stuck)
    found = design_robust(model, CutMap.uniform(0.5, 0.5, 4, 3, 15.0))
    assert stuck not in found.poses and len(found.poses) == 8
    settings = worn_settings(found, "worn")
    assert settings["PosesLeftOut"] == 1 and len(settings["Poses"]) == 8
    last = found.iterations[-1]
    assert last.posed_rms_mm**2 / 2 == pytest.approx(square_over(model, found.cut_map, found.poses))
    assert last.objective_mm2 < found.iterations[0].objective_mm2


def test_a_start_without_equilibrium_in_every_pose_is_refused() -> None:
    with pytest.raises(NotConvergedError) as error:
        design_robust(Posed(fails_beyond=-1.0), CutMap.uniform(0.5, 0.5, 4, 3, 15.0))
    assert error.value.code == "worn-start"
