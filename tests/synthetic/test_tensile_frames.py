"""The renderer: the camera and its inverse, places in the picture, holes, truth."""

from __future__ import annotations

import numpy as np
import pytest

from kiribench.synthetic.tensile_camera import Camera
from kiribench.synthetic.tensile_folder import true_stretches
from kiribench.synthetic.tensile_frames import Look, SheetMotion, render
from kiribench.synthetic.tensile_pattern import Dots, Plain, Speckle

QUIET = Look(blur_px=0.0, noise=0.0, samples=4, background=0.0)


def test_the_camera_and_its_inverse() -> None:
    camera = Camera(
        400, 300, 8.0, (10.0, 20.0), 900.0, tilt_deg=(8.0, -5.0), roll_deg=3.0, k1=-0.2, k2=0.05
    )
    points = np.random.default_rng(0).uniform([-10, 5], [30, 35], (40, 2))
    np.testing.assert_allclose(camera.plane(camera.project(points)), points, atol=1e-9)


def test_an_upright_camera_is_a_scale() -> None:
    camera = Camera(101, 81, 4.0, (10.0, 20.0))
    np.testing.assert_allclose(
        camera.project(np.array([[10.0, 20.0], [11.0, 22.0]])), [[50, 40], [54, 48]], atol=1e-9
    )


def test_a_dot_is_where_the_motion_puts_it() -> None:
    camera = Camera(200, 160, 8.0, (10.0, 10.0))

    def move(points: np.ndarray) -> np.ndarray:
        return points * [0.95, 1.1] + [0.3, -0.7]

    motion = SheetMotion.of_map(move, (-5.0, -5.0), (25.0, 25.0), 1.0)
    dot = np.array([[9.3, 10.4]])
    levels = render(camera, motion, Dots(dot, 1.0), QUIET, seed=0).astype(float)
    weight = 0.8 * 255 - levels
    y, x = np.mgrid[0:160, 0:200]
    centroid = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
    np.testing.assert_allclose(centroid, camera.project(move(dot))[0], atol=0.02)
    np.testing.assert_allclose(motion.follow(dot), move(dot), atol=1e-12)


def test_where_there_is_no_sheet_the_background_is_seen() -> None:
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    motion = SheetMotion(square, square, np.array([[0, 1, 2], [0, 2, 3]]))
    levels = render(Camera(200, 200, 8.0, (10.0, 5.0)), motion, Plain(0.6), QUIET, seed=0)
    # The sheet's right edge, x = 10 mm, is the middle of the picture.
    assert (levels[70:130, 30:95] == 153).all()
    assert (levels[70:130, 105:190] == 0).all()
    with pytest.raises(ValueError, match="not on the sheet"):
        motion.follow(np.array([[11.0, 5.0]]))


def test_light_noise_and_seed() -> None:
    square = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
    motion = SheetMotion(square, square, np.array([[0, 1, 2], [0, 2, 3]]))
    camera = Camera(120, 100, 8.0)
    look = Look(blur_px=0.0, noise=4.0, slope=(0.4, 0.0))
    one, two, other = (
        render(camera, motion, Plain(0.5), look, seed=seed).astype(float) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, two)
    assert (one - other).std() == pytest.approx(4 * np.sqrt(2), rel=0.03)
    assert one[:, -20:].mean() / one[:, :20].mean() == pytest.approx(1.2 / 0.8, rel=0.1)


def test_true_stretches_are_means_of_opposite_edges() -> None:
    rest = np.stack(np.meshgrid(np.arange(3.0), np.arange(2.0)), -1)
    now = rest * [0.9, 1.4]
    along, across = true_stretches(np.array([rest, now]))
    np.testing.assert_allclose(along, [[[1, 1]], [[1.4, 1.4]]])
    np.testing.assert_allclose(across, [[[1, 1]], [[0.9, 0.9]]])


def test_speckle_has_its_grain() -> None:
    pattern = Speckle.over((0.0, 0.0), (30.0, 30.0), grain_mm=0.6, seed=1)
    x = np.linspace(2, 28, 4000)
    value = pattern.shade(np.column_stack([x, np.full_like(x, 15.0)]))
    value = value - value.mean()
    step = x[1] - x[0]
    correlation = [float(np.mean(value * np.roll(value, k))) / value.var() for k in range(200)]
    half = step * int(np.argmax(np.array(correlation) < 0.5))
    assert 0.15 < half < 0.45  # a grain of .6 mm: its half width at half maximum
