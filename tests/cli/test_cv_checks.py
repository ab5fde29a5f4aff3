"""The numbered checks through the command: each fires on its seeded table, none on a clean one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from stand_in import stand_in_table

from kiribench.cli import main

Seed = Callable[[pd.DataFrame], list[str]]
NOISE = 0.01  # of Poisson's ratio: what a Gaussian process then states holds
CODES = [f"KB{number:03d}" for number in range(1, 11)]


def clean(levels: int = 8) -> pd.DataFrame:
    """64 designs, 5 strains, honest noise above a small mesh error, own folds of whole designs."""
    X, y = stand_in_table(levels, np.linspace(0.1, 0.7, 5))
    rng = np.random.default_rng(0)
    frame = pd.DataFrame(X, columns=["a_percent", "b_percent", "longitudinal_strain"])
    frame["poisson_ratio"] = y + NOISE * rng.standard_normal(len(y))
    frame["mesh_error_poisson"] = 0.1 * NOISE
    designs = levels * levels
    frame["design"] = np.repeat([f"d{k}" for k in range(designs)], 5)
    frame["fold"] = np.repeat(rng.permutation(designs) % 4, 5)
    return frame


def ran(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    seed: Seed,
    *,
    levels: int = 8,
    measure: str = "log",
) -> dict[str, dict[str, str]]:
    """What the checks say of a seeded table: by code, as the JSON has it."""
    frame = clean(levels)
    further = seed(frame)
    table, wanted = folder / "table.csv", folder / "wanted.csv"
    frame.to_csv(table, index=False)
    table.with_suffix(".json").write_text(json.dumps({"StrainMeasure": measure}))
    if not wanted.exists():
        wanted.write_text("longitudinal_strain,poisson_ratio\n0.3,0.3\n")
    arguments = ["--protocols", "grouped,own-folds", "--fold-column", "fold", "--folds", "4"]
    arguments += ["--repeats", "1", "--targets", str(wanted)]
    if "--models" not in further:
        arguments += ["--models", "gp"]
    assert main(["cv", str(table), *arguments, *further, "--json"]) == 0
    captured = capsys.readouterr()
    checks = {one["code"]: one for one in json.loads(captured.out)["checks"]}
    for code, one in checks.items():
        said = f"check-{code.lower()}" in captured.err
        assert said == (one["status"] == "fired" and one["severity"] != "note"), code
    return checks


def test_a_clean_table_is_silent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checks = ran(tmp_path, capsys, lambda frame: [])
    assert list(checks) == CODES
    # Every one of them had something to look at.
    assert {code: one["status"] for code, one in checks.items()} == dict.fromkeys(CODES, "passed")


def rows_of_a_design_apart(frame: pd.DataFrame) -> list[str]:
    frame["fold"] = np.random.default_rng(1).integers(4, size=len(frame))
    return []


def stretches_of_the_table(frame: pd.DataFrame) -> list[str]:
    frame["fold"] = np.arange(len(frame)) * 4 // len(frame)
    return []


def lateral_strain_among_the_inputs(frame: pd.DataFrame) -> list[str]:
    frame["lateral_strain"] = -frame["poisson_ratio"] * frame["longitudinal_strain"]
    inputs = "a_percent,b_percent,longitudinal_strain,lateral_strain"
    return ["--features", inputs, "--target", "poisson_ratio", "--models", "polynomial"]


def trees_of_two_levels(frame: pd.DataFrame) -> list[str]:
    return ["--models", "gp,random_forest:paper"]


def designs_with_errors_of_their_own(frame: pd.DataFrame) -> list[str]:
    # Common to a design's rows: a process of independent errors believes that it knows more.
    errors = 5.0 * NOISE * np.random.default_rng(5).standard_normal(frame["design"].nunique())
    frame["poisson_ratio"] += np.repeat(errors, 5)
    return ["--models", "svgp"]


def uncut_rubber_in_engineering_strain(frame: pd.DataFrame) -> list[str]:
    log = frame["longitudinal_strain"]
    stretch, lateral = np.exp(log), np.exp(-frame["poisson_ratio"] * log)
    frame["longitudinal_strain"] = stretch - 1.0
    frame["poisson_ratio"] = -(lateral - 1.0) / (stretch - 1.0)
    return []


def a_design_twice(frame: pd.DataFrame) -> list[str]:
    copy = frame[frame["design"] == "d9"].copy()
    copy["design"] = "d9-again"
    grown = pd.concat([frame, copy], ignore_index=True)
    for index in range(len(frame), len(grown)):  # in place: the caller writes its own frame
        frame.loc[index] = grown.loc[index]
    return []


def a_coarse_mesh(frame: pd.DataFrame) -> list[str]:
    frame["mesh_error_poisson"] = 5.0 * NOISE
    return []


@pytest.mark.parametrize(
    ("code", "severity", "seed"),
    [
        ("KB001", "error", rows_of_a_design_apart),
        ("KB002", "error", stretches_of_the_table),
        ("KB003", "error", lateral_strain_among_the_inputs),
        ("KB005", "warning", trees_of_two_levels),
        ("KB006", "warning", designs_with_errors_of_their_own),
        ("KB008", "error", uncut_rubber_in_engineering_strain),
        ("KB009", "warning", a_design_twice),
        ("KB010", "note", a_coarse_mesh),
    ],
)
def test_a_seeded_table_is_noticed(
    code: str, severity: str, seed: Seed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checks = ran(tmp_path, capsys, seed)
    assert (checks[code]["status"], checks[code]["severity"]) == ("fired", severity)
    # The own folds of KB002 cut designs at their ends as well.
    others = {other for other in CODES if checks[other]["status"] == "fired"} - {code}
    assert others <= ({"KB001"} if code == "KB002" else set())


def test_kb004_too_few_designs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(tmp_path, capsys, lambda frame: [], levels=6)["KB004"]["status"] == "fired"


def test_kb007_targets_beyond_the_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "wanted.csv").write_text("longitudinal_strain,poisson_ratio\n0.3,0.3\n0.9,0.3\n")
    checks = ran(tmp_path, capsys, lambda frame: [])
    assert {code for code in CODES if checks[code]["status"] == "fired"} == {"KB007"}
    assert "1 of 2 wanted strains" in checks["KB007"]["detail"]
