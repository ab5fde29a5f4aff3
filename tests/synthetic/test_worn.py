"""The worn patch: its place, its inverse, its height, and the motion between the scans."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tolerances import ROUNDING

from kiribench.errors import NotConvergedError
from kiribench.schema.layout import Layout
from kiribench.synthetic.knees import STORED, random_knee
from kiribench.synthetic.subject import patch_nodes
from kiribench.synthetic.worn import FLANK_MM, RIM_MM, PatchRelief, random_motion

KNEES = [*STORED.values(), *(random_knee(index, 5) for index in range(1, 7))]
UNDER = patch_nodes(Layout.of())
AWAY = np.array([15.0, -30.0])


@pytest.mark.parametrize("knee", KNEES, ids=lambda knee: knee.label)
def test_patch_point_inverts_on_skin_over_the_whole_skin(knee: object) -> None:
    mismatch = knee.mismatch  # type: ignore[attr-defined]
    q = np.random.default_rng(1).uniform(-1, 1, (500, 2)) * [116.0, 146.0]
    np.testing.assert_allclose(mismatch.on_skin(mismatch.patch_point(q)), q, atol=1e-9)


def test_a_patch_that_folds_is_refused() -> None:
    folding = replace(STORED["S1"].mismatch, edge_lateral_mm=40.0)
    with pytest.raises(NotConvergedError, match="patch-folds"):
        folding.patch_point(np.random.default_rng(1).uniform(-60, 60, (500, 2)))


def test_shift_stretch_and_shear_are_what_they_say() -> None:
    still = {name: 0.0 for name in vars(STORED["S1"].mismatch) if name.endswith("_mm")}
    still |= {"half_width_mm": 45.0, "half_length_mm": 90.0, "wave_length_mm": 80.0}
    plain = replace(
        STORED["S1"].mismatch, **still, stretch_lateral=0.0, stretch_longitudinal=0.0, shear=0.0
    )
    p = np.array([[30.0, -60.0], [-15.0, 45.0]])
    np.testing.assert_allclose(plain.on_skin(p), p, atol=ROUNDING)
    shifted = replace(plain, shift_lateral_mm=2.0, shift_longitudinal_mm=-1.0)
    np.testing.assert_allclose(shifted.field_mm(p), [[2.0, -1.0]] * 2, atol=ROUNDING)
    stretched = replace(plain, stretch_lateral=0.1, stretch_longitudinal=-0.2)
    np.testing.assert_allclose(stretched.field_mm(p), p * [0.1, -0.2], atol=ROUNDING)
    sheared = replace(plain, shear=0.05)
    np.testing.assert_allclose(sheared.field_mm(p)[:, 0], 0.05 * p[:, 1], atol=ROUNDING)


def test_the_top_is_level_over_all_corners_and_the_skin_bare_elsewhere() -> None:
    relief = PatchRelief.of(STORED["S2"].mismatch, UNDER, 2.0)
    corners = relief.on_skin(UNDER)
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 16)])
    # Also around each corner, so that the scan's triangles there are all on top.
    around = corners[..., None, :] + 3.2 * ring
    assert (relief.height_mm(corners) == 2.0).all()
    assert (relief.height_mm(around) == 2.0).all()
    half = relief.half_mm + RIM_MM + FLANK_MM + 1e-6
    border = np.array([[half[0], 0.0], [-half[0], 50.0], [0.0, half[1]], [20.0, -half[1]]])
    assert (relief.height_mm(relief.on_skin(border)) == 0.0).all()
    flank = np.array([[half[0] - 0.5 * FLANK_MM, 0.0]])
    assert relief.height_mm(relief.on_skin(flank))[0] == pytest.approx(1.0, abs=1e-5)


def test_a_patch_off_the_grids_centre_moves_with_its_offset() -> None:
    moved = PatchRelief.of(STORED["S1"].mismatch, UNDER + AWAY, 2.0)
    still = PatchRelief.of(STORED["S1"].mismatch, UNDER, 2.0)
    np.testing.assert_allclose(moved.on_skin(UNDER + AWAY), still.on_skin(UNDER) + AWAY)


def test_the_motion_is_rigid_of_8_degrees_and_20_mm() -> None:
    motion = random_motion(np.random.default_rng(3))
    np.testing.assert_allclose(motion.rotation @ motion.rotation.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(motion.rotation) == pytest.approx(1.0)
    assert np.degrees(np.arccos((np.trace(motion.rotation) - 1) / 2)) == pytest.approx(8.0)
    assert np.linalg.norm(motion.apply(np.zeros(3))) == pytest.approx(20.0)
