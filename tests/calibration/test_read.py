"""Tension tests as machines write them, and files that are none: each with its own error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kiribench.calibration.curve import Sample, StrainRange
from kiribench.calibration.read import read_curve
from kiribench.errors import KiribenchError, UsageError

DATA = Path(__file__).parents[1] / "data" / "dragon_skin_srmd"
STRAIN = np.arange(1, 21) / 20
STRESS = 0.3 * ((1 + STRAIN) - (1 + STRAIN) ** -2)
SAMPLE = Sample(50.0, 10.0, 2.0)


def write(path: Path, head: list[str], columns: list[np.ndarray], *, sep: str = ",",
          comma: bool = False, quote: bool = False) -> Path:  # fmt: skip
    lines = list(head)
    for row in zip(*columns, strict=True):
        fields = [f"{value:.9g}" for value in row]
        if comma:
            fields = [field.replace(".", ",") for field in fields]
        if quote:
            fields = [f'"{field}"' for field in fields]
        lines.append(sep.join(fields))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_the_database_format() -> None:
    curve = read_curve(DATA / "Dragon_Skin_20.csv")
    assert curve.source == "crosshead"
    assert curve.sample == Sample(33.0, 6.0, 3.0)
    assert curve.columns == ("Engineering Strain", "Engineering Stress (MPa)")
    assert (len(curve.stretch), curve.line[0]) == (404, 19)
    np.testing.assert_allclose(curve.strain[[0, -1]], [0.0446, 9.20455])
    np.testing.assert_allclose(curve.stress_mpa[[0, -1]], [0.009343333, 4.434225],
                               rtol=1e-6)  # fmt: skip


FORMATS = {
    "plain": (["Engineering strain (-),Engineering stress (MPa)"], [STRAIN, STRESS], {}),
    "percent and kPa": (
        ["Engineering strain [%],Engineering stress [kPa]"], [100 * STRAIN, 1000 * STRESS], {},
    ),
    "stretch": (["Stretch,Nominal stress (MPa)"], [1 + STRAIN, STRESS], {}),
    "true": (
        ["True strain (-);True stress (MPa)"], [np.log1p(STRAIN), STRESS * (1 + STRAIN)],
        {"sep": ";"},
    ),
    "machine": (
        ["Specimen,7", "", "Time,Displacement,Force", "(s),(mm),(N)"],
        [STRAIN, 50 * STRAIN, 20 * STRESS], {},
    ),
    "machine, decimal commas": (
        ["Zeit;x", "Time;Extension;Load", "s;mm;N"], [STRAIN, 50 * STRAIN, 20 * STRESS],
        {"sep": ";", "comma": True},
    ),
    "quoted decimal commas": (
        ["Displacement (mm),Force (N)"], [50 * STRAIN, 20 * STRESS], {"comma": True, "quote": True},
    ),
    "tabs, cm and kN": (
        ["Displacement (cm)\tForce (kN)"], [5 * STRAIN, 0.02 * STRESS], {"sep": "\t"},
    ),
    "inches and pounds": (
        ["Displacement (in),Force (lbf)"], [50 * STRAIN / 25.4, 20 * STRESS / 4.4482216152605], {},
    ),
    "lengths in the header": (
        ["Specimen Length (cm),5", "Width (mm),10", "Thickness (mm),2", "Cross-section (mm2),20",
         "Displacement (mm),Force (N)"],
        [50 * STRAIN, 20 * STRESS], {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_curve(name: str, tmp_path: Path) -> None:
    head, columns, how = FORMATS[name]
    path = write(tmp_path / "test.csv", head, columns, **how)
    curve = read_curve(path, sample=None if "header" in name else SAMPLE)
    np.testing.assert_allclose(curve.strain, STRAIN, rtol=1e-7)
    np.testing.assert_allclose(curve.stress_mpa, STRESS, rtol=1e-7)


def test_undeclared_kind_is_given(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", ["Strain (-),Stress (MPa)"], [STRAIN, STRESS])
    with pytest.raises(KiribenchError) as caught:
        read_curve(path)
    assert caught.value.code == "curve-kind-missing"
    np.testing.assert_allclose(read_curve(path, kind="engineering").stress_mpa, STRESS)
    true = read_curve(path, kind="true")
    np.testing.assert_allclose(true.stretch, np.exp(STRAIN))
    np.testing.assert_allclose(true.stress_mpa, STRESS / np.exp(STRAIN))


def test_where_the_strain_comes_from(tmp_path: Path) -> None:
    travel = write(tmp_path / "a.csv", ["Displacement (mm),Force (N)"], [STRAIN, STRESS])
    assert read_curve(travel, sample=SAMPLE).source == "crosshead"
    video = write(tmp_path / "b.csv", ["Engineering strain video (-),Engineering stress (MPa)"],
                  [STRAIN, STRESS])  # fmt: skip
    assert read_curve(video).source == "camera"
    bare = write(tmp_path / "c.csv", ["Engineering strain (-),Engineering stress (MPa)"],
                 [STRAIN, STRESS])  # fmt: skip
    assert read_curve(bare).source == "unknown"
    assert read_curve(bare, strain_from="extensometer").source == "extensometer"


def test_slack_failure_and_standing_rows_are_left_out_and_named(tmp_path: Path) -> None:
    strain = np.concatenate([[-1e-3, 0.0], STRAIN, [1.0, 1.05, 1.1]])
    stress = np.concatenate([[0.0, 1e-4], STRESS, [STRESS[-1], 0.05, 0.0]])
    path = write(tmp_path / "t.csv", ["Engineering strain (-),Engineering stress (MPa)"],
                 [strain, stress])  # fmt: skip
    curve = read_curve(path)
    np.testing.assert_allclose(curve.strain, STRAIN)
    assert {fault.code for fault in curve.notes} >= {"curve-slack", "curve-failure"}
    assert all(fault.severity == "warning" for fault in curve.notes)
    assert curve.line[0] == 4


ENGINEERING = "Engineering strain (-),Engineering stress (MPa)"
BAD = {
    "curve-no-table": (["nothing here"], []),
    "curve-no-header": ([], [STRAIN, STRESS]),
    "curve-column-missing": (["Engineering strain (-),Time (s)"], [STRAIN, STRESS]),
    "curve-unit": (["Engineering strain (-),Engineering stress (bar)"], [STRAIN, STRESS]),
    "curve-unit-missing": (["Engineering strain (-),Engineering stress"], [STRAIN, STRESS]),
    "curve-column-twice": (
        ["Engineering strain (-),Nominal strain (-),Engineering stress (MPa)"],
        [STRAIN, STRAIN, STRESS],
    ),
    "curve-sample-missing": (["Displacement (mm),Force (N)"], [STRAIN, STRESS]),
    "curve-too-short": ([ENGINEERING], [STRAIN[:6], STRESS[:6]]),
    "curve-compressive": ([ENGINEERING], [-STRAIN, -STRESS]),
    "curve-not-monotonic": (
        [ENGINEERING],
        [np.concatenate([STRAIN, STRAIN[::-1]]), np.concatenate([STRESS, 0.98 * STRESS[::-1]])],
    ),
    "curve-value": ([ENGINEERING], [np.where(STRAIN == 0.5, np.nan, STRAIN), STRESS]),
    "curve-sample-conflict": (
        ["Width (mm),10", "Thickness (mm),2", "Cross-section (mm2),30", ENGINEERING],
        [STRAIN, STRESS],
    ),
    "curve-kinds-disagree": (
        ["Engineering strain,True strain,Engineering stress (MPa)"], [STRAIN, STRAIN, STRESS],
    ),
}  # fmt: skip


@pytest.mark.parametrize("code", BAD)
def test_bad_files_are_named(code: str, tmp_path: Path) -> None:
    head, columns = BAD[code]
    with pytest.raises(KiribenchError) as caught:
        read_curve(write(tmp_path / "bad.csv", head, columns))
    assert caught.value.code == code
    assert caught.value.exit_code == 3
    assert caught.value.faults[0].remedy


def test_where_a_bad_row_is(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", ["x,y", ENGINEERING],
                 [np.concatenate([STRAIN[:10], STRAIN[5:15]]), STRESS])  # fmt: skip
    with pytest.raises(KiribenchError) as caught:
        read_curve(path)
    assert (caught.value.code, caught.value.faults[0].row) == ("curve-not-monotonic", 13)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("Displacement (mm);Force (N)\n1,5;2.5\n2,5;3.5\n3,5;4.5\n", "curve-decimal-mixed"),
        ('Displacement (mm);Force (N)\n"1.234,5";2,5\n2,5;3,5\n3,5;4,5\n', "curve-decimal-mixed"),
        ("Displacement (mm),Force (N)\n1,5,2,5\n2,5,3,5\n3,5,4,5\n", "curve-decimal-separator"),
        ("", "curve-no-table"),
    ],
)
def test_decimal_marks(text: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(KiribenchError) as caught:
        read_curve(path, sample=SAMPLE)
    assert caught.value.code == code


def test_no_file_and_no_text(tmp_path: Path) -> None:
    with pytest.raises(KiribenchError) as caught:
        read_curve(tmp_path / "none.csv")
    assert caught.value.code == "curve-missing"
    (tmp_path / "t.csv").write_bytes(b"\xff\xfea\x00")
    with pytest.raises(KiribenchError) as caught:
        read_curve(tmp_path / "t.csv")
    assert caught.value.code == "text-encoding"


def test_wrong_units_are_doubted(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", ["Engineering strain (-),Engineering stress (GPa)"],
                 [STRAIN, 1000 * STRESS])  # fmt: skip
    assert "curve-implausible" in {fault.code for fault in read_curve(path).notes}


def test_strain_ranges() -> None:
    assert StrainRange.parse("0:190%") == StrainRange(0.0, 1.9)
    assert StrainRange.parse("0.5") == StrainRange(0.0, 0.5)
    for text in ("1:0", "a", "0:inf", "-1:1", "1:2:3", ""):
        with pytest.raises(UsageError) as caught:
            StrainRange.parse(text)
        assert caught.value.code == "strain-range"
