"""`kiribench design` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from design_toys import drawn_problem, surrogates

from kiribench.cli import main
from kiribench.schema.patch_design import read_design
from kiribench.surrogate.keep import save


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    save(surrogates().poisson, path)
    return path


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    asked, _ = drawn_problem(1, 4, 3)
    path = tmp_path_factory.mktemp("targets") / "sub-K9_targets.tsv"
    lines = ["row\tcol\tlongitudinal_strain\tpoisson_ratio"]
    for r, c in np.ndindex(asked.shape):
        nu = "n/a" if (r, c) == (3, 2) else f"{asked.poisson_ratio[r, c]:.9f}"
        lines.append(f"{r}\t{c}\t{asked.longitudinal_strain[r, c]:.9f}\t{nu}")
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".json").write_text('{"StrainMeasure": "log", "CellMm": 15, "Side": "left"}')
    return path


@pytest.mark.parametrize("method", ["exact", "paper", "balanced", "uniform"])
def test_a_table_to_cuts_and_a_page(
    method: str, table: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(table), "--surrogate", str(model), "--method", method, "--out", str(tmp_path)]
    assert main(["design", *arguments, "--generations", "40", "--json"]) == 0
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert told["schema"] == "kiribench.design/1"
    assert "warning[targets-missing]" in captured.err
    patch = told["patches"][0]
    assert (patch["method"], patch["participant"]) == (method, "K9")
    assert (patch["cells"], patch["with_target"], patch["out_of_reach"]) == (12, 11, 0)
    assert str(table) in told["provenance"]["inputs"]
    assert str(model) in told["provenance"]["inputs"]
    design = read_design(tmp_path / "sub-K9_design.tsv")
    assert design.shape == (4, 3) and design.side == "left" and design.strain_measure == "log"
    assert design.reason[3, 2] == "target-missing"
    error = design.quantity("error")
    predicted = design.quantity("predicted_poisson_ratio")
    np.testing.assert_allclose(
        error, predicted - design.quantity("target_poisson_ratio"), atol=1e-7
    )
    assert np.nanmax(np.abs(error)) == pytest.approx(patch["error"]["largest"], abs=1e-8)
    assert max(design.a.max(), design.b.max()) <= 0.9
    assert design.settings["Limits"]["BoundPercent"] == pytest.approx(90)
    assert "Dataset" not in design.settings
    page = (tmp_path / "design.html").read_text()
    assert page.count("<svg") == (9 if method == "paper" else 8)
    assert ("Generations of CMA-ES" in page) == (method == "paper")
    assert "If strain measures were mixed" in page and "<script" not in page


def test_words_end_with_a_verdict(
    table: Path, model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["design", str(table), "--surrogate", str(model), "--quiet"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("  Verdict: every target is met")
    assert "1 cells had none and are filled in" in last


def test_measures_that_differ_are_refused_or_converted_on_request(
    table: Path, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--surrogate", str(model), "--quiet", "--json"]
    lines = ["row\tcol\tlongitudinal_strain\tpoisson_ratio\tlongitudinal_stretch\tlateral_stretch"]
    # ln 1.25 = .2231, ln .95 / ln 1.25 = -.2299: nu is .2 in engineering strain.
    lines.append("0\t0\t0.25\t0.2\t1.25\t0.95")
    path = tmp_path / "e.tsv"
    path.write_text("\n".join(lines) + "\n")
    assert main(["design", str(path), *arguments]) == 3
    assert "strain-measure-missing" in capsys.readouterr().err
    path.with_suffix(".json").write_text('{"StrainMeasure": "engineering"}')
    assert main(["design", str(path), *arguments]) == 2
    refused = capsys.readouterr().err
    assert "strain-measure-mixed" in refused and "--convert-measure" in refused
    out = ["--convert-measure", "--out", str(tmp_path / "o"), "--no-figures"]
    assert main(["design", str(path), *arguments, *out]) == 0
    design = read_design(tmp_path / "o")
    assert design.quantity("target_longitudinal_strain")[0, 0] == pytest.approx(np.log(1.25))
    assert design.quantity("target_poisson_ratio")[0, 0] == pytest.approx(
        -np.log(0.95) / np.log(1.25), abs=1e-6
    )
    assert not (tmp_path / "o/patch/design.html").exists()


def test_a_dataset_of_two_poses(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from kiribench.cli.command import Common
    from kiribench.cli.design import design

    shipped = Path(__file__).parents[2] / "data/synthetic"
    outcome = design(
        shipped / "sub-S2", surrogate=model, method="uniform", figures=False,
        common=Common(out=tmp_path, quiet=True),
    )  # fmt: skip
    assert outcome.result["patches"][0]["participant"] == "S2"
    found = read_design(tmp_path)
    assert found.shape == (12, 6) and found.cell_mm == 15
    # So that check finds the subject; a table of targets knows of none.
    assert found.settings["Dataset"] == shipped.as_posix()
    assert sorted(set(found.region.ravel())) == ["I", "LI", "LS", "MI", "MS", "P", "S"]


def test_wrong_calls(table: Path, model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = ["design", str(table), "--surrogate", str(model)]
    assert main([*base, "--participant", "S1"]) == 2
    assert "participant-without-dataset" in capsys.readouterr().err
    assert main([*base, "--ligament-mm", "9"]) == 2
    assert "limits-leave-nothing" in capsys.readouterr().err
    for share, meant in (("0.9", "Did you mean 90?"), ("1", "such as 90")):
        assert main([*base, "--longest-percent", share]) == 2
        said = capsys.readouterr().err
        assert "error[limit-percent]" in said and meant in said
    assert main(["design", str(table), "--surrogate", str(table)]) == 3
    assert "model-file-damaged" in capsys.readouterr().err
