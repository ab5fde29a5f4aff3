"""Tables of other programs: checked, never guessed, converted to stretches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from kiribench.errors import TableError
from kiribench.schema.design_space import read_design_space, strain_of_stretch
from kiribench.schema.design_space_convert import convert_table, stretch_of_strain

LONG = np.array([1.1, 1.5, 2.0, 1.1, 1.5])
LATERAL = np.array([1.05, 1.1, 1.2, 0.96, 0.85])


def abaqus(measure: str, scale: float = 1.0, **changes: object) -> pd.DataFrame:
    strain = strain_of_stretch(LONG, measure)
    table: dict[str, object] = {
        "a": [90, 90, 90, 1, 1],
        "b": [90, 90, 90, 5, 5],
        "U [mm]": [10, 50, 120, 10, 50],
        "strain": strain * scale,
        "nu": -strain_of_stretch(LATERAL, measure) / strain,
    }
    return pd.DataFrame(table | changes)


@pytest.mark.parametrize("measure", ["log", "engineering", "green"])
@pytest.mark.parametrize(("unit", "scale"), [("fraction", 1.0), ("percent", 100.0)])
def test_stretches_come_back(measure: str, unit: str, scale: float, tmp_path: Path) -> None:
    path = tmp_path / "abaqus.csv"
    abaqus(measure, scale).sample(frac=1, random_state=1).to_csv(path, index=False)
    converted = convert_table(path, tmp_path / "out", strain_measure=measure, strain_unit=unit)
    space = read_design_space(converted.file)
    order = [3, 4, 0, 1, 2]
    assert space.longitudinal_stretch is not None and space.lateral_stretch is not None
    np.testing.assert_allclose(space.longitudinal_stretch, LONG[order], rtol=1e-8)
    np.testing.assert_allclose(space.lateral_stretch, LATERAL[order], rtol=1e-8)
    assert converted.frame["step"].tolist() == [1, 2, 1, 2, 3]
    assert converted.frame["displacement_mm"].tolist() == [10, 50, 10, 50, 120]
    assert [fault.code for fault in converted.notes] == ["cut-unit-concluded"]
    assert space.sidecar["ConvertedFrom"]["StrainMeasure"] == measure


def test_the_measure_matters() -> None:
    """One strain is three stretches, and one stretch three strains."""
    strain = np.array([0.5])
    found = [float(stretch_of_strain(strain, m)[0]) for m in ("log", "engineering", "green")]
    np.testing.assert_allclose(found, [np.exp(0.5), 1.5, np.sqrt(2.0)])
    assert np.isnan(stretch_of_strain(np.array([-1.5]), "engineering")[0])
    assert np.isnan(stretch_of_strain(np.array([-0.6]), "green")[0])


@pytest.mark.parametrize(
    ("frame", "options", "code"),
    [
        (abaqus("log"), {"strain_unit": "fraction"}, "strain-measure-missing"),
        (abaqus("log"), {"strain_measure": "log"}, "strain-unit-missing"),
        (
            abaqus("log").rename(columns={"strain": "strain [%]"}),
            {"strain_measure": "log", "strain_unit": "fraction"},
            "strain-unit-conflict",
        ),
        (
            abaqus("log", strain_measure="green"),
            {"strain_measure": "log"},
            "strain-measure-conflict",
        ),
        (abaqus("log").drop(columns="nu"), {}, "column-missing"),
        (abaqus("log", poisson=0.1), {}, "column-twice"),
        (abaqus("log").rename(columns={"strain": "strain [furlong]"}), {}, "unit-unknown"),
        (abaqus("log", nu=["x", 0, 0, 0, 0]), None, "value-no-number"),
        (abaqus("log", a=[190, 90, 90, 1, 1]), None, "value-out-of-range"),
        (abaqus("log", strain=[9.0, 0.4, 0.7, 0.1, 0.4]), None, "value-out-of-range"),
        (abaqus("log", strain=[0.0, 0.4, 0.7, 0.1, 0.4]), None, "strain-zero"),
        (abaqus("log", strain=[0.4, 0.4, 0.7, 0.1, 0.4]), None, "step-twice"),
        (abaqus("log", strain=[0.5, 0.4, 0.7, 0.1, 0.4]), None, "steps-disagree"),
        (abaqus("log", a=[1, 1, 1, 1, 1], b=[1, 1, 1, 0, 0]), None, "cut-unit-missing"),
        (
            abaqus("log").rename(columns={"a": "a_percent", "b": "b_fraction"}),
            None,
            "cut-unit-conflict",
        ),
    ],
)
def test_faults(
    frame: pd.DataFrame, options: dict[str, str] | None, code: str, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv"
    frame.to_csv(path, index=False)
    given = {"strain_measure": "log", "strain_unit": "fraction"} if options is None else options
    with pytest.raises(TableError) as caught:
        convert_table(path, tmp_path / "out", **given)
    assert caught.value.code == code
    assert not (tmp_path / "out").exists()


def test_the_missing_measure_says_why_it_matters(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    abaqus("log").to_csv(path, index=False)
    with pytest.raises(TableError, match=r"ratio of strains.*in log and.*in engineering"):
        convert_table(path, tmp_path / "out", strain_unit="fraction")


def test_units_in_the_names_need_no_option(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    frame = abaqus("green", 100.0, a=[0.9, 0.9, 0.9, 0.01, 0.01], b=[0.9, 0.9, 0.9, 0.05, 0.05])
    frame.columns = ["a (-)", "b (-)", "Displacement", "Strain [%]", "Poisson's ratio"]
    frame.to_csv(path, index=False)
    path.with_suffix(".json").write_text('{"StrainMeasure": "green"}')
    converted = convert_table(path, tmp_path / "out")
    assert converted.notes == ()
    assert converted.cut_unit == "fraction"
    assert converted.frame["design"].unique().tolist() == ["1-5", "90-90"]
    np.testing.assert_allclose(converted.frame["longitudinal_stretch"][2:], LONG[:3], rtol=1e-8)
    assert converted.inputs == (path, path.with_suffix(".json"))
