"""The robust design: its derivatives, and what it gains over the nominal one."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from worn_stand_in import StandIn, worn_patch

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.montecarlo import cell_corners
from kiribench.design.robust import RobustOptions, Spread, design_robust, overlap_slopes
from kiribench.errors import NotConvergedError
from kiribench.fem.wear import WornPatch
from kiribench.lattice import CutMap


class Posed(StandIn):
    """The stand-in, moved rigidly by the pose."""

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        at = super().worn(cut_map, elements)
        corner = at.corner_q_mm + np.array(pose.get("offset_mm", (0.0, 0.0)))
        corner[..., 1] -= pose.get("strap_slip_mm", 0.0) * self.node_q_mm[..., 1] / 60.0
        return worn_patch(corner, status=at.status)


def overlap_of(model: StandIn) -> Any:
    skin = cell_corners(model.node_q_mm)

    def overlap(corner: np.ndarray) -> np.ndarray:
        patch = cell_corners(corner)
        areas = quad_areas(
            np.ascontiguousarray(np.broadcast_to(skin, patch.shape).reshape(-1, 4, 2)),
            np.ascontiguousarray(patch.reshape(-1, 4, 2)),
        )
        return (areas[:, 2] / areas[:, 0]).reshape(patch.shape[:-2])

    return overlap


def test_slopes_of_the_loss_are_those_of_single_corners() -> None:
    model = Posed()
    overlap = overlap_of(model)
    rng = np.random.default_rng(2)
    corners = model.node_q_mm + 1.5 * rng.standard_normal((2, *model.node_q_mm.shape))
    noise = 0.2 * rng.standard_normal((3, *model.node_q_mm.shape))
    loss, slopes = overlap_slopes(overlap, corners, noise)
    assert loss.shape == (2, 3, 4, 3)
    assert slopes.shape == (2, 3, 4, 3, 4, 2)
    places = [(0, 0), (0, 1), (1, 1), (1, 0)]
    for cell in ((0, 0), (1, 2), (3, 1), (2, 2)):
        for corner, (down, right) in enumerate(places):
            for axis in (0, 1):
                move = np.zeros(model.node_q_mm.shape)
                move[cell[0] + down, cell[1] + right, axis] = 1e-4
                ahead = 1 - overlap(corners[1] + noise[2] + move)
                back = 1 - overlap(corners[1] + noise[2] - move)
                slope = (ahead - back)[cell] / 2e-4
                assert slopes[(1, 2, *cell, corner, axis)] == pytest.approx(slope, abs=2e-4)


def test_it_gains_on_average_and_never_loses() -> None:
    model = Posed()
    overlap = overlap_of(model)
    start = CutMap.uniform(0.5, 0.5, 4, 3, 15.0)
    found = design_robust(model, start, overlap)
    objective = [one.objective_mm2 for one in found.iterations]
    assert objective[-1] < 0.5 * objective[0]
    assert all(after < before for before, after in pairwise(objective))
    spread = Spread()
    mean = []
    for cut_map in (start, found.cut_map):
        poses = [model.worn(cut_map, 6, **pose).corner_q_mm for pose in spread.poses()]
        mean.append(float(overlap(np.stack(poses)).mean()))
    # The expected loss falls by two fifths at least.
    assert 1 - mean[1] < 0.6 * (1 - mean[0])


def test_a_one_sided_error_is_designed_for() -> None:
    # The strap only slips back: the best cuts answer half-way, the nominal ones do not.
    model = Posed()
    overlap = overlap_of(model)
    spread = Spread(along_mm=0.0, across_mm=0.0, turn_deg=0.0, slip_mm=6.0, node_mm=0.0)
    nominal = np.asarray(model.best).reshape(2, 4, 3)
    start = CutMap(nominal[0], nominal[1], 15.0)
    options = RobustOptions(rounds=8, worth=1e-4, barrier=1e-9, smoothness=0.0)
    found = design_robust(model, start, overlap, options=options, spread=spread)

    def loss(cut_map: CutMap) -> float:
        poses = [model.worn(cut_map, 6, **pose).corner_q_mm for pose in spread.poses()]
        return float(((1 - overlap(np.stack(poses))) ** 2).mean())

    assert loss(found.cut_map) < 0.8 * loss(start)
    # Paid for in the nominal pose, where the start was perfect.
    assert found.iterations[-1].rms_mm > found.iterations[0].rms_mm + 0.1


def test_poses_are_one_standard_deviation_either_way() -> None:
    poses = Spread(along_mm=2.0, across_mm=0.0, turn_deg=1.0, slip_mm=3.0).poses()
    assert poses[0] == {}
    assert {"offset_mm": (0.0, -2.0)} in poses
    assert {"offset_mm": (0.0, 2.0)} in poses
    assert {"strap_slip_mm": 3.0} in poses
    assert len(poses) == 6


def test_a_start_without_equilibrium_is_refused() -> None:
    with pytest.raises(NotConvergedError) as error:
        design_robust(
            Posed(fails_beyond=-1.0), CutMap.uniform(0.5, 0.5, 4, 3, 15.0), overlap_of(Posed())
        )
    assert error.value.code == "robust-start"
