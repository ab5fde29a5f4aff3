"""kiribench tensile: files, JSON, words, exit codes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tolerances import TENSILE_NU, TENSILE_STRAIN

from kiribench.cli import main
from kiribench.fem.facet import MeshSpec
from kiribench.reference.tensile import (
    TensileComparison,
    TensileOptions,
    compare_tensile,
    uniform_design,
)
from kiribench.reference.tensile_specimen import stated_specimen
from kiribench.schema.patch_design import PatchDesign, write_design
from kiribench.tensile import TensileTest, read_tensile

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "data" / "synthetic" / "tensile"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*tokens: object) -> tuple[int, str, str]:
        capsys.readouterr()
        exit_code = main([str(token) for token in tokens])
        captured = capsys.readouterr()
        return exit_code, captured.out, captured.err

    return call


def test_the_example_to_curve_page_and_overlays(run: Any, tmp_path: Path) -> None:
    exit_code, out, _ = run("tensile", EXAMPLE, "--out", tmp_path, "--json", "--quiet")
    assert exit_code == 0
    result = json.loads(out)
    assert result["schema"] == "kiribench.tensile/1"
    truth = json.loads((EXAMPLE / "truth.json").read_text())
    along = np.log(np.array(truth["longitudinal_stretch"])).reshape(7, -1)
    across = np.log(np.array(truth["lateral_stretch"])).reshape(7, -1)
    nu = -across[1:] / along[1:]
    for row, strain in zip(result["curve"], along, strict=True):
        assert row["longitudinal_strain_mean"] == pytest.approx(strain.mean(), abs=TENSILE_STRAIN)
    for row, ratio in zip(result["curve"][1:], nu, strict=True):
        assert row["poisson_ratio_mean"] == pytest.approx(ratio.mean(), abs=TENSILE_NU)
        assert row["poisson_ratio_sd"] == pytest.approx(ratio.std(ddof=1), abs=TENSILE_NU)
    assert result["curve"][0]["poisson_ratio_mean"] is None
    assert {path.name for path in tmp_path.iterdir()} == {
        "cells.tsv",
        "cells.json",
        "curve.tsv",
        "curve.json",
        "tensile.json",
        "tensile.html",
        "overlay_first.png",
        "overlay_middle.png",
        "overlay_last.png",
    }
    page = (tmp_path / "tensile.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 3
    assert "Every cell was measured in every frame" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    back = read_tensile(tmp_path)
    assert back.measured.all()
    # What a comparison needs of the sample goes from the pictures' sidecar to the tables'.
    said = json.loads((EXAMPLE / "tensile.json").read_text())["Specimen"]
    assert back.record["Specimen"] == said
    assert back.record["SpecimenNotes"]["a_percent"] == 80
    believed = stated_specimen(uniform_design(0.8, 0.8, 8, 4, 10.0), back)
    assert (believed.grip_mm, believed.row, believed.column) == (10.0, 2, 1)
    assert {Path(name).name for name in result["provenance"]["inputs"]} >= {
        "tensile.json",
        "machine.csv",
        "frame_000.png",
    }


def test_words_end_with_a_verdict_and_follow_the_measure(run: Any) -> None:
    exit_code, out, _ = run("tensile", EXAMPLE, "--strain-measure", "engineering", "--quiet")
    assert exit_code == 0
    assert "engineering strain" in out
    assert out.strip().splitlines()[-1].startswith("  Verdict: 48 of 48 readings")
    assert "strain up to 0.51" in out


def test_bad_frames_end_with_exit_code_3(run: Any, tmp_path: Path) -> None:
    folder = tmp_path / "bad"
    shutil.copytree(EXAMPLE, folder)
    data = (folder / "frame_003.png").read_bytes()
    (folder / "frame_003.png").write_bytes(data[:1000])
    exit_code, out, err = run("tensile", folder, "--json")
    assert exit_code == 3
    assert json.loads(out)["faults"][0]["code"] == "frame-truncated"
    assert "frame_003.png" in err


def test_wrong_options_are_named(run: Any) -> None:
    assert run("tensile", EXAMPLE, "--zncc", 2)[0] == 2
    exit_code, _, err = run("tensile", EXAMPLE, "--out", EXAMPLE)
    assert exit_code == 2
    assert "out-is-input" in err


def test_check_takes_tables_or_pictures_and_names_every_page(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two designs by one method: two pages; all that was read is in the record."""

    def quick(design: PatchDesign, test: TensileTest) -> TensileComparison:
        specimen = replace(stated_specimen(design, test), mesh=MeshSpec(1.0, 1.0, 0.6))
        return compare_tensile(design, test, options=TensileOptions(specimen, explain=False))

    monkeypatch.setattr("kiribench.reference.tensile.compare_tensile", quick)
    plans = []
    for name, a in (("one", 0.8), ("two", 0.7)):
        (tmp_path / name).mkdir()
        plans.append(write_design(tmp_path / name, uniform_design(a, 0.8, 8, 4, 10.0)))
    tables = tmp_path / "tables"
    run("tensile", EXAMPLE, "--out", tables, "--no-report", "--quiet")
    found = {}
    for kind, data in (("pictures", EXAMPLE), ("tables", tables)):
        out = tmp_path / kind
        exit_code, text, _ = run(
            "check", *plans, "--reference", "tensile", "--data", data, "--out", out,
            "--json", "--quiet",
        )  # fmt: skip
        assert exit_code == 0
        found[kind] = json.loads(text)
        assert {path.name for path in out.glob("*.html")} == {
            "given_tensile.html",
            "given-2_tensile.html",
        }
    distances = [one["distance_poisson_ratio"]["value"] for one in found["tables"]["designs"]]
    assert distances[0] < 0.02 < distances[1]
    again = [one["distance_poisson_ratio"]["value"] for one in found["pictures"]["designs"]]
    np.testing.assert_allclose(distances, again, atol=1e-6)
    read = {
        kind: [Path(name).name for name in one["provenance"]["inputs"]]
        for kind, one in found.items()
    }
    assert read["tables"].count("design.tsv") == 2
    assert {"cells.tsv", "curve.tsv"} <= {*read["tables"]}
    assert {"frame_006.png", "tensile.json", "machine.csv"} <= {*read["pictures"]}
