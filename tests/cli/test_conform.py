"""kiribench conform: the issue's JSON, gates, skips, refusals."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_limb import Limb, write_dataset, write_elbow_dataset, write_nodes

from kiribench.cli import main
from kiribench.conformability.export import COLUMNS
from kiribench.conformability.result import CAUSES

WORN = "sub-{0}/surf/sub-{0}_acq-flex090worn"


@pytest.fixture(scope="module")
def limb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A: shifted 3 mm distally. B: a perfect fit. C: no worn scan."""
    root = write_dataset(tmp_path_factory.mktemp("conform") / "limb", participants=("A", "B", "C"))
    for name, shift in (("A", 3.0), ("B", 0.0)):
        corners = Limb().patch_nodes(shift_mm=shift)
        write_nodes(root / (WORN.format(name) + "_nodes.tsv"), corners)
    for file in (root / "sub-C/surf").glob("*flex090worn*"):
        file.unlink()
    return root


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*tokens: object) -> tuple[int, str, str]:
        capsys.readouterr()
        exit_code = main(["conform", *(str(token) for token in tokens), "--quiet"])
        captured = capsys.readouterr()
        return exit_code, captured.out, captured.err

    return call


def test_the_json_is_what_the_schema_says(limb: Path, run: Any) -> None:
    exit_code, out, _ = run(limb, "--json", "--samples", "200")
    assert exit_code == 0
    result = json.loads(out)
    assert result["schema"] == "kiribench.conform/1"
    assert [entry["id"] for entry in result["participants"]] == ["A", "B"]
    assert [entry["id"] for entry in result["skipped"]] == ["C"]
    shifted, perfect = result["participants"]
    for entry in (shifted, perfect):
        assert entry["cells"] == entry["scored"] == 72
        assert entry["good"] + entry["fair"] + entry["poor"] == 72
        assert entry["satisfactory"] == (entry["good"] + entry["fair"]) / 72
        assert set(entry["regions"]) == {"S", "LS", "P", "MS", "LI", "MI", "I"}
        assert sum(score["cells"] for score in entry["regions"].values()) == 72
        assert len(entry["table"]) == 72
        assert list(entry["table"][0]) == list(COLUMNS)
    assert perfect["good"] == 72
    # Nodes are vertices of a mesh with mirror lines through them: a side has two shortest
    # paths, one past either flank of the 5 mm facets, and skin and patch may take either.
    assert min(row["overlap_iou"] for row in perfect["table"]) > 0.998
    # A tube bent to a circle may slide along itself: its skin cannot tell where the patch is.
    assert perfect["registration"]["method"] == "assumed"
    assert "frame-assumed" in [fault["code"] for fault in perfect["warnings"]]
    assert {row["main_cause"] for row in perfect["table"]} == {"none"}
    # 3 mm of 15 mm distally: four fifths are covered, and it is the shift.
    for row in shifted["table"]:
        assert row["overlap_paper"] == pytest.approx(0.8, abs=0.01)
        assert row["grade"] == "fair"
        assert row["main_cause"] == "shift"
        assert row["cost_shift"] == pytest.approx(1.0 - row["overlap_paper"], abs=0.01)
        assert row["shift_longitudinal_mm"] > 2.5
        assert abs(row["shift_lateral_mm"]) < 0.2
        assert row["overlap_low"] <= row["overlap_paper"] <= row["overlap_high"]
        total = sum(row[f"probability_{grade}"] for grade in ("good", "fair", "poor"))
        assert total == pytest.approx(1.0)
        assert all(f"cost_{cause.replace('-', '_')}" in row for cause in CAUSES)


def test_per_cell_alignment_forgives_a_shift(limb: Path, run: Any) -> None:
    exit_code, out, _ = run(
        limb, "--participant", "A", "--alignment", "per-cell", "--json", "--samples", "100"
    )
    assert exit_code == 0
    (entry,) = json.loads(out)["participants"]
    assert entry["good"] == 72
    # The offset is still told.
    assert all(row["centre_offset_mm"] > 2.5 for row in entry["table"])


def test_grading_by_iou_is_stricter(limb: Path, run: Any) -> None:
    _, out, _ = run(limb, "--participant", "A", "--grade-by", "iou", "--json", "--samples", "100")
    (entry,) = json.loads(out)["participants"]
    # 12 / 18 = .67.
    assert entry["poor"] == 72
    assert entry["definition_matters"] == 72


@pytest.mark.parametrize(
    ("fail_under", "exit_code"), [("0.75", 0), ("1.0", 0), ("0.9", 0), (None, 0)]
)
def test_the_gate_passes(limb: Path, run: Any, fail_under: str | None, exit_code: int) -> None:
    flags = () if fail_under is None else ("--fail-under", fail_under)
    assert run(limb, "--participant", "A", "--samples", "100", *flags)[0] == exit_code


def test_the_gate_fails_with_code_1_and_a_full_result(limb: Path, run: Any) -> None:
    exit_code, out, err = run(
        limb, "--participant", "A", "--participant", "B", "--grade-by", "iou",
        "--fail-under", "0.5", "--json", "--samples", "100",
    )  # fmt: skip
    assert exit_code == 1
    result = json.loads(out)
    assert result["passed"] is False
    assert len(result["participants"]) == 2
    assert "conform-below-limit" in err
    assert "Participant A" in err
    assert "Participant B" not in err


def test_a_limit_in_percent_is_refused(limb: Path, run: Any) -> None:
    exit_code, out, _ = run(limb, "--fail-under", "75", "--json")
    assert exit_code == 2
    assert json.loads(out)["faults"][0]["code"] == "fail-under-range"


def test_no_worn_scan_at_all_is_an_error(limb: Path, run: Any) -> None:
    exit_code, out, _ = run(limb, "--participant", "C", "--json")
    assert exit_code == 3
    assert json.loads(out)["faults"][0]["code"] == "conform-no-worn-scan"


def test_hidden_corners_are_not_scored_and_the_denominator_says_so(
    limb: Path, tmp_path: Path, run: Any
) -> None:
    root = Path(shutil.copytree(limb, tmp_path / "limb"))
    file = root / (WORN.format("B") + "_nodes.tsv")
    lines = file.read_text().splitlines()
    lines = [line + ("\tstatus" if k == 0 else "\tok") for k, line in enumerate(lines)]
    lines[1] = lines[1].removesuffix("ok") + "hidden"
    file.write_text("\n".join(lines) + "\n")
    exit_code, out, _ = run(root, "--participant", "B", "--json", "--samples", "100")
    assert exit_code == 0
    (entry,) = json.loads(out)["participants"]
    assert (entry["cells"], entry["scored"], entry["satisfactory"]) == (72, 71, 1.0)
    assert entry["not_scored"] == {"patch-node-missing": 1}
    assert entry["table"][0]["grade"] is None
    assert entry["table"][0]["overlap_paper"] is None
    assert entry["table"][0]["reason"] == "patch-node-missing"
    assert (entry["regions"]["S"]["cells"], entry["regions"]["S"]["scored"]) == (12, 11)
    assert entry["lift_off_mm"][0][0] is None
    assert "conform-cells-missing" in [fault["code"] for fault in entry["warnings"]]


def test_tables_and_reports_are_written(limb: Path, tmp_path: Path, run: Any) -> None:
    exit_code, _, _ = run(limb, "--participant", "A", "--out", tmp_path, "--samples", "100")
    assert exit_code == 0
    lines = (tmp_path / "sub-A/sub-A_conform.tsv").read_text().splitlines()
    assert lines[0].split("\t") == list(COLUMNS)
    assert len(lines) == 73
    sidecar = json.loads((tmp_path / "sub-A/sub-A_conform.json").read_text())
    assert set(sidecar["Columns"]) == set(COLUMNS)
    assert sidecar["Limits"] == {"good": 0.9, "fair": 0.75}
    assert (tmp_path / "conform.json").is_file()
    assert (tmp_path / "index.html").is_file()


def test_another_body_part_by_metadata_alone(tmp_path: Path, run: Any) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    exit_code, out, _ = run(root, "--json", "--samples", "100")
    assert exit_code == 0
    (entry,) = json.loads(out)["participants"]
    assert entry["cells"] == 24
    assert set(entry["regions"]) == {"cap", "outer", "hollow", "inner"}


def test_the_same_seed_gives_the_same_bytes(limb: Path, run: Any) -> None:
    def table(seed: int) -> list[dict[str, Any]]:
        out = run(limb, "--participant", "A", "--json", "--samples", "100", "--seed", seed)[1]
        rows: list[dict[str, Any]] = json.loads(out)["participants"][0]["table"]
        return rows

    assert table(1) == table(1)
    low = [np.array([row["overlap_low"] for row in table(seed)]) for seed in (1, 2)]
    assert not np.array_equal(*low)


@pytest.mark.parametrize(
    ("flags", "code"),
    [
        (("--samples", "99"), "samples-out-of-range"),
        (("--samples", "1000000000"), "samples-out-of-range"),
        (("--seed", "-1"), "seed-negative"),
    ],
)
def test_draws_that_cannot_be_are_refused_before_any_work(run, limb, flags, code):
    exit_code, _, err = run(limb, "--participant", "A", *flags)
    assert exit_code == 2
    assert f"error[{code}]" in err
