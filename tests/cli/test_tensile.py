"""kiribench tensile: files, JSON, words, exit codes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tolerances import TENSILE_NU, TENSILE_STRAIN

from kiribench.cli import main
from kiribench.tensile import read_tensile

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
