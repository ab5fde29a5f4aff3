"""kiribench measure: its tables, its JSON, its exit codes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_limb import ELBOW, Limb, write_dataset, write_elbow_dataset
from tolerances import CELL_STRAIN

from kiribench.cli import main
from kiribench.strain.export import COLUMNS


@pytest.fixture(scope="module")
def limb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataset(tmp_path_factory.mktemp("measure") / "limb", participants=("A", "B"))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*tokens: object) -> tuple[int, str, str]:
        capsys.readouterr()
        exit_code = main([str(token) for token in tokens])
        captured = capsys.readouterr()
        return exit_code, captured.out, captured.err

    return call


def array(table: list[dict[str, Any]], column: str, shape: tuple[int, int]) -> np.ndarray:
    out = np.full(shape, np.nan)
    for row in table:
        out[row["row"], row["col"]] = np.nan if row[column] is None else row[column]
    return out


def test_a_bent_limb_is_measured_as_its_closed_form_says(limb: Path, run: Any) -> None:
    exit_code, out, _ = run("measure", limb, "--json", "--quiet", "--denoise", "never")
    assert exit_code == 0
    result = json.loads(out)
    assert result["schema"] == "kiribench.measure/1"
    assert [entry["id"] for entry in result["participants"]] == ["A", "B"]
    entry = result["participants"][0]
    assert entry["strain_measure"] == "log"
    assert (entry["rows"], entry["columns"], entry["measured"]) == (16, 12, 192)
    edge = Limb().longitudinal_stretch()
    along = array(entry["table"], "longitudinal_stretch", (16, 12))
    # Longitudinal mesh lines are chords of circles about the bending axis; a shortest path
    # may leave them by less than a chord's sagitta.
    np.testing.assert_allclose(along, np.tile(0.5 * (edge[:-1] + edge[1:]), (16, 1)), atol=2e-3)
    across = array(entry["table"], "lateral_stretch", (16, 12))
    np.testing.assert_allclose(across, 1.0, atol=CELL_STRAIN)
    assert {row["strain_measure"] for row in entry["table"]} == {"log"}
    assert list(entry["table"][0]) == list(COLUMNS)


def test_another_body_part_by_metadata_alone(tmp_path: Path, run: Any) -> None:
    root = write_elbow_dataset(tmp_path / "elbow")
    exit_code, out, _ = run(
        "measure", root, "--json", "--quiet", "--strain-measure", "green", "--denoise", "never"
    )
    assert exit_code == 0
    (entry,) = json.loads(out)["participants"]
    assert (entry["rows"], entry["columns"]) == (8, 6)
    assert entry["strain_measure"] == "green"
    edge = ELBOW.longitudinal_stretch()
    along = array(entry["table"], "longitudinal_stretch", (8, 6))
    np.testing.assert_allclose(along, np.tile(0.5 * (edge[:-1] + edge[1:]), (8, 1)), atol=4e-3)
    strain = array(entry["table"], "longitudinal_strain", (8, 6))
    np.testing.assert_allclose(strain, 0.5 * (along**2 - 1.0), atol=1e-12)


def test_tables_are_written_beside_the_json(limb: Path, tmp_path: Path, run: Any) -> None:
    exit_code, out, _ = run("measure", limb, "--participant", "B", "--out", tmp_path, "--quiet")
    assert exit_code == 0
    assert "Verdict:" in out.strip().splitlines()[-1]
    lines = (tmp_path / "sub-B/sub-B_strain.tsv").read_text().splitlines()
    assert lines[0].split("\t") == list(COLUMNS)
    assert len(lines) == 1 + 192
    sidecar = json.loads((tmp_path / "sub-B/sub-B_strain.json").read_text())
    assert set(sidecar["Columns"]) == set(COLUMNS)
    assert json.loads((tmp_path / "measure.json").read_text())["settings"]
    assert not (tmp_path / "sub-A").exists()


def test_without_out_nothing_is_written(limb: Path, run: Any) -> None:
    before = sorted(limb.rglob("*"))
    assert run("measure", limb, "--participant", "A", "--quiet")[0] == 0
    assert sorted(limb.rglob("*")) == before


def test_a_missing_node_is_null_with_a_reason(limb: Path, tmp_path: Path, run: Any) -> None:
    root = Path(shutil.copytree(limb, tmp_path / "limb"))
    file = root / "sub-A/surf/sub-A_acq-flex090_nodes.tsv"
    lines = file.read_text().splitlines()
    row = lines[1 + 13 * 5 + 5].split("\t")
    assert row[:2] == ["5", "5"]
    lines = [
        "\t".join([*line.split("\t"), "status" if k == 0 else "ok"]) for k, line in enumerate(lines)
    ]
    lines[1 + 13 * 5 + 5] = "5\t5\tn/a\tn/a\tn/a\tmissing"
    file.write_text("\n".join(lines) + "\n")
    exit_code, out, _ = run("measure", root, "--participant", "A", "--json", "--quiet")
    assert exit_code == 0
    (entry,) = json.loads(out)["participants"]
    assert entry["not_measured"] == {"node-missing": 4}
    gone = [(row["row"], row["col"]) for row in entry["table"] if row["reason"] == "node-missing"]
    assert gone == [(4, 4), (4, 5), (5, 4), (5, 5)]
    assert all(
        row["longitudinal_stretch"] is None
        for row in entry["table"]
        if row["reason"] == "node-missing"
    )


@pytest.mark.parametrize(
    ("flags", "code", "exit_code"),
    [
        (("--min-strain", "-1"), "min-strain-range", 2),
        (("--participant", "nobody"), "participant-unknown", 2),
        (("--strain-measure", "true"), "usage", 2),
    ],
)
def test_wrong_options_end_with_usage(
    limb: Path, run: Any, flags: tuple[str, ...], code: str, exit_code: int
) -> None:
    found, out, _ = run("measure", limb, "--json", "--quiet", *flags)
    assert found == exit_code
    assert json.loads(out)["faults"][0]["code"] == code


def test_faults_of_all_participants_are_told_at_once(limb: Path, tmp_path: Path, run: Any) -> None:
    root = Path(shutil.copytree(limb, tmp_path / "limb"))
    for name in ("A", "B"):
        (root / f"sub-{name}/surf/sub-{name}_acq-flex090_nodes.tsv").unlink()
    exit_code, out, _ = run("measure", root, "--json", "--quiet")
    assert exit_code == 3
    faults = json.loads(out)["faults"]
    assert {fault["file"].split("/")[0] for fault in faults} == {"sub-A", "sub-B"}
