"""kiribench regress: passes on the recorded data, fails on drift, never updates in CI."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from scored_knees import SYNTHETIC, scored_knee

from kiribench.cli import main
from kiribench.dataset import Subject
from kiribench.regression import suite
from kiribench.regression.suite import Fresh

pytestmark = pytest.mark.xdist_group("scored-knees")


@pytest.fixture
def one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The synthetic dataset with subject S1 alone; its scans, which no test here changes, are
    measured and scored once for all tests."""
    compute = suite.compute

    def shared(subject: Subject) -> Fresh:
        return scored_knee("S1") if subject.root == root else compute(subject)

    monkeypatch.setattr(suite, "compute", shared)
    root = tmp_path / "synthetic"
    shutil.copytree(
        SYNTHETIC, root, ignore=shutil.ignore_patterns("sub-S2*", "sub-S3*", "*.png", "*.mtl")
    )
    table = root / "participants.tsv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join(line for line in lines if "S2" not in line and "S3" not in line))
    return root


def run(capsys: pytest.CaptureFixture[str], *tokens: object) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    exit_code = main(["regress", *(str(token) for token in tokens), "--json", "--quiet"])
    result: dict[str, Any] = json.loads(capsys.readouterr().out)
    return exit_code, result


def test_the_recorded_numbers_hold(one: Path, tmp_path: Path, capsys: Any) -> None:
    junit = tmp_path / "reports" / "regress.xml"
    exit_code, result = run(capsys, one, "--junit", junit)
    assert [check["name"] for check in result["checks"] if not check["passed"]] == []
    assert exit_code == 0
    assert {check["group"] for check in result["checks"]} == {"truth", "record", "invariant"}
    names = {check["name"].split()[0] for check in result["checks"]}
    assert {"rigid-motion", "units", "mirror", "remeshing"} <= names
    suite = ElementTree.parse(junit).getroot()
    assert suite.get("failures") == "0"
    assert len(suite.findall("testcase")) == len(result["checks"]) == int(suite.get("tests", "0"))


def change(file: Path, line: int, column: str, by: float) -> None:
    """Add to one number of a TSV."""
    lines = file.read_text().splitlines()
    at = lines[0].split("\t").index(column)
    fields = lines[line].split("\t")
    fields[at] = f"{float(fields[at]) + by:.9g}"
    lines[line] = "\t".join(fields)
    file.write_text("\n".join(lines) + "\n")


def test_drift_is_found_in_the_column_where_it_is(
    one: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kiribench.regression.suite.VARIANTS", ())
    change(one / "derivatives/kiribench/sub-S1/sub-S1_conform.tsv", 10, "overlap_iou", 1e-4)
    change(one / "derivatives/truth/sub-S1/sub-S1_strain.tsv", 5, "lateral_stretch", 0.01)
    junit = tmp_path / "regress.xml"
    exit_code, result = run(capsys, one, "--junit", junit)
    assert exit_code == 1
    failed = [check["name"] for check in result["checks"] if not check["passed"]]
    assert failed == ["S1 lateral_stretch", "S1 conform overlap_iou"]
    suite = ElementTree.parse(junit).getroot()
    assert suite.get("failures") == "2"
    assert len(suite.findall("testcase/failure")) == 2


def test_a_missing_record_fails_and_update_writes_it(
    one: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kiribench.regression.suite.VARIANTS", ())
    monkeypatch.delenv("CI", raising=False)
    record = one / "derivatives/kiribench/sub-S1/sub-S1_strain.tsv"
    record.unlink()
    exit_code, result = run(capsys, one)
    assert exit_code == 1
    assert [check["name"] for check in result["checks"] if not check["passed"]] == ["S1 strain"]
    exit_code, result = run(capsys, one, "--update")
    assert exit_code == 0
    assert result["updated"] is True
    assert record.is_file()


def test_no_update_in_ci(one: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CI", "true")
    exit_code, result = run(capsys, one, "--update")
    assert exit_code == 2
    assert result["faults"][0]["code"] == "regress-update-in-ci"
