"""kiribench validate: what it prints, counts and exits with."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import scan_zoo
from small_limb import Limb, write_dataset, write_elbow_dataset

from kiribench.cli import main

SURF = "sub-A/surf"
SOUND = scan_zoo.sound_mesh()
REPLACED = {
    "mesh-file-missing": "path-not-a-file",
    "mesh-file-not-regular": "path-not-a-file",
    "mesh-file-empty": "scan-empty",
    "mesh-unknown-format": "scan-missing",
}
"""What the folder's own check says before the scan is opened."""


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("validate") / "good", participants=("A", "B"))


@pytest.fixture
def dataset(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "limb"))


@pytest.fixture
def validate(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(root: Path, *flags: str) -> tuple[int, str]:
        capsys.readouterr()
        exit_code = main(["validate", str(root), "--quiet", *flags])
        return exit_code, capsys.readouterr().out

    return call


def break_both(root: Path) -> None:
    (root / "README").unlink()
    for name in ("A", "B"):
        nodes = root / f"sub-{name}/surf/sub-{name}_acq-flex000_nodes.tsv"
        nodes.write_text(nodes.read_text().replace("\t", ","))
        (root / f"sub-{name}/surf/sub-{name}_acq-flex090_scan.json").write_text("{}")


def test_a_valid_dataset(good: Path, validate: Any) -> None:
    exit_code, text = validate(good)
    assert exit_code == 0
    assert text.splitlines()[0].endswith("2 participants, 6 acquisitions")
    assert text.splitlines()[-1] == "Valid: no faults."


def test_json_describes_every_scan(good: Path, validate: Any) -> None:
    exit_code, text = validate(good, "--json", "--strict")
    assert exit_code == 0
    result = json.loads(text)
    assert result["schema"] == "kiribench.validate/1"
    assert (result["valid"], result["errors"], result["warnings"]) == (True, 0, 0)
    assert [entry["id"] for entry in result["participants"]] == ["A", "B"]
    for entry in result["participants"]:
        assert (entry["side"], entry["body_part"]) == ("right", "knee")
        assert (entry["grid"], entry["patch"]) == ([16, 12], [12, 6])
        for scan, nodes in zip(entry["scans"], (221, 221, 91), strict=True):
            vertices, faces = Limb().mesh(scan["acquisition"].removesuffix("worn"))
            assert scan["units"] == "mm"
            assert scan["health"]["vertices"] == len(vertices)
            assert scan["health"]["faces"] == len(faces)
            assert scan["health"]["components"] == 1
            assert scan["repairs"] == []
            assert scan["nodes"]["expected"] == scan["nodes"]["seen"] == nodes
            assert scan["nodes"]["largest_offset_mm"] < (0.2 if nodes == 91 else 1e-5)
    hashed = [name for name in result["provenance"]["inputs"] if name.endswith("_scan.obj")]
    assert len(hashed) == 6


def test_one_participant_only(dataset: Path, validate: Any) -> None:
    (dataset / "sub-B/surf/sub-B_acq-flex000_nodes.tsv").unlink()
    assert validate(dataset)[0] == 3
    exit_code, text = validate(dataset, "--json", "--participant", "A")
    assert exit_code == 0
    assert [entry["id"] for entry in json.loads(text)["participants"]] == ["A"]
    assert validate(dataset, "--participant", "sub-C")[0] == 2


def test_every_fault_of_every_participant_grouped_by_file(dataset: Path, validate: Any) -> None:
    break_both(dataset)
    exit_code, text = validate(dataset)
    assert exit_code == 3
    lines = text.splitlines()
    for name in ("A", "B"):
        where = lines.index(f"sub-{name}/surf/sub-{name}_acq-flex000_nodes.tsv")
        assert lines[where + 1].startswith("  error [table-separator] row 1: ")
        assert "remedy:" in lines[where + 3]
        where = lines.index(f"sub-{name}/surf/sub-{name}_acq-flex090_scan.json")
        assert lines[where + 1].startswith("  error [json-key-missing] column Units: ")
    assert lines[-1] == "Not valid: 4 errors, 1 warning."
    result = json.loads(validate(dataset, "--json")[1])
    assert (result["valid"], result["errors"], result["warnings"]) == (False, 4, 1)
    assert sorted(fault["code"] for fault in result["faults"]) == [
        "json-key-missing",
        "json-key-missing",
        "readme-missing",
        "table-separator",
        "table-separator",
    ]


def test_strict_fails_on_warnings(dataset: Path, validate: Any) -> None:
    (dataset / "README").unlink()
    exit_code, text = validate(dataset)
    assert exit_code == 0
    assert text.splitlines()[-1] == "Valid, with 1 warning."
    exit_code, text = validate(dataset, "--strict")
    assert exit_code == 1
    assert text.splitlines()[-1] == "Refused by --strict: 1 warning."


def test_many_faults_of_a_kind_are_counted_not_listed(dataset: Path, validate: Any) -> None:
    nodes = dataset / SURF / "sub-A_acq-flex000_nodes.tsv"
    nodes.write_text(nodes.read_text().replace(".", ","))
    exit_code, text = validate(dataset)
    assert exit_code == 3
    assert text.count("[nodes-number]") == 9
    assert "  ... and 655 more [nodes-number]; see --json" in text
    assert text.splitlines()[-1] == "Not valid: 663 errors, 0 warnings."


def test_another_body_part(tmp_path: Path, validate: Any) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    exit_code, text = validate(root, "--json", "--strict")
    assert exit_code == 0, text
    (entry,) = json.loads(text)["participants"]
    assert (entry["body_part"], entry["side"]) == ("elbow", "left")
    assert (entry["grid"], entry["patch"]) == ([8, 6], [6, 4])


@pytest.mark.parametrize("command", ["measure", "conform"])
def test_another_body_part_is_measured_and_scored(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    assert main([command, str(root), "--json", "--quiet"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["participants"]
    rows, columns = (8, 6) if command == "measure" else (6, 4)
    assert len(entry["table"]) == rows * columns
    if command == "conform":
        assert list(entry["regions"]) == ["cap", "outer", "hollow", "inner"]
        assert sum(region["cells"] for region in entry["regions"].values()) == 24


def test_html_in_a_file_name_is_not_repeated_raw(dataset: Path, validate: Any) -> None:
    (dataset / "sub-\u202e\x1b[31m").mkdir()
    exit_code, text = validate(dataset)
    assert exit_code == 3
    assert "\x1b" not in text
    assert "\u202e" not in text


def test_help_needs_no_science() -> None:
    code = (
        "import sys; from kiribench.cli import main; main(['validate', '--help']);"
        "heavy = {'numpy', 'pandas', 'pandera', 'scipy', 'numba', 'trimesh', 'torch', 'pydantic'};"
        "sys.exit(len(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Check a dataset" in done.stdout


@pytest.mark.timeout(60)
@pytest.mark.parametrize("case", scan_zoo.CASES, ids=str)
def test_broken_scans_in_a_dataset(
    case: scan_zoo.Case, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The zoo of scans put into a dataset, whose nodes do not lie on them: one fault more."""
    stem = dataset / SURF / "sub-A_acq-flex090_scan"
    stem.with_suffix(".obj").unlink()
    case.write(stem, SOUND)
    capsys.readouterr()
    exit_code = main(["validate", str(dataset), "--json", "--quiet"])
    result = json.loads(capsys.readouterr().out)
    codes = {fault["code"] for fault in result["faults"]}
    assert exit_code == 3
    assert codes & {case.code, REPLACED.get(case.code)}, codes
