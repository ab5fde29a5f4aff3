"""Every broken dataset through every command: a named error, the right exit code, no crash."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from small_limb import write_dataset
from tolerances import HARMLESS_OVERLAP, HARMLESS_STRETCH, ROUNDED_OVERLAP
from zoo import CASES, Case

from kiribench.cli import main

COMMANDS = [
    name
    for name in ("validate", "measure", "conform")
    if importlib.util.find_spec(f"kiribench.cli.{name}") is not None
]


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("zoo") / "good")


@pytest.fixture
def broken(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "zoo"))


def run(command: str, root: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, Any, str]:
    capsys.readouterr()
    exit_code = main([command, str(root), "--json", "--quiet"])
    printed = capsys.readouterr()
    result = json.loads(printed.out, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))
    return exit_code, result, printed.err


_GOOD: dict[str, Any] = {}


def good_result(command: str, good: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    if command not in _GOOD:
        exit_code, result, errors = run(command, good, capsys)
        assert exit_code == 0, errors
        _GOOD[command] = result
    return _GOOD[command]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_zoo(
    case: Case, command: str, good: Path, broken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case.damage(broken)
    exit_code, result, errors = run(command, broken, capsys)
    assert exit_code == getattr(case, command), errors
    faults = result.get("faults", [])
    codes = {fault["code"] for fault in faults}
    assert "bug" not in codes
    for fault in faults:
        assert fault["remedy"]
        assert all(str(text).isprintable() for text in fault.values()), fault
    if command == "validate":
        assert result["schema"] == "kiribench.validate/1"
        assert not case.code or case.code in codes, faults
        assert result["valid"] == (exit_code == 0)
    elif exit_code:
        assert result["schema"] == "kiribench.error/1"
        assert any(fault["severity"] == "error" for fault in faults)
    if case.harmless and command != "validate":
        compare(command, result, good_result(command, good, capsys), case.rounded)


def compare(command: str, result: Any, expected: Any, rounded: bool) -> None:
    """Harmless changes leave every number as it was, within the file format's precision."""
    keys, tolerance = {
        "measure": (
            ("longitudinal_stretch", "lateral_stretch", "shear", "poisson_ratio"),
            HARMLESS_STRETCH,
        ),
        "conform": (
            ("overlap_paper", "overlap_strict", "overlap_iou"),
            ROUNDED_OVERLAP if rounded else HARMLESS_OVERLAP,
        ),
    }[command]
    (got,), (wanted,) = result["participants"], expected["participants"]
    assert len(got["table"]) == len(wanted["table"]) > 0
    for row, other in zip(got["table"], wanted["table"], strict=True):
        assert (row["row"], row["col"]) == (other["row"], other["col"])
        for key in keys:
            if other[key] is None:
                assert row[key] is None
            else:
                assert row[key] == pytest.approx(other[key], abs=tolerance), (key, row, other)


@pytest.mark.skipif("measure" not in COMMANDS, reason="needs measure")
def test_cells_beside_a_hole_have_a_reason_and_the_others_their_numbers(
    good: Path, broken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The hole lies on the side from node (8, 6) to (8, 7), and touches that of (7, 7)."""
    next(case for case in CASES if case.name == "a hole under a path").damage(broken)
    _, result, _ = run("measure", broken, capsys)
    wanted = good_result("measure", good, capsys)["participants"][0]["table"]
    for row, other in zip(result["participants"][0]["table"], wanted, strict=True):
        cell = (row["row"], row["col"])
        if row["reason"] is None:
            assert cell not in {(7, 6), (8, 6)}
            for key in ("longitudinal_stretch", "lateral_stretch", "shear"):
                assert row[key] == pytest.approx(other[key], abs=HARMLESS_STRETCH), (cell, key)
        else:
            assert row["reason"] == "path-around-hole"
            assert cell in {(7, 6), (8, 6), (7, 7)}
            assert row["lateral_stretch"] is None
            assert row["poisson_ratio"] is None


def test_the_zoo_is_large_enough() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
    assert len([case for case in CASES if not case.harmless]) >= 40


def test_the_good_dataset_is_good(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exit_code, result, _ = run("validate", good, capsys)
    assert exit_code == 0
    assert result["faults"] == []
    scans = result["participants"][0]["scans"]
    assert [scan["acquisition"] for scan in scans] == ["flex000", "flex090", "flex090worn"]
