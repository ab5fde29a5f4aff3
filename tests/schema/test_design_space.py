"""Design space tables: both forms, strain measures, and every way to be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from kiribench.errors import TableError
from kiribench.schema.design_space import read_design_space, read_points


def stretches(**changes: object) -> pd.DataFrame:
    table: dict[str, object] = {
        "design": ["x", "x", "y", "y"],
        "a_percent": [10, 10, 90, 90],
        "b_percent": [20, 20, 90, 90],
        "step": [1, 2, 1, 2],
        "longitudinal_stretch": [1.1, 1.2, 1.1, 1.2],
        "lateral_stretch": [0.96, 0.93, 1.08, 1.15],
        "mesh_error_poisson": [0.01, 0.01, 0.02, 0.02],
        "status": ["ok", "ok", "ok", "ok"],
    }
    return pd.DataFrame(table | changes)


def strains(**changes: object) -> pd.DataFrame:
    table: dict[str, object] = {
        "a_percent": [10, 10, 50, 90],
        "b_percent": [20, 20, 50, 90],
        "longitudinal_strain": [0.1, 0.2, 0.1, 0.2],
        "poisson_ratio": [0.4, 0.3, -0.8, -0.7],
    }
    return pd.DataFrame(table | changes)


def written(frame: pd.DataFrame, path: Path, sidecar: str | None = None) -> Path:
    if path.suffix == ".parquet":
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False, sep="\t" if path.suffix == ".tsv" else ",")
    if sidecar is not None:
        path.with_suffix(".json").write_text(sidecar)
    return path


@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".parquet"])
def test_stretches_give_log_strains(suffix: str, tmp_path: Path) -> None:
    space = read_design_space(written(stretches(), tmp_path / f"t{suffix}"))
    long, lateral = np.array([1.1, 1.2, 1.1, 1.2]), np.array([0.96, 0.93, 1.08, 1.15])
    assert space.measure == "log"
    np.testing.assert_allclose(space.longitudinal_strain, np.log(long))
    np.testing.assert_allclose(space.poisson_ratio, -np.log(lateral) / np.log(long))
    assert space.design.tolist() == [0, 0, 1, 1]
    assert space.design_names == ("x", "y")
    assert space.mesh_error_poisson is not None
    assert space.inputs.shape == (4, 3)


@pytest.mark.parametrize(
    ("measure", "strain"), [("engineering", 0.1), ("green", 0.105), ("log", np.log(1.1))]
)
def test_stretches_in_another_measure(measure: str, strain: float, tmp_path: Path) -> None:
    space = read_design_space(written(stretches(), tmp_path / "t.csv"), measure=measure)
    assert space.longitudinal_strain[0] == pytest.approx(strain)
    assert space.measure == measure


def test_rows_that_failed_or_have_no_strain_are_dropped_and_counted(tmp_path: Path) -> None:
    frame = stretches(
        status=["ok", "not-converged", "ok", "ok"],
        longitudinal_stretch=[1.1, np.nan, 1.0, 1.2],
    )
    space = read_design_space(written(frame, tmp_path / "t.csv"))
    assert space.dropped == {"not-converged": 1, "zero-strain": 1}
    assert space.table_row.tolist() == [1, 4]


def test_strains_with_a_declared_measure(tmp_path: Path) -> None:
    path = written(strains(), tmp_path / "t.csv", '{"StrainMeasure": "engineering"}')
    space = read_design_space(path)
    assert space.measure == "engineering"
    assert space.design.tolist() == [0, 0, 1, 2]
    assert space.design_names == ("10-20", "50-50", "90-90")
    assert path.with_suffix(".json") in space.files
    by_column = written(strains(strain_measure="log"), tmp_path / "u.csv")
    assert read_design_space(by_column).measure == "log"
    assert read_design_space(written(strains(), tmp_path / "v.csv"), measure="green").measure == (
        "green"
    )


@pytest.mark.parametrize(
    ("frame", "sidecar", "measure", "code"),
    [
        (strains(), None, None, "strain-measure-missing"),
        (strains(), "{}", None, "strain-measure-missing"),
        (strains(), '{"StrainMeasure": "true"}', None, "strain-measure-unknown"),
        (strains(), '{"StrainMeasure": "log"}', "green", "strain-measure-conflict"),
        (
            strains(strain_measure=["log", "log", "green", "log"]),
            None,
            None,
            "strain-measure-mixed",
        ),
        (stretches(), None, "logarithmic", "strain-measure-unknown"),
        (strains().drop(columns="poisson_ratio"), None, "log", "column-missing"),
        (strains(a_percent=[10, 10, "x", 90]), None, "log", "value-no-number"),
        (strains(a_percent=[10, 10, 50, 110]), None, "log", "value-out-of-range"),
        (strains(poisson_ratio=[0.4, np.nan, 0.1, 0.1]), None, "log", "value-no-number"),
        (strains(longitudinal_strain=[0.1, np.inf, 0.1, 0.1]), None, "log", "value-no-number"),
        (stretches(lateral_stretch=[0.9, -0.9, 1, 1]), None, None, "value-out-of-range"),
        (
            strains(a_percent=[0.1, 0.1, 0.5, 0.9], b_percent=[0.2, 0.2, 0.5, 0.9]),
            None,
            "log",
            "cut-lengths-are-fractions",
        ),
        (stretches(a_percent=[10, 11, 90, 90]), None, None, "design-not-one"),
        (stretches(status=["failed"] * 4), None, None, "design-space-empty"),
        (strains().iloc[:0], None, "log", "table-empty"),
        (strains(), "[1]", "log", None),
    ],
)
def test_faults(
    frame: pd.DataFrame, sidecar: str | None, measure: str | None, code: str | None, tmp_path: Path
) -> None:
    path = written(frame, tmp_path / "t.csv", sidecar)
    with pytest.raises(TableError) as caught:
        read_design_space(path, measure=measure)
    assert code is None or caught.value.code == code


def test_the_missing_measure_says_why_it_matters(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"ratio of strains.*StrainMeasure"):
        read_design_space(written(strains(), tmp_path / "t.csv"))


def test_faults_come_together_with_their_rows(tmp_path: Path) -> None:
    frame = strains(a_percent=[10, -1, 50, 190], poisson_ratio=[0.1, 0.1, 99, 0.1])
    with pytest.raises(TableError) as caught:
        read_design_space(written(frame, tmp_path / "t.csv"), measure="log")
    places = {(fault.row, fault.column) for fault in caught.value.faults}
    assert places == {(2, "a_percent"), (4, "a_percent"), (3, "poisson_ratio")}


def test_no_table(tmp_path: Path) -> None:
    (tmp_path / "t.parquet").write_bytes(b"PAR1 and no more")
    for name in ("t.parquet", "absent.csv"):
        with pytest.raises(TableError):
            read_design_space(tmp_path / name)


def test_points(tmp_path: Path) -> None:
    path = written(strains(), tmp_path / "p.csv", '{"StrainMeasure": "log"}')
    points, measure = read_points(path)
    assert points.shape == (4, 3)
    assert measure == "log"
    with pytest.raises(TableError, match="longitudinal_strain"):
        read_points(written(stretches(), tmp_path / "q.csv"))
