"""Lines and arcs against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import Polygon
from tolerances import STROKE_ROUNDING_MM

from kiribench.fabrication.strokes import FLAT_MM, circle, polyline, rounded


def test_length_of_a_circle_and_its_flattening():
    whole = circle("slot", (3.0, -2.0), 5.0)
    assert whole.length_mm == pytest.approx(10 * math.pi, abs=STROKE_ROUNDING_MM)
    radius = np.hypot(*(whole.flattened() - (3.0, -2.0)).T)
    assert np.max(np.abs(radius - 5.0)) < STROKE_ROUNDING_MM
    middle = (whole.flattened()[1:] + whole.flattened()[:-1]) / 2
    assert np.min(np.hypot(*(middle - (3.0, -2.0)).T)) > 5.0 - FLAT_MM


@pytest.mark.parametrize("clockwise", [False, True])
def test_rounded_rectangle_has_the_area_and_length_of_the_closed_form(clockwise):
    corners = [(0, 0), (10, 0), (10, 6), (0, 6)]
    stroke = rounded("outline", corners[::-1] if clockwise else corners, 1.5)
    assert stroke.length_mm == pytest.approx(32 - 8 * 1.5 + 3 * math.pi, abs=STROKE_ROUNDING_MM)
    area = 60 - (4 - math.pi) * 1.5**2
    assert Polygon(stroke.flattened(1e-5)).area == pytest.approx(area, abs=1e-3)


def test_a_corner_that_turns_inwards_gains_material():
    ell = [(0, 0), (10, 0), (10, 4), (4, 4), (4, 10), (0, 10)]
    sharp, soft = rounded("outline", ell, 0.0), rounded("outline", ell, [0, 0, 0, 1.0, 0, 0])
    gained = Polygon(soft.flattened(1e-5)).area - Polygon(sharp.flattened()).area
    assert gained == pytest.approx(1 - math.pi / 4, abs=1e-3)


@pytest.mark.parametrize("make", ["open", "closed"])
def test_turning_and_mirroring_keep_the_shape(make):
    stroke = (
        rounded("outline", [(0, 0), (8, 0), (8, 5), (1, 7)], [0.5, 1, 0, 2])
        if make == "closed"
        else polyline("slit", [(0, 0), (3, 1), (4, 7)])
    )
    back = stroke.reversed()
    assert back.length_mm == pytest.approx(stroke.length_mm, abs=STROKE_ROUNDING_MM)
    one, two = (np.array(sorted(map(tuple, s.flattened().round(6)))) for s in (stroke, back))
    if make == "open":
        np.testing.assert_allclose(one, two)
        np.testing.assert_allclose(back.ends_mm, stroke.ends_mm[::-1])
    else:
        difference = Polygon(stroke.flattened()).symmetric_difference(Polygon(back.flattened()))
        assert difference.area < 1e-3
        third = Polygon(stroke.started_at(2).flattened())
        assert third.symmetric_difference(Polygon(stroke.flattened())).area < 1e-9
    mirrored = stroke.moved((1.0, 2.0), mirror_x_mm=20.0)
    expected = np.column_stack([20 - stroke.flattened()[:, 0] + 1, stroke.flattened()[:, 1] + 2])
    np.testing.assert_allclose(mirrored.flattened(), expected, atol=1e-12)
