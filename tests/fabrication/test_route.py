"""The order of work: complete, repeatable, and short by an independent measure."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from patch_cases import random_design, uniform_design
from tolerances import TRAVEL_RATIO
from tour_oracle import shortest_tour

from kiribench.fabrication.route import in_order, shortest_route, travel_mm
from kiribench.fabrication.slits import beam_paths
from kiribench.fabrication.strokes import circle, polyline
from kiribench.lattice import CutMap


def _ends(design) -> np.ndarray:
    slits = beam_paths(CutMap(design.a, design.b, design.cell_mm), 0.15)
    return np.stack([slits.start_mm, slits.end_mm], axis=1)


def _walk(ends: np.ndarray, order, turned) -> float:
    at, total = np.zeros(2), 0.0
    for k, back in zip(order, turned, strict=True):
        first, last = ends[k][::-1] if back else ends[k]
        total += float(np.hypot(*(first - at)))
        at = last
    return total


@pytest.mark.parametrize("seed", range(6))
def test_few_strokes_are_ordered_as_by_trying_all_orders(seed):
    ends = np.random.default_rng(seed).uniform(0, 50, (5, 2, 2))
    best = min(
        _walk(ends, order, turned)
        for order in itertools.permutations(range(5))
        for turned in itertools.product((False, True), repeat=5)
    )
    assert shortest_route(ends, (0.0, 0.0)).travel_mm <= 1.02 * best


@pytest.mark.parametrize(
    "design", [uniform_design(0.8, 0.7), random_design(1), uniform_design(0.9, 0.9)]
)
def test_every_stroke_once_and_the_stated_travel_is_the_walked_one(design):
    ends = _ends(design)
    route = shortest_route(ends, (0.0, 0.0))
    assert sorted(route.order.tolist()) == list(range(287))
    assert route.travel_mm == pytest.approx(_walk(ends, route.order, route.turned), rel=1e-12)
    again = shortest_route(ends, (0.0, 0.0))
    assert np.array_equal(route.order, again.order)
    assert np.array_equal(route.turned, again.turned)


@pytest.mark.parametrize("seed", [0, 1])
def test_travel_of_a_small_patch_against_the_proved_optimum(seed):
    ends = _ends(random_design(seed, 4, 3))
    optimum = shortest_tour(ends, np.zeros(2), seconds=20)
    assert optimum.bound_mm > 0
    assert shortest_route(ends, (0.0, 0.0)).travel_mm <= TRAVEL_RATIO * optimum.bound_mm


def test_the_oracle_agrees_with_trying_all_orders():
    ends = np.random.default_rng(3).uniform(0, 50, (5, 2, 2))
    best = min(
        _walk(ends, order, turned)
        for order in itertools.permutations(range(5))
        for turned in itertools.product((False, True), repeat=5)
    )
    tour = shortest_tour(ends, np.zeros(2))
    assert tour.length_mm == pytest.approx(best, abs=1e-6)
    assert tour.bound_mm <= best + 1e-6


def test_strokes_are_turned_and_circles_begun_nearby():
    strokes = [polyline("slit", [(20, 0), (10, 0)]), circle("slot", (30.0, 0.0), 5.0)]
    done = in_order(strokes, np.zeros(2))
    assert done[0].points_mm[0].tolist() == [10, 0]
    assert done[1].points_mm[0] == pytest.approx([25, 0])
    assert travel_mm(done, (0.0, 0.0)) == pytest.approx(15.0)
    assert in_order([], np.zeros(2)) == []
    assert shortest_route(np.zeros((0, 2, 2)), (0.0, 0.0)).travel_mm == 0
