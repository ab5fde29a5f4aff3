"""``kiribench cv`` from the outside."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from sklearn.datasets import load_diabetes, load_linnerud
from stand_in import stand_in_table

from kiribench.cli import main
from kiribench.validation.table1 import PAPER_R2

MODELS = "gp,gradient_boosting:paper,random_forest:paper,polynomial"


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stand-in as a table of strains with a declared measure, one more column, one edge."""
    X, y = stand_in_table(5, np.linspace(0.05, 0.75, 9))
    path = tmp_path_factory.mktemp("space") / "space.csv"
    frame = pd.DataFrame(X, columns=["a_percent", "b_percent", "longitudinal_strain"])
    frame["poisson_ratio"] = y
    frame["mesh_error_poisson"] = 0.02
    frame["half"] = np.where(X[:, 0] < 50, "low", "high")
    frame.to_csv(path, index=False)
    path.with_suffix(".json").write_text('{"StrainMeasure": "log"}')
    return path


@pytest.fixture(scope="module")
def done(space: Path) -> tuple[dict[str, Any], Path]:
    out = space.parent / "out"
    arguments = ["cv", str(space), "--models", MODELS, "--folds", "5", "--repeats", "1"]
    code = main([*arguments, "--fold-column", "half", "--out", str(out), "--quiet"])
    assert code == 0
    return json.loads((out / "cv.json").read_text()), out


def test_the_object_is_as_declared(done: tuple[dict[str, Any], Path]) -> None:
    result, _ = done
    assert result["schema"] == "kiribench.cv/1"
    gp = result["protocols"]["grouped"]["gp"]
    for score in ("r2", "rmse", "rmse_over_mesh_error", "max_error", "nlpd", "crps",
                  "coverage50", "coverage80", "coverage95", "fit_s", "predict_s"):  # fmt: skip
        assert set(gp[score]) == {"mean", "sd", "pooled"}
        assert isinstance(gp[score]["pooled"], float)
    assert gp["rmse_over_mesh_error"]["pooled"] == pytest.approx(gp["rmse"]["pooled"] / 0.02)
    assert [pair[0] for pair in gp["calibration"]] == sorted(p[0] for p in gp["calibration"])
    assert result["protocols"]["grouped"]["polynomial"]["nlpd"]["pooled"] is None
    assert set(result["protocols"]) == {
        "grouped", "leave-design-out", "leave-level-a-out", "leave-level-b-out", "blocks", "edge",
        "learning-curve", "shuffled", "contiguous", "one-row", "own-folds",
    }  # fmt: skip
    curve = result["protocols"]["learning-curve"]["gp"]["curve"]
    assert [point["groups"] for point in curve] == [5, 10, 20]
    assert curve[-1]["rmse"]["mean"] < curve[0]["rmse"]["mean"]


def test_the_ranking_the_gap_and_the_checks_are_there(done: tuple[dict[str, Any], Path]) -> None:
    result, _ = done
    places = result["ranking"]["grouped"]["places"]
    assert places[0]["model"] == "gp" and places[0]["words"] == "best"
    assert all("p_adjusted" in place["against_best"] for place in places[1:])
    assert result["leakage"]["gp"]["rmse_ratio"] > 1.0
    place = result["by_place"]["gp"]
    pooled = result["protocols"]["grouped"]["gp"]["rmse"]["pooled"]
    # 9 of 25 designs lie inside, and the two parts make up the whole.
    both = (9 * place["inside"]["rmse"] ** 2 + 16 * place["rim"]["rmse"] ** 2) / 25
    assert both == pytest.approx(pooled**2, rel=1e-9)
    assert place["inside"]["rmse"] < place["rim"]["rmse"]
    codes = {one["code"]: one["status"] for one in result["checks"]}
    assert len(codes) == 10 and codes["KB001"] == "fired" and codes["KB003"] == "passed"


def test_the_statement_about_table_1_follows_from_the_runs(
    done: tuple[dict[str, Any], Path],
) -> None:
    result, _ = done
    found = result["table1"]
    assert found["paper_r2"] == PAPER_R2
    for row, nearest in found["nearest"].items():
        run = result["protocols"][nearest["protocol"]][nearest["model"]]
        assert nearest["r2"] == run["r2"]["mean"]
        for models in result["protocols"].values():
            same = models[nearest["model"]]["r2"]["mean"]
            if models in [result["protocols"][name] for name in found["joint"]]:
                assert abs(nearest["r2"] - PAPER_R2[row]) <= abs(same - PAPER_R2[row]) + 1e-12
    assert any(f"{PAPER_R2['GP']:.4f}" in sentence for sentence in found["statement"])


class Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.loads: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if key == "id" and value:
                self.ids.append(value)
            if key in ("src", "href") and value and not value.startswith(("#", "data:")):
                self.loads.append(value)

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_report_is_whole_and_loads_nothing(done: tuple[dict[str, Any], Path]) -> None:
    result, out = done
    reader = Reader()
    reader.feed((out / "cv.html").read_text(encoding="utf-8"))
    assert reader.loads == []
    for section in ("ranking", "table1", "protocols", "residuals", "calibration", "learning",
                    "time", "checks", "record"):  # fmt: skip
        assert section in reader.ids
    assert len(reader.ids) == len(set(reader.ids))
    shown = " ".join(reader.words)
    assert format(result["protocols"]["grouped"]["gp"]["r2"]["pooled"], ".5f") in shown
    assert "0.9969" in shown and "KB010" in shown


def test_gates(space: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["cv", str(space), "--models", "polynomial", "--protocols", "grouped"]
    arguments += ["--folds", "4", "--repeats", "1", "--quiet"]
    assert main([*arguments, "--fail-under", "r2=0.5"]) == 0
    limits = ["--fail-under", "polynomial.rmse=1e-9", "--fail-under", "r2=0.9999"]
    assert main([*arguments, *limits]) == 1
    assert "worse than the limit" in capsys.readouterr().out
    for wrong in ("r2", "beauty=1", "r2=high"):
        assert main([*arguments, "--fail-under", wrong]) == 2


@pytest.mark.parametrize(
    ("arguments", "code", "exit_code"),
    [
        (["--models", "oracle"], "model-unknown", 2),
        (["--protocols", "loocv"], "protocol-unknown", 2),
        (["--features", "a_percent"], "features-without-target", 2),
        (["--group-column", "nobody"], "column-missing", 3),
        (["--jobs", "0"], "jobs-range", 2),
        (["--folds", "1"], "cv-setting-range", 2),
    ],
)
def test_faults(
    space: Path,
    arguments: list[str],
    code: str,
    exit_code: int,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["cv", str(space), *arguments, "--json"]) == exit_code
    assert json.loads(capsys.readouterr().out)["faults"][0]["code"] == code


def test_wanted_targets_in_another_measure(
    space: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = tmp_path / "wanted.tsv"
    wanted.write_text(
        "longitudinal_strain\tpoisson_ratio\tstrain_measure\n0.3\t0.3\tengineering\n\t\t\n"
    )
    arguments = ["--models", "polynomial", "--protocols", "grouped", "--targets", str(wanted)]
    assert main(["cv", str(space), *arguments, "--json"]) == 0
    captured = capsys.readouterr()
    checks = {one["code"]: one for one in json.loads(captured.out)["checks"]}
    assert checks["KB008"]["severity"] == "error"
    assert checks["KB007"]["status"] == "passed"
    assert "check-kb008" in captured.err


def test_a_table_of_patients(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """scikit-learn's diabetes: 442 patients, ten inputs, own folds; ours equals theirs."""
    from sklearn.ensemble import RandomForestRegressor
    from sklearn.metrics import r2_score
    from sklearn.model_selection import PredefinedSplit, cross_val_predict

    data = load_diabetes(as_frame=True, scaled=False)
    fold = np.random.default_rng(0).integers(5, size=len(data.target))
    path = tmp_path / "diabetes.csv"
    data.frame.assign(fold=fold).to_csv(path, index=False)
    arguments = ["--features", ",".join(data.data.columns), "--target", "target"]
    arguments += ["--fold-column", "fold", "--protocols", "own-folds,contiguous"]
    models = ["--models", "polynomial:tuned,random_forest:paper", "--budget", "0"]
    assert main(["cv", str(path), *arguments, *models, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["table"]["rows"] == 442 and result["table1"] is None
    theirs = cross_val_predict(
        RandomForestRegressor(n_estimators=100, max_depth=2, random_state=0),
        data.data.to_numpy(),
        data.target.to_numpy(),
        cv=PredefinedSplit(fold),
    )
    ours = result["protocols"]["own-folds"]["random_forest:paper"]["r2"]["pooled"]
    assert ours == pytest.approx(r2_score(data.target, theirs), rel=1e-9)
    # Ten inputs and 350 rows: anything above a plane over-fits, and the inner folds know it.
    tuned = result["protocols"]["own-folds"]["polynomial:tuned"]
    assert tuned["notes"]["chosen"] == {"degree": 1}
    assert tuned["r2"]["pooled"] > 0.4


def test_a_table_with_groups_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """scikit-learn's linnerud: 20 people; the same exercise counts belong together."""
    data = load_linnerud(as_frame=True)
    frame = data.frame.assign(bout=data.frame["Chins"].astype(int))
    path = tmp_path / "linnerud.csv"
    frame.to_csv(path, index=False)
    arguments = ["--features", "Chins", "Situps", "Jumps", "--target", "Waist"]
    arguments += ["--group-column", "bout", "--folds", "5", "--repeats", "1"]
    assert main(["cv", str(path), *arguments, "--models", "gp,polynomial", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["table"]["groups"] == frame["bout"].nunique()
    for info in result["protocol_info"].values():
        assert "design" not in info["title"] + info["question"]
    assert set(result["protocols"]) == {
        "grouped", "leave-design-out", "learning-curve", "shuffled", "contiguous", "one-row",
    }  # fmt: skip
    status = {one["code"]: one["status"] for one in result["checks"]}
    assert status["KB004"] == "fired" and status["KB008"] == "not applicable"
