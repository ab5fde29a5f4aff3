"""Predicted patches are scored as worn ones: against `conform` itself and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from elbow import elbow_root, elbow_skin
from small_limb import ELBOW
from tolerances import FAST_OVERLAP, SAME_ROUTE

from kiribench.conformability.score import ScoreOptions, score_subject
from kiribench.dataset import Dataset
from kiribench.errors import NodesError
from kiribench.reference.fast_overlap import FastOverlap
from kiribench.reference.predicted import flat_conformability, predicted_conformability

FEW = ScoreOptions(samples=100)


def test_the_worn_scan_of_a_patch_and_its_prediction_get_one_score() -> None:
    subject = Dataset.open(elbow_root()).subject("E1")
    worn = score_subject(subject, ScoreOptions(samples=100, registration="none"))
    corners = ELBOW.patch_nodes(stretch=0.97)  # where the dataset's worn patch lies
    found = predicted_conformability(elbow_skin(), corners, FEW)
    for name in ("overlap_paper", "overlap_strict", "overlap_iou"):
        assert getattr(found, name) == pytest.approx(getattr(worn, name), abs=SAME_ROUTE)
    assert np.array_equal(found.grade, worn.grade)
    assert np.array_equal(found.region, worn.region)
    assert found.frame.method == "predicted"
    assert found.node_sd_mm[1] == 0.0


def test_a_patch_on_its_nodes_is_perfect_and_a_shifted_one_is_not() -> None:
    skin = elbow_skin()
    perfect = predicted_conformability(skin, skin.places(skin.target_q_mm), FEW)
    assert perfect.overlap_iou.min() > 0.998
    assert set(perfect.grade.ravel()) == {"good"}
    shifted = skin.target_q_mm + np.array([0.0, 2.0])
    found = predicted_conformability(skin, skin.places(shifted), FEW)
    # 2 mm of 10 mm: four fifths are left, whatever the stretch of the skin.
    assert found.overlap_paper == pytest.approx(0.8, abs=0.01)
    assert set(found.causes.main.ravel()) == {"shift"}


def test_a_corner_off_the_scan_leaves_its_cells_without_a_score() -> None:
    skin = elbow_skin()
    corners = skin.places(skin.target_q_mm)
    corners[0, 0] += 50.0
    corners[2, 2] = np.nan
    found = predicted_conformability(skin, corners, FEW)
    lost = np.zeros(found.shape, dtype=bool)
    lost[0, 0] = lost[1:3, 1:3] = True
    assert np.array_equal(found.scored, ~lost)
    with pytest.raises(NodesError, match="No cell"):
        predicted_conformability(skin, np.full_like(corners, np.nan), FEW)


def test_the_fast_overlap_agrees_with_the_exact_route() -> None:
    skin = elbow_skin()
    fast = FastOverlap.of(skin)
    rng = np.random.default_rng(4)
    poses = []
    for size in (0.2, 0.5, 1.0):
        rough = size * rng.standard_normal((*skin.target_q_mm.shape[:2], 2))
        poses.append(skin.target_q_mm + 0.4 * rough + size * rng.standard_normal(2))
    several = fast.overlap(np.stack(poses))
    for pose, quick in zip(poses, several, strict=True):
        exact = predicted_conformability(skin, skin.places(pose), FEW)
        for definition in ("paper", "strict", "iou"):
            read = fast.overlap(pose, definition)
            known = getattr(exact, f"overlap_{definition}")
            assert np.abs(read - known).max() < FAST_OVERLAP
        assert quick == pytest.approx(fast.overlap(pose), abs=1e-12)
    assert fast.overlap(skin.target_q_mm) == pytest.approx(1.0, abs=1e-9)


def test_in_a_plane_overlaps_are_those_of_rectangles() -> None:
    steps = np.stack(np.meshgrid(np.arange(4), np.arange(5)), axis=-1).astype(np.float64)
    skin = steps * (12.0, 15.0)
    patch = skin + np.array([3.0, -1.5])
    region = np.full((4, 3), "P")
    found = flat_conformability("X", skin, patch, region, cell_mm=15.0, options=FEW)
    assert found.overlap_paper == pytest.approx((1 - 3 / 12) * (1 - 1.5 / 15), abs=1e-12)
    assert found.skin_area_mm2 == pytest.approx(180.0)
    # Longitudinal first, distal positive; then medial.
    assert found.causes.shift_mm[0, 0] == pytest.approx((-1.5, 3.0), abs=1e-12)
    wide = flat_conformability("X", skin, skin * (1.1, 1.0), region, cell_mm=15.0, options=FEW)
    assert wide.causes.lateral_stretch == pytest.approx(1.1, abs=1e-9)
    assert wide.overlap_strict[:, 0] == pytest.approx(1 / 1.1, abs=1e-12)
