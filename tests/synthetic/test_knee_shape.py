"""The surfaces are knees: two limbs at the flexion angle, a patella, two mirrored sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kiribench.synthetic.knees import STORED, random_knee
from kiribench.synthetic.skin import Build

U = np.linspace(-116.0, 116.0, 59)
V = np.linspace(-146.0, 146.0, 74)
Q = np.stack(np.meshgrid(U, V), axis=-1)


def _builds() -> list[Build]:
    return [knee.build for knee in STORED.values()] + [
        random_knee(index, 7).build for index in range(1, 9)
    ]


@pytest.mark.parametrize("build", _builds())
def test_surfaces_are_regular_and_not_inside_out(build: Build) -> None:
    for surface in (build.reference(), build.flexed()):
        assert surface.area_density(Q).min() > 0.4
        # Outwards is away from the sagittal plane on the flanks, and anterior in front.
        normals = surface.normals(Q)
        lateral = -1.0 if build.side == "right" else 1.0
        assert (normals[:, 4, 0] * lateral > 0.5).all()
        assert (normals[60:, 29, 1] < -0.8).all()


@pytest.mark.parametrize("name", STORED)
def test_thigh_and_shank_make_the_flexion_angle(name: str) -> None:
    for surface, flexion in (
        (STORED[name].build.reference(), 0.0),
        (STORED[name].build.flexed(), 90.0),
    ):
        # Directions of the flank lines at their ends, where the taper acts the same on both.
        flank = surface.points_mm(np.array([[85.0, v] for v in (-140.0, -125.0, 125.0, 140.0)]))
        thigh, shank = flank[0] - flank[1], flank[3] - flank[2]
        cosine = thigh @ shank / np.linalg.norm(thigh) / np.linalg.norm(shank)
        assert 180.0 - np.degrees(np.arccos(cosine)) == pytest.approx(flexion, abs=8.0)


@pytest.mark.parametrize("name", STORED)
def test_the_patella_stands_out_at_rest_and_lies_at_the_bend(name: str) -> None:
    build = STORED[name].build
    column = np.stack([np.zeros(200), np.linspace(-120, 120, 200)], axis=-1)
    front = build.reference().points_mm(column)
    line = np.polyval(np.polyfit(front[[0, -1], 2], front[[0, -1], 1], 1), front[:, 2])
    proud = line - front[:, 1]  # anterior is -y
    peak = proud.argmax()
    assert abs(column[peak, 1]) < 20.0 and proud[peak] > 2.0
    # At 90 degrees the front turns most there.
    bent = build.flexed().points_mm(column)
    tangent = np.diff(bent, axis=0)
    angle = np.degrees(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 2])))
    middle = np.abs(0.5 * (column[1:, 1] + column[:-1, 1])) < 40.0
    assert np.abs(np.ptp(angle)) > 70.0
    assert np.abs(angle[middle][-1] - angle[middle][0]) > 0.7 * np.abs(angle[-1] - angle[0])


def test_a_left_knee_is_the_mirror_image_of_a_right_one() -> None:
    right = STORED["S1"].build
    left = replace(right, side="left")
    for pose in ("reference", "flexed"):
        a, b = getattr(right, pose)(), getattr(left, pose)()
        np.testing.assert_array_equal(a.points_mm(Q) * [-1.0, 1.0, 1.0], b.points_mm(Q))
        np.testing.assert_allclose(a.normals(Q) * [-1.0, 1.0, 1.0], b.normals(Q), atol=1e-15)


def test_lateral_is_the_subjects_outside_and_proximal_is_up() -> None:
    for knee in STORED.values():
        surface = knee.build.reference()
        lateral, medial = surface.points_mm(np.array([[-80.0, 0.0], [80.0, 0.0]]))
        outward = -1.0 if knee.build.side == "right" else 1.0  # x points to the subject's left
        assert (lateral - medial)[0] * outward > 0
        proximal, distal = surface.points_mm(np.array([[0.0, -100.0], [0.0, 100.0]]))
        assert proximal[2] > distal[2]


def test_random_knees_repeat_and_differ() -> None:
    assert random_knee(3, 1) == random_knee(3, 1)
    assert random_knee(3, 1).build != random_knee(4, 1).build
    assert random_knee(3, 1).build != random_knee(3, 2).build
    assert {random_knee(i, 0).build.side for i in range(1, 12)} == {"left", "right"}
