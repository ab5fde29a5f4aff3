"""Bad frames and bad declarations: each is named, with its place."""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from kiribench.errors import DataError
from kiribench.tensile import measure_frames
from kiribench.tensile.frames import list_frames
from kiribench.tensile.result import MEASURED

EXAMPLE = Path(__file__).parents[2] / "data" / "synthetic" / "tensile"
NAMES = [f"frame_{k:03d}.png" for k in range(5)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The first five frames of the example, without the machine."""
    for name in NAMES:
        shutil.copy(EXAMPLE / name, tmp_path / name)
    change(tmp_path, load=None, frame_times_s=None)
    return tmp_path


def change(folder: Path, **changes: Any) -> None:
    path = folder / "tensile.json"
    content = json.loads((path if path.is_file() else EXAMPLE / "tensile.json").read_text())
    for key, value in changes.items():
        content.pop(key, None)
        if value is not None:
            content[key] = value
    path.write_text(json.dumps(content))


def cells(folder: Path, **changes: Any) -> None:
    path = folder / "tensile.json"
    content = json.loads(path.read_text())
    content["cells"].update(changes)
    path.write_text(json.dumps(content))


def read(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def swap(folder: Path) -> None:
    one, two, spare = folder / NAMES[2], folder / NAMES[3], folder / "spare"
    one.rename(spare)
    two.rename(one)
    spare.rename(two)


def truncate(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def truncated_jpeg(folder: Path) -> None:
    for name in NAMES:
        cv2.imwrite(str(folder / name.replace("png", "jpg")), read(folder / name))
        (folder / name).unlink()
    truncate(folder / "frame_003.jpg")


def truncated_tiff(folder: Path) -> None:
    for name in NAMES:
        cv2.imwrite(str(folder / name.replace("png", "tif")), read(folder / name))
        (folder / name).unlink()
    truncate(folder / "frame_003.tif")


BAD: dict[str, tuple[str, Callable[[Path], object]]] = {
    "missing": (
        "frame-missing",
        lambda f: (change(f, frames=NAMES), (f / NAMES[2]).unlink()),
    ),
    "none": ("frames-none", lambda f: [(f / name).unlink() for name in NAMES[1:]]),
    "listed twice": ("frame-twice", lambda f: change(f, frames=[*NAMES, NAMES[4]])),
    "swapped": ("frame-order", swap),
    "resized": (
        "frame-size",
        lambda f: cv2.imwrite(str(f / NAMES[3]), cv2.resize(read(f / NAMES[3]), (175, 320))),
    ),
    "turned": (
        "frame-size",
        lambda f: cv2.imwrite(str(f / NAMES[3]), np.rot90(read(f / NAMES[3]))),
    ),
    "colour": (
        "frame-colour",
        lambda f: cv2.imwrite(
            str(f / NAMES[3]), cv2.cvtColor(read(f / NAMES[3]), cv2.COLOR_GRAY2BGR)
        ),
    ),
    "16 bit": (
        "frame-colour",
        lambda f: cv2.imwrite(str(f / NAMES[3]), read(f / NAMES[3]).astype(np.uint16) * 257),
    ),
    "overexposed": (
        "frame-overexposed",
        lambda f: cv2.imwrite(str(f / NAMES[3]), cv2.convertScaleAbs(read(f / NAMES[3]), None, 2)),
    ),
    "dark": (
        "frame-dark",
        lambda f: cv2.imwrite(str(f / NAMES[3]), read(f / NAMES[3]) // 64),
    ),
    "truncated PNG": ("frame-truncated", lambda f: truncate(f / NAMES[3])),
    "truncated JPEG": ("frame-truncated", truncated_jpeg),
    "truncated TIFF": ("frame-truncated", truncated_tiff),
    "no picture": ("frame-format", lambda f: (f / NAMES[3]).write_text("not a picture")),
    "empty": ("frame-format", lambda f: (f / NAMES[3]).write_bytes(b"")),
    "no sidecar": ("tensile-sidecar-missing", lambda f: (f / "tensile.json").unlink()),
    "two sidecars": ("tensile-sidecar-twice", lambda f: (f / "tensile.toml").write_text("")),
    "marker": ("json-value", lambda f: change(f, marker="stripes")),
    "unknown key": ("json-key-unknown", lambda f: change(f, scale=3)),
    "grips in the wrong place": (
        "json-value",
        lambda f: change(f, specimen={"GripMm": 10}),
    ),
    "unknown in Specimen": ("json-key-unknown", lambda f: change(f, Specimen={"Grip": 10})),
    "ends": ("json-value", lambda f: change(f, Specimen={"Ends": "glued"})),
    "block outside": (
        "tensile-block",
        lambda f: cells(f, corners_px=[[100, 400], [200, 400], [200, 700], [100, 700]]),
    ),
    "no speckle there": (
        "tensile-markers",
        lambda f: (change(f, marker="dots"), (cells(f, rows=30, columns=20))),
    ),
    "too small": ("tensile-resolution", lambda f: cells(f, rows=40, columns=20)),
    "times": ("frame-times", lambda f: change(f, frame_times_s=[0.0, 1.0])),
    "no load": ("load-missing", lambda f: change(f, load={"file": "machine.csv"})),
    "still box": ("tensile-still-box", lambda f: change(f, still_px=[[2, 2, 12, 12]])),
    "oblique": (
        "tensile-tilt",
        lambda f: change(
            f,
            target={
                "points_px": [[60, 60], [290, 10], [290, 630], [60, 500]],
                "points_mm": [[0, 0], [40, 0], [40, 60], [0, 60]],
            },
        ),
    ),
    "fisheye": (
        "tensile-lens",
        lambda f: change(f, lens={"focal_px": 200, "principal_px": [175, 320], "k1": -0.3}),
    ),
    "wrong target": (
        "tensile-target",
        lambda f: change(
            f,
            target={
                "points_px": [[60, 60], [290, 60], [290, 600], [60, 600], [175, 330]],
                "points_mm": [[0, 0], [40, 0], [40, 90], [0, 90], [35, 20]],
            },
        ),
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_named(folder: Path, name: str) -> None:
    code, spoil = BAD[name]
    spoil(folder)
    with pytest.raises(DataError) as caught:
        measure_frames(folder)
    assert code in {fault.code for fault in caught.value.faults}, str(caught.value)
    assert all(fault.remedy for fault in caught.value.faults)


def test_a_refused_test_leaves_no_thread_behind(folder: Path) -> None:
    before = set(threading.enumerate())
    BAD["wrong target"][1](folder)
    with pytest.raises(DataError) as caught:
        measure_frames(folder)
    # The error still holds the frames of the calls; what decodes has ended all the same.
    assert caught.tb is not None
    assert set(threading.enumerate()) <= before


def test_all_bad_frames_are_named_at_once(folder: Path) -> None:
    truncate(folder / NAMES[1])
    BAD["resized"][1](folder)
    with pytest.raises(DataError) as caught:
        measure_frames(folder)
    assert {fault.code for fault in caught.value.faults} == {"frame-truncated", "frame-size"}


def test_a_gap_in_the_numbers_is_a_warning(folder: Path) -> None:
    shutil.copy(EXAMPLE / "frame_006.png", folder / "frame_006.png")
    test = measure_frames(folder)
    assert "frame-gap" in {fault.code for fault in test.warnings}
    change(folder, frame_rate_hz=1.0)
    with pytest.raises(DataError, match="frame-times"):
        measure_frames(folder)


def test_a_gap_in_a_short_series_is_a_warning(folder: Path) -> None:
    (folder / NAMES[2]).unlink()
    gap = [fault for fault in list_frames(folder, None).warnings if fault.code == "frame-gap"]
    assert len(gap) == 1
    assert gap[0].got == "3 after 1"


def test_a_covered_cell_is_lost_and_marked_and_found_again(folder: Path) -> None:
    picture = read(folder / NAMES[3])
    covered = picture.copy()
    covered[200:330, 170:300] = 90
    cv2.imwrite(str(folder / NAMES[3]), covered)
    test = measure_frames(folder)
    state = test.status[3]
    assert 0 < np.isin(state, MEASURED).sum() < len(state)
    assert np.isnan(test.longitudinal_stretch[3, ~np.isin(state, MEASURED)]).all()
    # What is next to the cover is as right as without it, and all is found again later.
    shutil.copy(EXAMPLE / NAMES[3], folder / NAMES[3])
    clean = measure_frames(folder)
    seen = np.isin(state, MEASURED)
    np.testing.assert_allclose(
        test.longitudinal_stretch[3, seen], clean.longitudinal_stretch[3, seen], atol=1e-3
    )
    assert np.isin(test.status[4], MEASURED).all()


def test_a_foreign_picture_is_lost_not_guessed(folder: Path) -> None:
    noise = np.random.default_rng(2).integers(20, 220, read(folder / NAMES[3]).shape)
    cv2.imwrite(str(folder / NAMES[3]), cv2.GaussianBlur(noise.astype(np.uint8), (0, 0), 1.5))
    test = measure_frames(folder)
    assert not test.measured[3].any()
    assert set(test.status[3]) <= {"lost", "outside", "doubtful"}
    assert "frame-lost" in {fault.code for fault in test.warnings}
    assert test.measured[4].all()


def test_a_step_back_at_the_end_is_a_warning(folder: Path) -> None:
    change(folder, frames=[*NAMES[:3], NAMES[4], NAMES[3]])
    test = measure_frames(folder)
    assert [(fault.code, fault.severity) for fault in test.warnings] == [("frame-order", "warning")]
    assert test.measured.all()


def test_the_machine_contradicts_swapped_frames(folder: Path) -> None:
    shutil.copy(EXAMPLE / "machine.csv", folder / "machine.csv")
    content = json.loads((EXAMPLE / "tensile.json").read_text())
    change(folder, load=content["load"], frame_times_s=content["frame_times_s"][:5])
    assert measure_frames(folder).measured.all()
    change(folder, frames=[*NAMES[:3], NAMES[4], NAMES[3]])
    with pytest.raises(DataError, match="frame-order"):
        measure_frames(folder)


def test_an_unloading_test_is_declared(folder: Path) -> None:
    swap(folder)
    change(folder, path="any")
    assert measure_frames(folder).measured.all()
