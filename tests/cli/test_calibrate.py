"""`kiribench calibrate` from the outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from kiribench.cli import main
from kiribench.schema.tsv import parse_tsv

DATA = Path(__file__).parents[1] / "data" / "dragon_skin_srmd"
CURVE = str(DATA / "Dragon_Skin_20.csv")


def test_dragon_skin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", CURVE, "--cuts", "90,90", "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "kiribench.calibrate/1"
    assert result["test"]["strain_from"] == "crosshead"
    fits = {fit["law"]: fit for fit in result["fits"]}
    assert list(fits) == ["neo-hookean", "ogden", "ogden-2", "yeoh"]
    assert round(fits["ogden"]["parameters"]["alpha"]["value"], 2) == 3.29
    low, high = fits["ogden"]["parameters"]["mu_mpa"]["interval"]
    assert 0.09 < low < 0.112 < high < 0.14
    assert fits["ogden-2"]["terms_vanished"] == 1
    assert fits["yeoh"]["stable"] is False
    assert 1.9 <= result["given_modulus"]["equal_to_fit_up_to_strain"] <= 2.0
    base, other, ogden = result["choice"][0]["laws"]
    np.testing.assert_allclose(base["poisson_ratio"], other["poisson_ratio"], atol=1e-7)
    assert ogden["nominal_stress_mpa"][0] < 0.6 * base["nominal_stress_mpa"][0]
    assert "ODbL" in result["attribution"]
    assert any(name.endswith("SOURCE.txt") for name in map(str, result["provenance"]["inputs"]))
    page = Path(result["report"]).read_text(encoding="utf-8")
    assert "ODbL" in page
    assert "crosshead" in page
    assert "<script" not in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    table, faults = parse_tsv((tmp_path / "fits.tsv").read_bytes(), file="fits.tsv")
    assert not faults
    assert table is not None
    assert table.column("law").count("yeoh") == 3


def test_text_ends_with_the_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", CURVE, "--law", "neo-hookean", "--strain-range", "0:190%"]
    assert main([*words, "--cuts", "none"]) == 0
    text = capsys.readouterr().out
    assert "mu 0.2061" in text
    assert "crosshead" in text
    assert text.strip().splitlines()[-1].endswith("least-squares fit up to strain 1.91.")


def test_force_and_displacement_with_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strain = np.arange(1, 31) / 20
    force = 20 * 0.3 * ((1 + strain) - (1 + strain) ** -2)
    rows = [f"{50 * e:.6f};{f:.9f}".replace(".", ",") for e, f in zip(strain, force, strict=True)]
    path = tmp_path / "pull.csv"
    path.write_text("Displacement (mm);Force (N)\n" + "\n".join(rows), encoding="utf-8")
    words = ["calibrate", str(path), "--law", "neo-hookean", "--cuts", "none", "--json"]
    assert main([*words, "--width-mm", "10", "--thickness-mm", "2", "--length-mm", "50"]) == 0
    result = json.loads(capsys.readouterr().out)
    fit = result["fits"][0]["parameters"]["mu_mpa"]
    assert fit["value"] == pytest.approx(0.3, rel=1e-6)
    assert result["attribution"] is None
    assert main(words) == 3
    faults = json.loads(capsys.readouterr().out)["faults"]
    assert {fault["code"] for fault in faults} == {"curve-sample-missing"}
    assert len(faults) == 2


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--strain-range", "x"], "strain-range"),
        (["--ogden-terms", "4"], "ogden-terms"),
        (["--modulus-mpa", "0"], "modulus"),
        (["--cuts", "0.9,0.9"], "cut-lengths-are-fractions"),
    ],
)
def test_wrong_options(words: list[str], code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", CURVE, *words]) == 2
    assert code in capsys.readouterr().err
