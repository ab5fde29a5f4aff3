"""Views, pairings, camera shake, tables and overlays: each against what is known."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from tolerances import TENSILE_STRAIN

from kiribench.errors import TableError
from kiribench.tensile import MEASURED, measure_frames, read_tensile, write_tensile
from kiribench.tensile.camera import fit_homography, project, undistort
from kiribench.tensile.cells import cells_of_corners
from kiribench.tensile.overlay import overlay
from kiribench.tensile.pairing import pair_by_map, pair_nearest
from kiribench.tensile.sidecar import Lens

EXAMPLE = Path(__file__).parents[2] / "data" / "synthetic" / "tensile"


def test_a_homography_is_found_again() -> None:
    matrix = np.array([[1.1, 0.1, 5.0], [-0.05, 0.9, 3.0], [2e-4, -3e-4, 1.0]])
    points = np.random.default_rng(0).uniform(0, 500, (12, 2))
    np.testing.assert_allclose(fit_homography(points, project(matrix, points)), matrix, atol=1e-9)


def test_undistorting_undoes_brown() -> None:
    lens = Lens(focal_px=900, principal_px=(400, 300), k1=-0.2, k2=0.05, p1=1e-3, p2=-5e-4)
    flat = np.random.default_rng(1).uniform(-0.4, 0.4, (50, 2))
    x, y = flat.T
    r2 = x * x + y * y
    radial = 1 + lens.k1 * r2 + lens.k2 * r2 * r2
    bent = np.column_stack(
        [
            x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x * x),
            y * radial + lens.p1 * (r2 + 2 * y * y) + 2 * lens.p2 * x * y,
        ]
    )
    seen = bent * lens.focal_px + lens.principal_px
    np.testing.assert_allclose(
        undistort(lens, seen), flat * lens.focal_px + lens.principal_px, atol=1e-5
    )


def test_cells_of_corners_are_means_of_opposite_edges() -> None:
    rest = np.stack(np.meshgrid(np.arange(3.0), np.arange(2.0)), -1)
    now = rest * [0.9, 1.4]
    now[0, 0] += [0.0, -0.2]  # one edge of cell 0 longer by .2
    ok = np.full((2, 3), "ok", dtype="<U16")
    found = cells_of_corners(rest, now, np.full((2, 3), 0.01), ok)
    left = np.hypot(0.9, 0.2)
    np.testing.assert_allclose(found.longitudinal, [1.5, 1.4])
    np.testing.assert_allclose(found.lateral, [0.5 * (left + 0.9), 0.9])
    # Each length has two ends, each mean two lengths: .01 sqrt(4) / 2.
    np.testing.assert_allclose(found.sd, 0.01, rtol=1e-12)
    ok[0, 2] = "lost"
    assert list(cells_of_corners(rest, now, np.full((2, 3), 0.01), ok).status) == ["ok", "lost"]


def grid(rows: int, columns: int, pitch: float) -> np.ndarray:
    return pitch * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)


def test_markers_are_paired_over_a_large_step() -> None:
    here = grid(8, 5, 50.0) + 100
    turn = np.array([[0.85, 0.03], [-0.02, 1.6]])
    there = (here - 150) @ turn.T + [190, 400]
    order = np.random.default_rng(3).permutation(len(there))
    pairing = pair_by_map(here, there[order], 50.0, np.array([0.0, 1.0]))
    assert not pairing.ambiguous and not pairing.shifted
    np.testing.assert_array_equal(order[pairing.to], np.arange(len(here)))
    # The nearest ones alone would be wrong, and know it.
    assert pair_nearest(here, there, 50.0).score < 0.5


def test_markers_without_a_rim_are_said_to_be_alike() -> None:
    here = grid(6, 4, 50.0) + 100
    there = grid(14, 4, 75.0) + np.array([100, -200])
    pairing = pair_by_map(here, there, 50.0, np.array([0.0, 1.0]))
    assert pairing.shifted or pairing.ambiguous


def example(
    folder: Path, frames: int, shift: tuple[float, float] = (0.0, 0.0), zoom: float = 1.0
) -> Path:
    """The first frames of the example; the last one moved with everything in it."""
    folder.mkdir()
    content = json.loads((EXAMPLE / "tensile.json").read_text())
    for key in ("load", "frame_times_s"):
        content.pop(key)
    for k in range(frames):
        name = f"frame_{k:03d}.png"
        picture = cv2.imread(str(EXAMPLE / name), cv2.IMREAD_GRAYSCALE)
        for x in (3, 313):  # a still thing on either side
            thing = np.random.default_rng(x).integers(0, 200, (9, 9)).astype(np.uint8)
            picture[40:76, x : x + 32] = cv2.resize(thing, (32, 36), interpolation=cv2.INTER_CUBIC)
        if k == frames - 1 and (zoom != 1 or shift != (0.0, 0.0)):
            matrix = np.array([[zoom, 0, shift[0]], [0, zoom, shift[1]]])
            picture = cv2.warpAffine(picture, matrix, picture.shape[::-1], flags=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / name), picture)
    (folder / "tensile.json").write_text(
        json.dumps({**content, "still_px": [[4, 41, 33, 75], [314, 41, 343, 75]]})
    )
    return folder


def test_camera_shake_is_removed_and_said(tmp_path: Path) -> None:
    still = measure_frames(example(tmp_path / "still", 3))
    moved = measure_frames(example(tmp_path / "moved", 3, (3.3, -2.6)))
    np.testing.assert_allclose(
        moved.longitudinal_stretch[2], still.longitudinal_stretch[2], atol=1e-3
    )
    said = next(note for note in moved.notes if "camera motion" in note)
    assert float(said.split()[-2]) == pytest.approx(np.hypot(3.3, 2.6), abs=0.1)


def test_a_camera_that_comes_nearer_is_no_strain(tmp_path: Path) -> None:
    still = measure_frames(example(tmp_path / "still", 2))
    zoomed = measure_frames(example(tmp_path / "zoomed", 2, (-2.0, 17.0), zoom=1.01))
    assert not zoomed.warnings
    for name in ("longitudinal_stretch", "lateral_stretch"):
        np.testing.assert_allclose(
            getattr(zoomed, name)[1], getattr(still, name)[1], atol=TENSILE_STRAIN
        )


def test_tables_come_back(tmp_path: Path) -> None:
    test = measure_frames(EXAMPLE)
    write_tensile(tmp_path, test, measure="engineering")
    back = read_tensile(tmp_path)
    assert back.frame == test.frame and back.cell == test.cell and back.marker == test.marker
    for name in (
        "longitudinal_stretch",
        "lateral_stretch",
        "stretch_sd",
        "force_n",
        "block_stretch",
        "row",
        "col",
    ):
        np.testing.assert_allclose(getattr(back, name), getattr(test, name), rtol=1e-8)
    assert (back.status == test.status).all()
    assert back.strain_sd == pytest.approx(test.strain_sd)
    shutil.copy(tmp_path / "cells.tsv", tmp_path / "keep")
    text = (tmp_path / "cells.tsv").read_text().replace("1.0", "x.0", 1)
    (tmp_path / "cells.tsv").write_text(text)
    with pytest.raises(TableError, match="tensile-value"):
        read_tensile(tmp_path)
    (tmp_path / "curve.tsv").unlink()
    with pytest.raises(TableError, match="tensile-table-missing"):
        read_tensile(tmp_path)


def test_the_overlay_draws_where_the_cells_are() -> None:
    test = measure_frames(EXAMPLE)
    picture = cv2.imread(str(EXAMPLE / test.frame[6]), cv2.IMREAD_GRAYSCALE).astype(np.float32)
    drawn = overlay(picture, test, 6).astype(int)
    coloured = np.abs(drawn[..., 0] - drawn[..., 2]) > 60
    assert 0.005 < coloured.mean() < 0.2
    y, x = np.nonzero(coloured)
    corner = test.corner_px[6].reshape(-1, 2)
    assert x.min() == pytest.approx(corner[:, 0].min(), abs=4)
    assert y.max() == pytest.approx(corner[:, 1].max(), abs=4)
    assert np.isin(test.status, MEASURED).all()
