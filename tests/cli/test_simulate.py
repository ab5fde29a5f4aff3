"""`kiribench simulate` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from kiribench.cli import main


def test_two_cells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--designs", "35,85;90,90", "--steps", "1.1,1.2", "--mesh-mm", "2.5"]
    assert main([*words, "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "kiribench.simulate/1"
    assert (result["designs"], result["rows"], result["rows_ok"]) == (2, 4, 4)
    assert Path(result["table"]).is_file()
    page = Path(result["report"]).read_text()
    assert (
        "35-85" in page
        and "<script" not in page
        and "http://" not in page.replace("http://www.w3.org", "")
    )
    assert main([*words, "--out", str(tmp_path), "--no-figures"]) == 0
    text = capsys.readouterr().out
    assert "2 designs were there already" in text
    assert text.strip().endswith("Every design reached the last step.")


def test_a_sheet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--model", "sheet", "--designs", "35,85", "--steps", "10,50"]
    assert main([*words, "--mesh-mm", "5", "--out", str(tmp_path)]) == 0
    assert "sheet model" in capsys.readouterr().out
    assert "Deformed sheets" in (tmp_path / "report.html").read_text()


def test_another_programs_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "abaqus.csv"
    table.write_text("a,b,U,strain,nu\n35,85,10,.05,-.4\n35,85,20,.1,-.3\n")
    words = ["simulate", "--from-table", str(table), "--out", str(tmp_path / "out")]
    assert main([*words, "--strain-unit", "fraction"]) == 3
    assert "strain-measure-missing" in capsys.readouterr().err
    assert main([*words, "--strain-unit", "fraction", "--strain-measure", "log"]) == 0
    assert capsys.readouterr().out.strip().endswith("converted to stretches.")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], "out-missing"),
        (["--out", "x", "--strain-measure", "log"], "measure-without-table"),
        (["--out", "x", "--designs", "35;85"], "designs-words"),
        (["--out", "x", "--steps", "ten"], "steps-words"),
        (["--out", "x", "--mesh-mm", "0"], "mesh-edge-range"),
    ],
)
def test_usage(
    words: list[str],
    code: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", *words]) == 2
    assert code in capsys.readouterr().err
