"""Subset matching against pictures that are known as formulas."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import TENSILE_SUBSET_PX

from kiribench.tensile.icgn import DIVERGED, FLAT, FOUND, OUTSIDE, make_templates, match

SIDE = 140


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A pattern with no two places alike, smooth on the scale of a pixel."""
    return 120 + 30 * (
        np.sin(0.9 * x + 0.3 * y)
        + np.sin(0.31 * x - 0.83 * y + 1)
        + np.sin(0.17 * x + 0.57 * y + 0.002 * x * y)
    )


def picture(warp: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """The pattern moved by an affine map about a centre: every pixel asks where it came from."""
    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(np.float64)
    turn = np.linalg.inv(np.eye(2) + warp[2:].reshape(2, 2))
    dx, dy = x - centre[0] - warp[0], y - centre[1] - warp[1]
    back_x = centre[0] + turn[0, 0] * dx + turn[0, 1] * dy
    back_y = centre[1] + turn[1, 0] * dx + turn[1, 1] * dy
    return waves(back_x, back_y).astype(np.float32)


def square(half: int) -> np.ndarray:
    step = np.arange(-half, half + 1.0)
    return np.stack(np.meshgrid(step, step), -1).reshape(1, -1, 2)


CENTRE = np.array([[70.0, 66.0]])
STILL = np.zeros((1, 6))


@pytest.mark.parametrize(
    "warp",
    [
        [0, 0, 0, 0, 0, 0],
        [0.37, -0.61, 0, 0, 0, 0],
        [1.2, 0.8, 0.05, -0.02, 0.03, -0.04],
        [-2.5, 1.5, -0.15, 0.1, -0.1, 0.3],
    ],
)
def test_an_affine_motion_is_found(warp: list[float]) -> None:
    true = np.array(warp, dtype=np.float64)
    reference = picture(np.zeros(6), CENTRE[0])
    templates = make_templates(reference, CENTRE, square(12), STILL)
    matches = match(picture(true, CENTRE[0]), templates, STILL)
    assert matches.code[0] == FOUND
    assert matches.zncc[0] > 0.9999
    np.testing.assert_allclose(matches.warp[0, :2], true[:2], atol=TENSILE_SUBSET_PX)
    np.testing.assert_allclose(matches.warp[0, 2:], true[2:], atol=TENSILE_SUBSET_PX / 6)


def test_gain_and_offset_of_the_light_do_not_move_a_subset() -> None:
    true = np.array([0.4, 0.3, 0.02, 0, 0, -0.03])
    reference = picture(np.zeros(6), CENTRE[0])
    templates = make_templates(reference, CENTRE, square(12), STILL)
    plain = match(picture(true, CENTRE[0]), templates, STILL)
    lit = match(0.6 * picture(true, CENTRE[0]) + 40, templates, STILL)
    np.testing.assert_allclose(lit.warp, plain.warp, atol=2e-4)


def test_a_template_read_from_a_moved_picture_measures_from_the_first_one() -> None:
    one = np.array([1.3, -0.7, 0.1, 0.03, -0.02, 0.05])
    two = np.array([2.1, -1.2, 0.16, 0.05, -0.04, 0.09])
    looks = make_templates(picture(one, CENTRE[0]), CENTRE, square(12), one[None])
    matches = match(picture(two, CENTRE[0]), looks, one[None])
    np.testing.assert_allclose(matches.warp[0, :2], two[:2], atol=TENSILE_SUBSET_PX)


def test_the_stated_noise_is_the_scatter() -> None:
    rng = np.random.default_rng(4)
    clean = picture(np.zeros(6), CENTRE[0])
    count = 150
    first = (clean + rng.normal(0, 4, clean.shape)).astype(np.float32)
    templates = make_templates(first, CENTRE, square(9), STILL)
    errors, stated = [], []
    for _ in range(count):
        found = match((clean + rng.normal(0, 4, clean.shape)).astype(np.float32), templates, STILL)
        errors.append(found.warp[0, :2])
        stated.append(found.sd_px[0])
    # The first picture's own noise is common to all: only the others' half is seen to scatter.
    scatter = np.sqrt(2) * np.std(errors, axis=0, ddof=1)
    np.testing.assert_allclose(np.mean(stated, axis=0), scatter, rtol=0.25)


def test_what_cannot_be_found_is_said() -> None:
    reference = picture(np.zeros(6), CENTRE[0])
    templates = make_templates(reference, CENTRE, square(12), STILL)
    far = np.array([[80.0, 0, 0, 0, 0, 0]])
    assert match(reference, templates, far, reach_px=200).code[0] == OUTSIDE
    noise = np.random.default_rng(1).normal(120, 30, reference.shape).astype(np.float32)
    lost = match(noise, templates, STILL)
    assert lost.code[0] == DIVERGED or lost.zncc[0] < 0.5
    plain = np.full_like(reference, 90.0)
    blank = make_templates(plain, CENTRE, square(12), STILL)
    assert not blank.good[0]
    assert match(reference, blank, STILL).code[0] == FLAT
    rim = make_templates(reference, np.array([[5.0, 70.0]]), square(12), STILL)
    assert not rim.good[0]
