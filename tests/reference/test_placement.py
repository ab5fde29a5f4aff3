"""Placement tolerances against closed forms: rigid offsets of a grid of squares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tolerances import PLACEMENT_MM
from worn_stand_in import worn_patch

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.montecarlo import cell_corners
from kiribench.fem.wear import WornPatch
from kiribench.reference.placement import (
    DIRECTIONS,
    FARTHEST_SLIP_MM,
    Placement,
    placement_object,
    placement_of,
    placement_text,
)

ROWS, COLUMNS, PITCH = 6, 4, 15.0
STEPS = np.stack(np.meshgrid(np.arange(COLUMNS + 1), np.arange(ROWS + 1)), axis=-1)
NODES = PITCH * STEPS.astype(np.float64)


def overlap(corner: np.ndarray) -> np.ndarray:
    areas = quad_areas(
        np.ascontiguousarray(cell_corners(NODES).reshape(-1, 4, 2)),
        np.ascontiguousarray(cell_corners(corner).reshape(-1, 4, 2)),
    )
    return (areas[:, 2] / areas[:, 0]).reshape(ROWS, COLUMNS)


class Rigid:
    """A patch that moves as it is put on; offsets count ``gain`` times."""

    def __init__(self, gain: float = 1.0, rough: float = 0.0, fails: float = np.inf) -> None:
        self.gain, self.rough, self.fails, self.solves = gain, rough, fails, 0

    def __call__(self, **pose: Any) -> WornPatch:
        self.solves += 1
        shift = self.gain * np.array(pose.get("offset_mm", (0.0, 0.0)))
        angle = np.deg2rad(pose.get("turn_deg", 0.0))
        middle = NODES.mean(axis=(0, 1))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        q = (NODES - middle) @ turn.T + middle + shift + self.rough * shift**2
        q[..., 1] -= pose.get("strap_slip_mm", 0.0) * NODES[..., 1] / NODES[-1, 0, 1]
        failed = np.abs(shift).max() > self.fails
        return worn_patch(q, status="not-converged" if failed else "ok")


def found(model: Rigid, share: float = 0.9) -> Placement:
    return placement_of(model, overlap, elements=6, share=share)


def test_a_shift_costs_its_share_of_the_cell() -> None:
    tolerance = found(Rigid())
    # 1 - d / 15 falls through .9 at 1.5 mm and through .75 at 3.75 mm.
    for direction in ("up", "down", "medial", "lateral"):
        one = tolerance.of(direction)
        assert one.good == pytest.approx(1.5, abs=PLACEMENT_MM)
        assert one.fair == pytest.approx(3.75, abs=PLACEMENT_MM)
        assert not one.good_open
        assert one.unit == "mm"
    assert tolerance.nominal_good == 1.0


def test_a_response_that_is_not_linear_is_followed_by_solves() -> None:
    model = Rigid(gain=1.0, rough=0.3)
    one = found(model).of("medial")
    # d + .3 d^2 = 1.5 and 3.75.
    assert one.good == pytest.approx((np.sqrt(1 + 4 * 0.3 * 1.5) - 1) / 0.6, abs=PLACEMENT_MM)
    assert one.fair == pytest.approx((np.sqrt(1 + 4 * 0.3 * 3.75) - 1) / 0.6, abs=PLACEMENT_MM)


def test_a_slip_moves_the_distal_cells_most() -> None:
    tolerance = found(Rigid(), share=1.0)
    # The last row moves by the slip at its distal edge, five sixths at its proximal one: the cell
    # covers its skin but for the last of it, slip / 15, and gets nothing back for the rest.
    assert tolerance.of("strap_slip").good == pytest.approx(1.5, abs=2 * PLACEMENT_MM)
    loose = found(Rigid(), share=0.5)
    assert loose.of("strap_slip").good > 1.5 * tolerance.of("strap_slip").good
    assert loose.of("strap_slip").good <= FARTHEST_SLIP_MM


def test_a_turn_either_way_is_the_same_on_a_symmetric_patch() -> None:
    tolerance = found(Rigid())
    medial, lateral = tolerance.of("turned_medial"), tolerance.of("turned_lateral")
    assert medial.good == pytest.approx(lateral.good, abs=0.1)
    assert 0.5 < medial.good < 3.0
    assert medial.unit == "deg"
    turned = overlap(Rigid()(turn_deg=medial.good).corner_q_mm)
    assert ((turned >= 0.9).mean() >= 0.9) or medial.good < 0.1
    beyond = overlap(Rigid()(turn_deg=medial.good + 0.3).corner_q_mm)
    assert (beyond >= 0.9).mean() < 0.9


def test_what_is_not_good_at_first_has_no_tolerance() -> None:
    class Off(Rigid):
        def __call__(self, **pose: Any) -> WornPatch:
            worn = super().__call__(**pose)
            return worn_patch(worn.corner_q_mm + np.array([2.0, 0.0]))

    tolerance = found(Off())
    assert tolerance.of("up").good == 0.0
    assert tolerance.of("up").fair > 0.0
    assert tolerance.of("medial").fair == pytest.approx(1.75, abs=PLACEMENT_MM)
    # Back over the node and out on the other side.
    assert tolerance.of("lateral").fair == pytest.approx(5.75, abs=PLACEMENT_MM)
    assert tolerance.nominal_good == 0.0


def test_a_patch_that_does_not_move_has_an_open_tolerance() -> None:
    tolerance = found(Rigid(gain=0.1))
    assert tolerance.of("up").good_open
    content = placement_object(tolerance, participant="S1", method="worn")
    assert "up: good" in content["open"]
    assert "over 7.5 mm" in placement_text(tolerance)


def test_beyond_the_last_equilibrium_nothing_is_promised() -> None:
    one = found(Rigid(fails=1.51)).of("up")
    assert one.fair <= 1.5 + PLACEMENT_MM
    assert not one.fair_open


def test_solves_are_few_and_the_record_is_complete() -> None:
    model = Rigid()
    tolerance = found(model)
    assert model.solves == 1 + sum(one.solves for one in tolerance.tolerances)
    assert model.solves <= 1 + 4 * len(DIRECTIONS)
    content = placement_object(tolerance, participant="S1", method="worn")
    assert content["schema"] == "kiribench.placement/1"
    assert set(content["offsets_mm"]) == {"up", "down", "lateral", "medial"}
    assert content["offsets_mm"]["up"] == pytest.approx(1.5, abs=PLACEMENT_MM)
    assert content["fair"]["offsets_mm"]["up"] == pytest.approx(3.75, abs=PLACEMENT_MM)
    assert content["share"] == 0.9
    assert content["turn_deg"] > 0
    assert "1.5 mm" in placement_text(tolerance)
