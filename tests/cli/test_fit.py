"""`kiribench fit` and `kiribench predict` from the outside."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from stand_in import stand_in_poisson, stand_in_table

from kiribench.cli import main


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stand-in as a table of stretches, as `kiribench simulate` writes them."""
    X, nu = stand_in_table(6, np.linspace(0.05, 0.75, 10))
    path = tmp_path_factory.mktemp("table") / "space.csv"
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(
            ["a_percent", "b_percent", "longitudinal_stretch", "lateral_stretch", "status"]
        )
        for (a, b, strain), ratio in zip(X, nu, strict=True):
            writer.writerow([a, b, np.exp(strain), np.exp(-ratio * strain), "ok"])
        writer.writerow([5, 5, 1.9, 1.0, "not-converged"])
    return path


@pytest.fixture(scope="module")
def model(table: Path) -> Path:
    path = table.with_name("gp.safetensors")
    assert main(["fit", str(table), "--model", "gp", "--out", str(path), "--quiet"]) == 0
    return path


def test_fit_says_how_well_unseen_designs_are_predicted(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "k.safetensors"
    assert main(["fit", str(table), "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "kiribench.fit/1"
    assert result["strain_measure"] == "log"
    assert result["summary"]["rows"] == 360
    assert result["summary"]["dropped"] == {"not-converged": 1}
    assert result["summary"]["designs_left_out"]["rmse"] < 0.05
    assert result["bytes"] == out.stat().st_size
    assert str(table) in result["provenance"]["inputs"]


def test_predict_at_points(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", str(model), "--at", "50,60,0.3", "--at", "80,20,0.5"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    for row, (a, b, strain) in zip(rows, ((0.5, 0.6, 0.3), (0.8, 0.2, 0.5)), strict=True):
        truth = float(stand_in_poisson(np.array(a), np.array(b), np.array(strain)))
        assert float(row["poisson_ratio"]) == pytest.approx(truth, abs=0.02)
        assert float(row["poisson_ratio_sd"]) > 0
        assert row["inside"] == "true"


def test_predict_a_table_as_json(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.csv"
    points.write_text("a_percent,b_percent,longitudinal_strain\n50,60,0.3\n99,60,0.3\n")
    points.with_suffix(".json").write_text('{"StrainMeasure": "log"}')
    assert main(["predict", str(model), str(points), "--json"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["schema"] == "kiribench.predict/1"
    assert result["inside"] == [True, False]
    assert len(result["poisson_ratio"]) == len(result["sd"]) == 2
    assert "prediction-extrapolates" in captured.err


def test_predict_writes_a_file(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "p.csv"
    assert main(["predict", str(model), "--at", "50,60,0.3", "--out", str(out)]) == 0
    assert len(out.read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("arguments", "code", "exit_code"),
    [
        (["--at", "1,2"], "point-not-three-numbers", 2),
        (["--at", "1,2,x"], "point-not-three-numbers", 2),
        (["--at", "50,50,0.2", "--at", "120,50,0.2"], "cut-length-range", 2),
        (["--at=-5,50,0.2"], "cut-length-range", 2),
        ([], "points-missing", 2),
        (["--at", "50,50,0.2", "--strain-measure", "green"], "strain-measure-mixed", 2),
    ],
)
def test_predict_faults(
    model: Path,
    arguments: list[str],
    code: str,
    exit_code: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["predict", str(model), *arguments, "--json"]) == exit_code
    assert json.loads(capsys.readouterr().out)["faults"][0]["code"] == code


def test_points_in_another_measure_are_refused(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.csv"
    points.write_text("a_percent,b_percent,longitudinal_strain\n50,60,0.3\n")
    points.with_suffix(".json").write_text('{"StrainMeasure": "engineering"}')
    assert main(["predict", str(model), str(points)]) == 2
    assert "strain-measure-mixed" in capsys.readouterr().err


def test_fit_faults(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = str(tmp_path / "x.safetensors")
    for arguments, exit_code, code in (
        ([str(table), "--out", str(tmp_path)], 2, "out-not-safetensors"),
        ([str(table), "--out", good, "--model", "oracle"], 2, "model-unknown"),
        ([str(tmp_path / "no.csv"), "--out", good], 3, "table-missing"),
    ):
        assert main(["fit", *arguments]) == exit_code
        assert code in capsys.readouterr().err
    assert not Path(good).exists()
