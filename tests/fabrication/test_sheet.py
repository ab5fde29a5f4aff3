"""What is left of a sheet, on cases that can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from patch_cases import random_design
from shapely import Polygon, box

from kiribench.fabrication.hoops import Hoops
from kiribench.fabrication.patch import PatchOptions, plan_patch
from kiribench.fabrication.sheet import clean_slits, judge_sheet
from kiribench.lattice import CutMap

SHEET = box(0, 0, 20, 20)


def _judge(slits, *, windows=(), kerf=0.2, ligament=0.5):
    return judge_sheet(
        np.array(slits, float).reshape(-1, 2, 2), SHEET, windows, kerf_mm=kerf, ligament_mm=ligament
    )


def _codes(sheet) -> set[str]:
    return {fault.code for fault in sheet.faults}


def test_the_width_of_a_bridge_is_the_distance_less_the_kerf():
    """Tip to line, side by side, and tip to the sheet's edge."""
    assert _judge([[(5, 5), (9, 5)], [(10, 2), (10, 8)]]).ligament_mm == pytest.approx(0.8)
    assert _judge([[(5, 5), (9, 5)], [(5, 6), (9, 6)]]).ligament_mm == pytest.approx(0.8)
    assert _judge([[(1.0, 5), (9, 5)]]).ligament_mm == pytest.approx(0.8)
    assert _judge([[(5, 5), (9, 5)]], windows=[box(9.9, 4, 12, 6)]).ligament_mm == pytest.approx(
        0.7
    )


def test_the_rim_of_a_window_is_a_bridge_too():
    """Window to the sheet's edge, and window to window; a kerf of the rim's width parts them."""
    edge = box(0.6, 4, 3, 8)
    assert _judge([], windows=[edge]).ligament_mm == pytest.approx(0.4)
    assert _codes(_judge([], windows=[edge])) == {"ligament-thin"}
    near = [box(4, 4, 6, 8), box(6.9, 4, 9, 8)]
    assert _judge([], windows=near).ligament_mm == pytest.approx(0.7)
    assert _judge([], windows=near).faults == ()


def test_a_notchs_own_mouth_is_no_bridge_but_the_far_edge_is():
    sheet = _judge([[(0, 5), (0.3, 5)], [(0, 10), (19.4, 10)]])
    assert sheet.ligament_mm == pytest.approx(0.4)
    assert _codes(sheet) == {"ligament-thin"}


def test_pieces_and_area_by_hand():
    whole = _judge([[(5, 10), (15, 10)]], kerf=0.2)
    burnt = 10 * 0.2 + np.pi * 0.01 + (20 * 20 - 19.8 * 19.8)
    assert whole.pieces == 1
    assert whole.area_mm2 == pytest.approx(400 - burnt, abs=0.01)
    cut = _judge([[(0, 10), (20, 10)]])
    assert (cut.pieces, _codes(cut)) == (2, {"patch-in-pieces"})
    square = [[(5, 5), (8, 5)], [(8, 5), (8, 8)], [(8, 8), (5, 8)], [(5, 8), (5, 5)]]
    assert {"slits-cross", "patch-in-pieces"} <= _codes(_judge(square))


def test_the_kerf_alone_can_part_what_the_lines_leave_together():
    slits = [[(0, 10), (9.95, 10)], [(10.05, 10), (20, 10)]]
    assert _judge(slits, kerf=0.0, ligament=0.0).pieces == 1
    assert _judge(slits, kerf=0.2, ligament=0.0).pieces == 2


def test_slits_that_leave_the_patch_or_reach_a_window():
    assert "slit-leaves-patch" in _codes(_judge([[(15, 5), (21, 5)]]))
    assert "slit-leaves-patch" in _codes(_judge([[(5, 5), (9, 5)]], windows=[box(8, 4, 12, 6)]))
    assert _judge([]).faults == ()
    assert _judge([]).ligament_mm == np.inf


@pytest.mark.parametrize("seed", range(4))
def test_narrowest_ligament_is_the_lattices_gap_less_half_a_kerf(seed):
    """Compensated tips end where the design's do; only the other slit's width is lost."""
    design = random_design(seed, 4, 3)
    kerf = 0.2
    gap = CutMap(design.a, design.b, 15.0).minimum_gap_mm
    for hoops in (None, Hoops()):
        plan = plan_patch(design, PatchOptions(kerf, hoops))
        ends = np.array([s.points_mm for s in plan.part if s.role == "slit"])
        rings = {
            role: [Polygon(s.flattened()) for s in plan.part if s.role == role]
            for role in ("outline", "slot")
        }
        sheet = judge_sheet(
            ends, rings["outline"][0], rings["slot"], kerf_mm=kerf, ligament_mm=gap - kerf / 2
        )
        assert sheet.ligament_mm == pytest.approx(gap - kerf / 2, abs=1e-9)
        assert sheet.faults == ()
        short = judge_sheet(ends, rings["outline"][0], rings["slot"], kerf_mm=kerf, ligament_mm=gap)
        assert _codes(short) == {"ligament-thin"}


def test_doubles_overlaps_and_pieces():
    plain = [[(0, 0), (4, 0)], [(6, 0), (9, 0)], [(0, 3), (4, 3)]]
    clean = clean_slits(np.array(plain, float))
    assert (len(clean.ends_mm), len(clean.twice), len(clean.overlapping), clean.split) == (
        3,
        0,
        0,
        0,
    )
    many = [*plain, [(4, 0), (0, 0)], [(4, 3), (5, 3)], [(8, 0), (10, 0)]]
    clean = clean_slits(np.array(many, float))
    assert (len(clean.ends_mm), len(clean.twice), len(clean.overlapping), clean.split) == (
        3,
        1,
        1,
        1,
    )
    assert sorted(np.ptp(clean.ends_mm, axis=1).max(axis=1)) == [4.0, 4.0, 5.0]
    assert len(clean_slits(np.zeros((0, 2, 2))).ends_mm) == 0
    slanted = [[(0, 0), (3, 4)], [(3, 4), (6, 8)], [(3, 4), (7, 1)]]
    clean = clean_slits(np.array(slanted, float))
    assert sorted(np.linalg.norm(np.ptp(clean.ends_mm, axis=1), axis=1)) == pytest.approx([5, 10])
