"""The patches and the search on them: closed forms, and what lies between the grid's points."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.design.box_newton import box_step, minimise_in_box
from kiribench.design.patch_search import rough_ends, rough_extremes
from kiribench.design.patchwork import Patchwork, patch_jet
from kiribench.design.reachable import axis
from kiribench.design.response import Jet

TICKS = axis(0.9)
A, B = np.meshgrid(TICKS, TICKS, indexing="ij")


def test_patches_reproduce_cubics_with_all_derivatives() -> None:
    # Hermite patches with five-point slopes are exact for a^3 b^3 and everything below.
    patches = Patchwork.of(TICKS, (A**3 * B**3 - 2 * A * B**2 + B)[None])
    for x, y in ((0.0, 0.0), (0.9, 0.9), (0.013, 0.887), (0.45, 0.3), (0.889, 0.005)):
        expected = (
            x**3 * y**3 - 2 * x * y**2 + y,
            3 * x**2 * y**3 - 2 * y**2,
            3 * x**3 * y**2 - 4 * x * y + 1,
            6 * x * y**3,
            9 * x**2 * y**2 - 4 * y,
            6 * x**3 * y - 4 * x,
        )
        got = patch_jet(patches.nodes[0], patches.step, x, y)
        np.testing.assert_allclose(got, expected, atol=1e-10)


def test_patches_err_by_the_fourth_power_of_the_step() -> None:
    errors = []
    for count in (24, 47):
        ticks = np.linspace(0.0, 0.9, count)
        a, b = np.meshgrid(ticks, ticks, indexing="ij")
        patches = Patchwork.of(ticks, np.sin(6 * a + 4 * b)[None])
        points = np.random.default_rng(0).uniform(0.0, 0.9, (400, 2))
        values = [patch_jet(patches.nodes[0], patches.step, x, y)[0] for x, y in points]
        errors.append(np.abs(values - np.sin(points @ [6.0, 4.0])).max())
    assert 12 < errors[0] / errors[1] < 40  # 2^4 inside, 2^5 where one-sided stencils dominate


def test_the_step_in_the_box_is_newtons_where_the_curvature_is_positive() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        root = rng.normal(size=(2, 2))
        h = root @ root.T + 0.1 * np.eye(2)
        g = rng.normal(size=2)
        dx, dy, pull = box_step(0.4, 0.4, g[0], g[1], h[0, 0], h[0, 1], h[1, 1], 0.9)
        np.testing.assert_allclose([dx, dy], -np.linalg.solve(h, g), rtol=1e-9)
        assert pull == np.abs(g).max()
        # A saddle's negative curvature counts as positive: still downhill, of the right length.
        values, vectors = np.linalg.eigh(h)
        values[0] *= -1
        saddle = vectors @ np.diag(values) @ vectors.T
        dx, dy, _ = box_step(0.4, 0.4, g[0], g[1], saddle[0, 0], saddle[0, 1], saddle[1, 1], 0.9)
        np.testing.assert_allclose([dx, dy], -np.linalg.solve(h, g), rtol=1e-9)
    assert box_step(0.0, 0.9, 1.0, -1.0, 1.0, 0.0, 1.0, 0.9) == (0.0, 0.0, 0.0)
    assert box_step(0.0, 0.5, 1.0, 2.0, 1.0, 0.3, 4.0, 0.9) == (0.0, -0.5, 2.0)


def test_minima_of_quadratics_within_the_box() -> None:
    centre = np.array([[0.3, 0.4], [-0.2, 0.5], [1.2, 1.3]])
    h = np.array([[2.0, 0.6], [0.6, 1.0]])

    def objective(x: np.ndarray, which: np.ndarray) -> Jet:
        d = x - centre[which]
        return Jet(
            0.5 * np.einsum("ki,ij,kj->k", d, h, d), d @ h, np.broadcast_to(h, (len(x), 2, 2))
        )

    found = minimise_in_box(objective, np.full((3, 2), 0.45), 0.9)
    # Held at a = 0, b moves by .6 (-.2 - 0) / 1; beyond the far corner both are held.
    np.testing.assert_allclose(found, [[0.3, 0.4], [0.0, 0.38], [0.9, 0.9]], atol=1e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_island_between_the_grids_points_is_found(sign: float) -> None:
    # A peak of 1 half-way between points of the grid, where it is .98; the level is .99.
    centre = np.array([10.5, 13.5]) * TICKS[1]
    width = TICKS[1] * np.sqrt(0.5) / np.sqrt(-2 * np.log(0.98))
    peak = sign * np.exp(-0.5 * ((A - centre[0]) ** 2 + (B - centre[1]) ** 2) / width**2)
    patches = Patchwork.of(TICKS, peak[None])
    assert np.abs(peak).max() < 0.985
    ends, cell, _, _ = rough_ends(patches, np.array([sign * 0.99]), np.array([sign]))
    radius = width * np.sqrt(-2 * np.log(0.99))
    assert cell.tolist() == [0]
    np.testing.assert_allclose(ends[0], centre * (1 - radius / np.hypot(*centre)), atol=1e-3)
    points, _, which = rough_extremes(patches)
    np.testing.assert_allclose(points[which == -sign][0], centre, atol=1e-3)


def test_a_tongue_between_the_grids_lines_is_followed_to_its_tip() -> None:
    # A ridge that rises with b along a line half-way between two of the grid.
    ridge = 0.2 * B + 0.02 * np.exp(-0.5 * ((A / TICKS[1] - 5.5) / 0.6) ** 2)
    patches = Patchwork.of(TICKS, ridge[None])
    level = 0.2 * 0.5 + 0.02
    shown = ridge >= level
    ends, _, _, _ = rough_ends(patches, np.array([level]), np.array([1.0]))
    nearest = np.hypot(*ends.T).min()
    fine = np.linspace(0.0, 0.9, 901)
    best = np.inf
    for x in fine:
        for y in fine[(np.hypot(x, fine) < nearest)]:
            if patch_jet(patches.nodes[0], patches.step, x, y)[0] >= level:
                best = min(best, np.hypot(x, y))
    assert nearest <= best + 1e-6
    assert nearest < np.hypot(A, B)[shown].min() - 0.01


def test_extremes_so_close_to_the_level_that_patches_cannot_tell_are_handed_on() -> None:
    hill = np.exp(-0.5 * ((A - 0.61) ** 2 + (B - 0.43) ** 2) / 0.2**2)
    patches = Patchwork.of(TICKS, hill[None])
    _, _, peaks, cell = rough_ends(patches, np.array([1.0 + 1e-5]), np.array([1.0]))
    assert cell.tolist() == [0]
    np.testing.assert_allclose(peaks[0], [0.61, 0.43], atol=1e-4)
    ends, _, peaks, _ = rough_ends(patches, np.array([1.01]), np.array([1.0]))
    assert len(ends) == len(peaks) == 0


def test_a_flat_response_has_one_extreme_of_each_kind_and_no_end() -> None:
    patches = Patchwork.of(TICKS, np.full((1, *A.shape), 0.3))
    points, _, sign = rough_extremes(patches)
    assert sorted(sign) == [-1.0, 1.0] and len(points) == 2
    ends, _, peaks, _ = rough_ends(patches, np.array([0.4]), np.array([1.0]))
    assert len(ends) == len(peaks) == 0


def test_an_extreme_between_low_nodes_is_found_beside_a_higher_node() -> None:
    count, step, slope = 9, 0.1, 0.2
    nodes = np.zeros((1, count, count, 4))
    nodes[0, 1, 1, 0] = 0.05  # a bump on the grid, by more than the search about nodes allows
    # A square whose nodes are at 0 and rise inward: Hermite's cubics reach slope / 4 along each
    # axis in the middle, slope / 2 together, and nothing on the grid shows it.
    nodes[0, 5, 5:7, 1] = nodes[0, 5:7, 5, 2] = slope
    nodes[0, 6, 5:7, 1] = nodes[0, 5:7, 6, 2] = -slope
    points, _, sign = rough_extremes(Patchwork(step * np.arange(count), nodes))
    highest = points[sign < 0]
    np.testing.assert_allclose(highest, [[0.55, 0.55]], atol=1e-6)
