"""The beam's paths: counts and lengths in closed form, the kerf by shapely."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from patch_cases import random_design
from shapely import LineString, box
from tolerances import STROKE_ROUNDING_MM

from kiribench.fabrication.slits import SHORTEST_PATH_MM, beam_paths
from kiribench.lattice import CutMap


def test_knee_patch_has_287_paths_34_of_them_notches():
    slits = beam_paths(CutMap.uniform(0.8, 0.7, 12, 6, 15.0), 0.2)
    assert (len(slits), int(slits.notch.sum()), len(slits.left_out)) == (287, 34, 0)


@settings(max_examples=30, deadline=None)
@given(
    rows=st.integers(1, 6),
    columns=st.integers(1, 5),
    a=st.floats(0.1, 0.9),
    b=st.floats(0.1, 0.9),
    kerf=st.floats(0.0, 0.3),
    cell=st.sampled_from([10.0, 15.0]),
)
def test_lengths_in_closed_form(rows, columns, a, b, kerf, cell):
    """Inner cuts lose k, notches k / 2, each counted from the lattice by hand."""
    slits = beam_paths(CutMap.uniform(a, b, rows, columns, cell), kerf)
    across_inner = rows * columns + (rows - 1) * (columns - 1)
    across_notch = 2 * (rows - 1)
    along_inner = rows * (columns - 1) + (rows - 1) * columns
    along_notch = 2 * columns
    assert len(slits) == across_inner + across_notch + along_inner + along_notch
    assert int(slits.notch.sum()) == across_notch + along_notch
    total = cell * (a * (across_inner + across_notch / 2) + b * (along_inner + along_notch / 2))
    total -= kerf * (across_inner + along_inner) + kerf / 2 * (across_notch + along_notch)
    assert slits.length_mm.sum() == pytest.approx(total, abs=STROKE_ROUNDING_MM * len(slits))


def test_one_cell_by_hand():
    """A cell of 10 mm, a = .6, b = .4, k = .2: one slit of 6 - .2 and two notches of 2 - .1."""
    slits = beam_paths(CutMap.uniform(0.6, 0.4, 1, 1, 10.0), 0.2)
    found = sorted(
        tuple(np.round(np.sort(np.stack([s, e]), axis=0).ravel(), 9))
        for s, e in zip(slits.start_mm, slits.end_mm, strict=True)
    )
    assert found == [(2.1, 5.0, 7.9, 5.0), (5.0, 0.0, 5.0, 1.9), (5.0, 8.1, 5.0, 10.0)]


@pytest.mark.parametrize("kerf", [0.05, 0.2, 0.4])
def test_what_the_beam_burns_ends_at_the_tips_of_the_design(kerf):
    """Buffered by k / 2 each path covers its cut and reaches no further along its line."""
    design = random_design(3, 5, 4)
    cut_map = CutMap(design.a, design.b, 15.0)
    slits = beam_paths(cut_map, kerf)
    whole = beam_paths(cut_map, 0.0)
    sheet = box(0, 0, *cut_map.size_mm)
    assert len(slits) == len(whole)
    for i in range(len(slits)):
        burnt = LineString([slits.start_mm[i], slits.end_mm[i]]).buffer(kerf / 2, quad_segs=64)
        inside = burnt.intersection(sheet)
        cut = LineString([whole.start_mm[i], whole.end_mm[i]])
        x0, y0, x1, y1 = inside.bounds
        assert max(x1 - x0, y1 - y0) == pytest.approx(cut.length, abs=STROKE_ROUNDING_MM)
        assert cut.buffer(1e-6).intersection(inside).bounds == pytest.approx(
            cut.buffer(1e-6).intersection(sheet).bounds, abs=2e-6
        )


def test_cuts_that_the_kerf_swallows_are_left_out_and_listed():
    cut_map = CutMap.uniform(0.02, 0.5, 3, 3, 10.0)  # across: .2 mm, notches .1 mm
    slits = beam_paths(cut_map, 0.15)
    assert SHORTEST_PATH_MM == 0.1
    assert len(slits.left_out) == 9 + 4 + 4
    assert len(beam_paths(CutMap.uniform(0, 0, 3, 3, 10.0), 0.15)) == 0
