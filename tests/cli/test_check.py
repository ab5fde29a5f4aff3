"""kiribench check on the small elbow: results, gates, tables, refusals, the page."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from elbow import elbow_design, elbow_root

from kiribench.cli import main
from kiribench.reference.export import COLUMNS
from kiribench.report.check_words import DRAWN_NOTE
from kiribench.schema.patch_design import write_design


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_design(tmp_path_factory.mktemp("design"), elbow_design(0.6, 0.6))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    def call(*tokens: object) -> tuple[int, str, str]:
        capsys.readouterr()
        exit_code = main(["check", *(str(token) for token in tokens), "--quiet"])
        captured = capsys.readouterr()
        return exit_code, captured.out, captured.err

    return call


QUICK = ("--elements-per-facet", "6", "--samples", "100", "--no-uniform", "--no-placement")


def test_worn_with_everything(design: Path, run: Any, tmp_path: Path) -> None:
    exit_code, out, err = run(
        design, "--subject", elbow_root(), "--elements-per-facet", "8", "--samples", "100",
        "--json", "--out", tmp_path, "--fail-under", "0.999999",
    )  # fmt: skip
    result = json.loads(out)
    assert result["schema"] == "kiribench.check/1"
    assert result["participant"] == "E1"
    assert result["surface"] == "worn"
    given, control = result["designs"]
    assert (given["method"], control["method"]) == ("uniform", "best uniform")
    assert control["share"]["paper"]["mean"] >= given["share"]["paper"]["mean"] - 0.01
    assert list(given["table"][0]) == list(COLUMNS)
    assert len(given["table"]) == 24
    assert given["elements_per_facet"] == 8
    assert given["mesh"]["coarser_elements_per_facet"] == 6
    assert 0 < given["mesh"]["largest_overlap_error"] < 0.1
    assert given["good"] + given["fair"] + given["poor"] == 24
    # The gate is for the designs that were given, not for the control.
    satisfactory = given["share"]["paper"]["fair"]
    assert exit_code == (0 if satisfactory >= 0.999999 else 1)
    assert result["passed"] == (exit_code == 0)
    assert ("check-below-limit" in err) == (exit_code == 1)
    placement = json.loads((tmp_path / "placement.json").read_text())
    assert placement["schema"] == "kiribench.placement/1"
    assert placement == given["placement"]
    assert (tmp_path / "sub-E1_uniform_check.tsv").exists()
    page = (tmp_path / "sub-E1_check.html").read_text()
    for words in ("Predicted is not worn", "best uniform", "How exactly it has to be put on"):
        assert words in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_text_ends_with_a_verdict_that_says_predicted(design: Path, run: Any) -> None:
    exit_code, out, _ = run(design, "--subject", elbow_root(), *QUICK)
    assert exit_code == 0
    last = out.strip().splitlines()[-1]
    assert last.startswith("Verdict: 'uniform' is predicted, as worn")
    assert last.endswith("nobody wore the patch.")
    assert "coarsest there is" in out


def test_flat_and_sticking(design: Path, run: Any) -> None:
    exit_code, out, _ = run(design, "--subject", elbow_root(), "--surface", "flat", *QUICK)
    assert exit_code == 0
    assert "does not lie flat" in out
    _, out, _ = run(
        design, "--subject", elbow_root(), "--friction", "stick", *QUICK, "--json"
    )  # fmt: skip
    stuck = json.loads(out)["designs"][0]
    # What sticks to the skin stays on it.
    assert stuck["friction"] == "stick"
    assert stuck["share"]["iou"]["mean"] > 0.995
    assert stuck["errors"]["longitudinal_strain_largest"] < 0.02


def test_put_on_wrongly_with_friction_and_hoops(design: Path, run: Any) -> None:
    def mean(*tokens: object) -> float:
        exit_code, out, _ = run(design, "--subject", elbow_root(), *QUICK, "--json", *tokens)
        assert exit_code == 0
        return float(json.loads(out)["designs"][0]["share"]["iou"]["mean"])

    free, held, stuck = (
        mean("--friction", friction) for friction in ("0", "0.4", "stick")
    )  # fmt: skip
    # Friction holds corners between the two (see the worn model's tests), not overlaps.
    assert held != pytest.approx(free, abs=1e-4)
    assert max(free, held) < 0.99 < stuck
    # Stuck 2 mm off its place a patch covers four fifths of its cells of 10 mm: their union is
    # larger by as much.
    off = mean("--friction", "stick", "--offset-mm", "0", "2")
    assert off == pytest.approx(8 / 12, abs=0.01)
    assert mean("--strap-slip-mm", "4") != pytest.approx(free, abs=1e-3)
    assert mean("--straps", "hoops") != pytest.approx(free, abs=1e-4)
    _, out, _ = run(design, "--subject", elbow_root(), *QUICK, "--turn-deg", "3")
    assert "turned by 3 degrees" in out


def test_a_pull_is_compared_with_a_table(design: Path, run: Any, tmp_path: Path) -> None:
    table = tmp_path / "other.tsv"
    rows = [f"{r}\t{c}\t1.2\t1.0" for r, c in np.ndindex(6, 4)]
    table.write_text("row\tcol\tlongitudinal_stretch\tlateral_stretch\n" + "\n".join(rows) + "\n")
    exit_code, out, _ = run(
        design, "--surface", "flat", "--pull", "1.2", "--reference", table, *QUICK, "--json"
    )
    assert exit_code == 0
    compared = json.loads(out)["designs"][0]["reference"]
    assert compared["kind"] == "cells"
    summary = compared["simulated_minus_given"]
    assert summary["longitudinal_strain"]["count"] == 24
    # Strapped at both ends, the patch is as long as it was pulled: on average along a column.
    assert abs(summary["longitudinal_strain"]["mean"]) < 0.02
    assert summary["lateral_strain"]["rms"] > 0.005


def test_wrong_calls(design: Path, run: Any, tmp_path: Path) -> None:
    for tokens, code, exit_code in (
        ((design, "--surface", "worn"), "check-no-subject", 2),
        ((design,), "check-no-target", 2),
        ((design, "--reference", "tensile"), "check-no-tensile-data", 2),
        ((design, "--data", tmp_path), "check-data-unused", 2),
        ((design, "--fail-under", "2"), "fail-under-range", 2),
        ((design, "--friction", "-1"), "friction-range", 2),
        ((design, "--friction", "inf"), "friction-range", 2),
        ((design, "--share", "0"), "share-range", 2),
        ((design, "--offset-mm", "0", "nan"), "offset-mm-range", 2),
        ((design, "--turn-deg", "90"), "turn-deg-range", 2),
        ((design, "--strap-slip-mm", "-200"), "strap-slip-mm-range", 2),
        ((design, "--surface", "flat", "--pull", "9"), "pull-range", 2),
        ((design, "--subject", elbow_root(), "--elements-per-facet", "7"), "wear-mesh", 3),
        ((tmp_path / "none.tsv",), "design-missing", 3),
        (
            (design, "--subject", elbow_root(), "--reference", tmp_path / "no.tsv"),
            "reference-missing",
            3,
        ),
    ):
        got, _, err = run(*tokens)
        assert code in err
        assert got == exit_code


def test_a_design_of_another_patch_is_refused(run: Any, tmp_path: Path) -> None:
    other = elbow_design()
    cut = {name: getattr(other, name)[:4] for name in ("a", "b", "region", "reason")}
    path = write_design(tmp_path / "short", replace(other, **cut))
    exit_code, _, err = run(path, "--subject", elbow_root(), *QUICK)
    assert exit_code == 2
    assert "check-shape" in err
    path = write_design(tmp_path / "large", replace(other, cell_mm=15.0))
    exit_code, _, err = run(path, "--subject", elbow_root(), *QUICK)
    assert exit_code == 2
    assert "check-cell" in err


def test_a_design_of_somebody_else_is_refused(design: Path, run: Any, tmp_path: Path) -> None:
    other = write_design(tmp_path / "other", replace(elbow_design(0.6, 0.6), participant="E2"))
    for tokens in (
        (other, "--subject", elbow_root(), "--participant", "E1"),
        (design, other, "--subject", elbow_root()),
        (design, other, "--surface", "flat", "--pull", "1.2"),
    ):
        exit_code, _, err = run(*tokens, *QUICK)
        assert exit_code == 2
        assert "check-other-participant" in err
    exit_code, _, err = run(design, "--subject", elbow_root(), "--participant", "E9")
    assert exit_code in (2, 3)
    assert "E9" in err


def test_cuts_that_are_no_numbers_are_refused(design: Path, run: Any, tmp_path: Path) -> None:
    folder = tmp_path / "broken"
    shutil.copytree(design.parent if design.is_file() else design, folder)
    (table,) = folder.rglob("*_design.tsv")
    lines = table.read_text().splitlines()
    at = lines[0].split("\t").index("a_percent")
    for value in ("nan", "-5", "100", "wide"):
        fields = lines[1].split("\t")
        fields[at] = value
        table.write_text("\n".join([lines[0], "\t".join(fields), *lines[2:]]) + "\n")
        exit_code, _, err = run(table, "--subject", elbow_root(), *QUICK)
        assert exit_code == 3
        assert "error[" in err
        assert "error[bug]" not in err


def test_a_drawn_misfit_is_said_to_be_one(design: Path, run: Any, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(elbow_root(), root)
    # A misfit can only have been drawn where the data is synthetic and there is a worn scan.
    for file in list(root.rglob("*flex090_scan*")):
        shutil.copy(file, file.with_name(file.name.replace("flex090", "flex090worn")))
    _, out, _ = run(design, "--subject", root, *QUICK)
    assert DRAWN_NOTE not in out
    about = root / "dataset_description.json"
    about.write_text(json.dumps({**json.loads(about.read_text()), "Synthetic": True}))
    _, out, _ = run(design, "--subject", root, *QUICK, "--out", tmp_path / "out")
    assert DRAWN_NOTE in out
    assert out.strip().splitlines()[-1].startswith("Verdict")
    assert DRAWN_NOTE in (tmp_path / "out" / "sub-E1_check.html").read_text()
    assert json.loads((tmp_path / "out" / "check.json").read_text())["worn_scan"] == DRAWN_NOTE
    for file in list(root.rglob("*flex090worn*")):
        file.unlink()
    _, out, _ = run(design, "--subject", root, *QUICK)
    assert DRAWN_NOTE not in out


def test_the_sidecar_leads_to_the_subject(run: Any, tmp_path: Path) -> None:
    named = replace(elbow_design(0.6, 0.6), settings={"Dataset": elbow_root().as_posix()})
    path = write_design(tmp_path / "elsewhere", named)
    exit_code, out, _ = run(path, *QUICK, "--json")
    assert exit_code == 0
    assert json.loads(out)["surface"] == "worn"
    assert json.loads(out)["participant"] == "E1"
