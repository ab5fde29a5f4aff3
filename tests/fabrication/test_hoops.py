"""Outline and hoops: closed forms, and nothing that touches a cut."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import LineString, Polygon, box

from kiribench.errors import UsageError
from kiribench.fabrication.hoops import Hoops, outline, place_hoops, windows
from kiribench.fabrication.slits import beam_paths
from kiribench.lattice import CutMap


def test_knee_patch_has_seven_hoops_an_end_on_the_grid_lines():
    placed = place_hoops(6, 15.0, Hoops())
    assert [hoop.x_mm for hoop in placed] == [0, 15, 30, 45, 60, 75, 90]
    assert {hoop.width_mm for hoop in placed} == {13.0}
    assert len(windows(6, 12, 15.0, Hoops())) == 14


def test_area_of_the_outline_in_closed_form():
    """Patch and tongues, less their outer corners, plus the inner ones at the patch's end."""
    hoops = Hoops()
    area = Polygon(outline(6, 12, 15.0, hoops).flattened(1e-5)).area
    corner = 1 - math.pi / 4
    expected = 90 * 180 + 14 * 13 * hoops.reach_mm
    expected -= 28 * corner * hoops.corner_mm**2  # far corners of the tongues
    small = min(hoops.corner_mm, 0.4 * hoops.gap_mm)
    expected += 24 * corner * small**2  # at the foot of the gaps
    expected += 4 * corner * small**2  # where the long edges meet the outer tongues
    expected -= 4 * corner * small**2  # the outer tongues' near corners
    assert area == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("rows", "columns", "cell"),
    [(12, 6, 15.0), (1, 1, 15.0), (3, 3, 6.0), (5, 7, 10.0), (2, 9, 8.0)],
)
def test_the_outline_holds_every_cut_and_bridges_no_notch(rows, columns, cell):
    hoops = Hoops()
    ring = outline(columns, rows, cell, hoops)
    sheet = Polygon(ring.flattened())
    assert sheet.is_valid
    patch = box(0, 0, columns * cell, rows * cell)
    assert sheet.buffer(0.35).covers(patch)  # only rounded corners are missing
    slits = beam_paths(CutMap.uniform(0.9, 0.9, rows, columns, cell), 0.1)
    for start, end in zip(slits.start_mm, slits.end_mm, strict=True):
        assert sheet.buffer(1e-6).covers(LineString([start, end]))
    for start, end in zip(slits.start_mm[slits.notch], slits.end_mm[slits.notch], strict=True):
        ends = [LineString(ring.flattened()).distance(LineString([p, p])) for p in (start, end)]
        assert min(ends) < 1e-6
    rims = sheet
    for window in windows(columns, rows, cell, hoops):
        hole = Polygon(window.flattened())
        assert sheet.buffer(-min(hoops.rim_mm, hoops.end_mm) + 0.01).covers(hole)
        rims = rims.difference(hole)
    assert rims.geom_type == "Polygon"
    assert len(rims.interiors) == 2 * len(place_hoops(columns, cell, hoops))


def test_without_hoops_the_outline_is_the_patch():
    ring = outline(3, 2, 10.0, None)
    assert ring.length_mm == 100.0
    assert np.array_equal(np.ptp(ring.points_mm, axis=0), [30, 20])


def test_cells_too_small_for_necks_are_refused_with_the_remedy():
    with pytest.raises(UsageError, match="--no-hoops"):
        place_hoops(6, 4.0, Hoops())
