"""Overlaps of flat outlines with known areas, and the compiled clipper against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tolerances import CLIPPED_AREA_MM2, LINEAR_ALGEBRA

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.overlap import overlaps, simple

CELL = 7.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])


def test_shifted_square() -> None:
    found = overlaps(CELL, CELL + np.array([3.0, 0.0]))
    assert float(found.paper) == pytest.approx(0.8, abs=LINEAR_ALGEBRA)
    assert float(found.strict) == pytest.approx(0.8, abs=LINEAR_ALGEBRA)
    assert float(found.iou) == pytest.approx(12.0 / 18.0, abs=LINEAR_ALGEBRA)


def test_an_oversized_patch_is_rewarded_by_the_papers_definition_only() -> None:
    found = overlaps(CELL, 1.1 * CELL)
    assert float(found.paper) == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    assert float(found.strict) == pytest.approx(1.0 / 1.21, abs=LINEAR_ALGEBRA)
    assert float(found.iou) == pytest.approx(1.0 / 1.21, abs=LINEAR_ALGEBRA)


def test_apart_is_zero() -> None:
    found = overlaps(CELL, CELL + np.array([20.0, 0.0]))
    assert float(found.paper) == float(found.strict) == float(found.iou) == 0.0


def test_folded_and_empty_outlines_are_not_simple() -> None:
    bow_tie = CELL[[0, 2, 1, 3]]
    flat = CELL * [1.0, 0.0]
    unknown = np.full((4, 2), np.nan)
    assert simple(np.stack([CELL, bow_tie, flat, unknown])).tolist() == [True, False, False, False]


corner = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
moved = st.lists(corner, min_size=4, max_size=4).map(lambda c: CELL + np.array(c))


@settings(deadline=None)
@given(moved, moved, st.booleans(), st.integers(0, 3))
def test_clipper_agrees_with_shapely(
    skin: np.ndarray, patch: np.ndarray, reverse: bool, start: int
) -> None:
    patch = np.roll(patch[::-1] if reverse else patch, start, axis=0)
    s, k = shapely.Polygon(skin), shapely.Polygon(patch)
    areas = quad_areas(np.ascontiguousarray(skin[None]), np.ascontiguousarray(patch[None]))[0]
    expected = [s.area, k.area, s.intersection(k).area]
    np.testing.assert_allclose(areas, expected, atol=CLIPPED_AREA_MM2)


def test_clipper_takes_a_dented_quad_from_any_corner() -> None:
    dented = np.array([[0.0, 0.0], [10.0, 0.0], [2.0, 2.0], [0.0, 10.0]])
    square = np.array([[1.0, 1.0], [1.0, 6.0], [6.0, 6.0], [6.0, 1.0]])
    expected = shapely.Polygon(dented).intersection(shapely.Polygon(square)).area
    for start in range(4):
        areas = quad_areas(np.roll(dented, start, axis=0)[None], square[None])[0]
        np.testing.assert_allclose(areas, [20.0, 25.0, expected], atol=CLIPPED_AREA_MM2)
