"""The cross-cut lattice against counts, geometry and shapely."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, box
from tolerances import LATTICE_LENGTH_MM

from kiribench.errors import DataError
from kiribench.lattice import CutMap, draw_svg, longest_cut


def _random(rows: int, columns: int, seed: int, cell_mm: float = 15.0) -> CutMap:
    rng = np.random.default_rng(seed)
    return CutMap(
        rng.uniform(0.05, 0.95, (rows, columns)),
        rng.uniform(0.05, 0.95, (rows, columns)),
        cell_mm,
    )


def _lines(cut_map: CutMap) -> list[LineString]:
    cuts = cut_map.half_cuts().cuts()
    return [LineString(ends) for ends in zip(cuts.start_mm, cuts.end_mm, strict=True)]


def test_knee_patch_has_287_cuts_with_notches_and_none_on_the_outline() -> None:
    cut_map = CutMap.uniform(0.8, 0.7, 12, 6, 15.0)
    halves = cut_map.half_cuts()
    cuts = halves.cuts()
    assert len(cuts) == 287
    width, length = cut_map.size_mm
    assert (width, length) == (90.0, 180.0)
    outline = box(0, 0, width, length).exterior
    touching = [line for line in _lines(cut_map) if line.distance(outline) < LATTICE_LENGTH_MM]
    # Notches: 11 corner sites on either long edge, 6 mid-edge sites on either short one.
    assert len(touching) == 2 * 11 + 2 * 6
    for line in touching:
        assert line.intersection(outline).length < LATTICE_LENGTH_MM
    assert np.all(halves.tip_mm > -LATTICE_LENGTH_MM)
    assert np.all(halves.tip_mm < np.array([width, length]) + LATTICE_LENGTH_MM)


def test_directions_follow_the_parity_of_the_site() -> None:
    halves = _random(3, 4, 0).half_cuts()
    even = halves.site.sum(axis=1) % 2 == 0
    assert np.all(np.abs(halves.direction[even, 0]) == 1)
    assert np.all(np.abs(halves.direction[~even, 1]) == 1)
    np.testing.assert_allclose(np.linalg.norm(halves.direction, axis=1), 1)


def test_averaging_and_skewing_cell_by_cell() -> None:
    a = np.array([[0.2, 0.4], [0.6, 0.8]])
    b = np.array([[0.1, 0.3], [0.5, 0.7]])
    half = CutMap(a, b, 10.0).half_fractions()
    assert half[1, 1].tolist() == [0.2, 0.2]  # centre of cell (0, 0): its own a
    np.testing.assert_allclose(half[2, 2], [0.4, 0.6])  # corner: left pair, right pair
    np.testing.assert_allclose(half[1, 2], [0.2, 0.2])  # upright edge: mean b of row 0
    np.testing.assert_allclose(half[2, 1], [0.1, 0.5])  # level edge: each half its own cell
    np.testing.assert_allclose(half[2, 0], [0.0, 0.4])  # notch at the lateral edge
    np.testing.assert_allclose(half[0, 3], [0.0, 0.3])  # notch at the proximal edge
    assert half[0, 2].sum() == half[0, 0].sum() == half[1, 0].sum() == 0  # outline


def test_half_cuts_are_linear_in_the_map() -> None:
    one, two = _random(4, 3, 1), _random(4, 3, 2)
    mixed = CutMap(0.3 * one.a + 0.7 * two.a, 0.3 * one.b + 0.7 * two.b, 15.0)
    np.testing.assert_allclose(
        mixed.half_fractions(), 0.3 * one.half_fractions() + 0.7 * two.half_fractions(), atol=1e-15
    )


def test_total_length_of_a_uniform_map() -> None:
    a, b, rows, columns, cell = 0.6, 0.4, 5, 4, 10.0
    total = CutMap.uniform(a, b, rows, columns, cell).half_cuts().cuts().length_mm.sum()
    across = rows * columns + (rows - 1) * columns  # centres; corners, notches making up a row
    along = rows * (columns - 1) + rows * columns  # upright edges; level edges with notches
    assert total == pytest.approx(cell * (a * across + b * along), abs=LATTICE_LENGTH_MM)


@settings(max_examples=25, deadline=None)
@given(a=st.floats(0.05, 0.97), b=st.floats(0.05, 0.97), cell=st.sampled_from([6.0, 10.0, 15.0]))
def test_minimum_gap_is_shapelys_for_uniform_maps(a: float, b: float, cell: float) -> None:
    cut_map = CutMap.uniform(a, b, 3, 3, cell)
    lines = _lines(cut_map)
    gap = min(one.distance(two) for i, one in enumerate(lines) for two in lines[i + 1 :])
    assert cut_map.minimum_gap_mm == pytest.approx(gap, abs=LATTICE_LENGTH_MM)


@pytest.mark.parametrize("seed", range(6))
def test_minimum_gap_is_shapelys_for_heterogeneous_maps(seed: int) -> None:
    cut_map = _random(4, 3, seed)
    width, length = cut_map.size_mm
    outline = box(0, 0, width, length).exterior
    lines = _lines(cut_map)
    gaps = [one.distance(two) for i, one in enumerate(lines) for two in lines[i + 1 :]]
    gaps += [line.distance(outline) for line in lines if line.distance(outline) > 1e-9]
    assert cut_map.minimum_gap_mm == pytest.approx(min(gaps), abs=LATTICE_LENGTH_MM)


def test_feasibility_is_the_closed_form_of_the_longest_cut() -> None:
    cell, ligament, kerf = 15.0, 0.6, 0.2
    longest = longest_cut(cell, ligament, kerf)
    assert longest == pytest.approx(1 - (2 * ligament + kerf) / cell)
    assert CutMap.uniform(longest, longest, 2, 2, cell).feasible(ligament, kerf)
    assert not CutMap.uniform(longest + 1e-6, 0.1, 2, 2, cell).feasible(ligament, kerf)
    assert longest_cut(1.0, 0.6) == 0.0


def test_facets_walk_from_the_site_that_cuts_along_each_edge() -> None:
    cut_map = _random(2, 3, 5)
    half = cut_map.half_fractions()
    facets, mirrored = cut_map.facet_half_cuts()
    assert facets.shape == (4, 6, 4)
    assert not mirrored[0, 0]
    assert mirrored[0, 1]
    # Facet (1, 1), even: bottom from site (1, 1) to larger x, right from (2, 1) to larger y.
    assert facets[1, 1].tolist() == [half[1, 1, 1], half[1, 2, 1], half[2, 2, 0], half[2, 1, 0]]
    # Facet (1, 2), odd: bottom from site (3, 1) to smaller x, then the left edge from (2, 1).
    assert facets[1, 2].tolist() == [half[1, 3, 0], half[1, 2, 1], half[2, 2, 1], half[2, 3, 0]]


def test_facets_on_both_sides_of_a_half_cut_agree() -> None:
    facets, mirrored = _random(3, 3, 6).facet_half_cuts()
    for i in range(6):
        for j in range(5):
            one = facets[i, j, 3 if mirrored[i, j] else 1]
            two = facets[i, j + 1, 1 if mirrored[i, j + 1] else 3]
            assert one == two
    for i in range(5):
        for j in range(6):
            assert facets[i, j, 2] == facets[i + 1, j, 0]


def test_svg_is_millimetres_and_has_every_cut() -> None:
    cut_map = CutMap.uniform(0.8, 0.7, 12, 6, 15.0)
    text = draw_svg(cut_map)
    assert 'width="94mm" height="184mm" viewBox="-2 -2 94 184"' in text
    numbers = re.findall(r"M([-\d.]+) ([-\d.]+)L([-\d.]+) ([-\d.]+)", text)
    assert len(numbers) == 287
    ends = np.array(numbers, dtype=float).reshape(-1, 2, 2)
    drawn = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
    assert drawn == pytest.approx(cut_map.half_cuts().cuts().length_mm.sum(), rel=1e-3)


@pytest.mark.parametrize(
    ("a", "b", "code"),
    [
        (np.full((2, 2), 35.0), np.full((2, 2), 0.5), "cut-length-range"),
        (np.full((2, 2), np.nan), np.full((2, 2), 0.5), "cut-length-range"),
        (np.full((2, 2), 0.5), np.full((2, 3), 0.5), "cut-map-shape"),
        (np.empty((0, 2)), np.empty((0, 2)), "cut-map-shape"),
    ],
)
def test_wrong_maps_are_refused_by_name(a: np.ndarray, b: np.ndarray, code: str) -> None:
    with pytest.raises(DataError) as caught:
        CutMap(a, b, 15.0)
    assert caught.value.code == code


def test_a_map_keeps_its_own_copy() -> None:
    a = np.full((2, 2), 0.5)
    cut_map = CutMap(a, a, 15.0)
    a[0, 0] = 0.9
    assert cut_map.a[0, 0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        cut_map.a[0, 0] = 0.1
