"""Targets read from tables and subjects: places, measures, percent, layouts, every fault named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from design_toys import problem

from kiribench.dataset import Dataset
from kiribench.design.problem import problem_from_subject, problem_from_table
from kiribench.errors import KiribenchError, TableError, UsageError
from kiribench.schema.layout import Layout

SHIPPED = Path(__file__).parents[2] / "data/synthetic"


def write(path: Path, lines: list[str], **sidecar: object) -> Path:
    path.write_text("\n".join(lines) + "\n")
    if sidecar:
        path.with_suffix(".json").write_text(json.dumps(sidecar))
    return path


PLAIN = [
    "row\tcol\tlongitudinal_strain\tpoisson_ratio",
    "0\t0\t0.2\t-0.3",
    "0\t1\t0.25\t0.1",
    "1\t0\t0.3\tn/a",
    "1\t1\t0.1\t0.2",
]


def test_a_plain_table(tmp_path: Path) -> None:
    asked = problem_from_table(write(tmp_path / "t.tsv", PLAIN, StrainMeasure="log", CellMm=12))
    assert asked.shape == (2, 2) and asked.cell_mm == 12 and asked.strain_measure == "log"
    np.testing.assert_array_equal(asked.poisson_ratio, [[-0.3, 0.1], [np.nan, 0.2]])
    assert asked.reason.tolist() == [["", ""], ["target-missing", ""]]
    assert asked.wanted.sum() == 3
    assert [path.name for path in asked.files] == ["t.tsv", "t.json"]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_other_formats_and_lateral_strain(suffix: str, tmp_path: Path) -> None:
    import pandas as pd

    frame = pd.DataFrame(
        {"row": [0, 0], "col": [0, 1], "longitudinal_strain": [0.2, 0.4],
         "lateral_strain": [0.06, -0.1], "strain_measure": ["log", "log"]}
    )  # fmt: skip
    path = tmp_path / f"t.{suffix}"
    if suffix == "csv":
        frame.to_csv(path, index=False)
    else:
        frame.to_parquet(path)
    asked = problem_from_table(path)
    np.testing.assert_allclose(asked.poisson_ratio, [[-0.3, 0.25]])
    assert asked.cell_mm == 15 and "15 mm" in asked.notes[0]


def test_stretches_have_no_measure_and_convert_to_any(tmp_path: Path) -> None:
    lines = ["row\tcol\tlongitudinal_stretch\tlateral_stretch", "0\t0\t1.25\t0.9", "0\t1\t1.1\tn/a"]
    asked = problem_from_table(write(tmp_path / "t.tsv", lines))
    assert not asked.measured_strain
    assert asked.poisson_ratio[0, 0] == pytest.approx(-np.log(0.9) / np.log(1.25))
    engineering = asked.in_measure("engineering")
    assert engineering.longitudinal_strain[0, 0] == pytest.approx(0.25)
    assert engineering.poisson_ratio[0, 0] == pytest.approx(0.4)
    assert np.isnan(engineering.poisson_ratio[0, 1])
    green = asked.in_measure("green")
    assert green.poisson_ratio[0, 0] == pytest.approx((1 - 0.81) / (1.5625 - 1))


def test_strains_without_stretches_are_not_converted(tmp_path: Path) -> None:
    asked = problem_from_table(write(tmp_path / "t.tsv", PLAIN, StrainMeasure="log"))
    with pytest.raises(UsageError) as caught:
        asked.in_measure("engineering")
    assert caught.value.code == "targets-without-stretches"
    assert problem(np.full((1, 1), 0.2), np.full((1, 1), 0.1)).in_measure("log").wanted.all()


def changed(line: int, text: str) -> list[str]:
    return [*PLAIN[:line], text, *PLAIN[line + 1 :]]


@pytest.mark.parametrize(
    ("lines", "sidecar", "code", "word"),
    [
        (PLAIN, {}, "strain-measure-missing", "ratio of strains"),
        (PLAIN, {"StrainMeasure": "biot"}, "strain-measure-unknown", "biot"),
        (PLAIN[:1], {"StrainMeasure": "log"}, "table-empty", ""),
        (["row\tcol\tstrain", "0\t0\t1"], {}, "targets-columns", "poisson_ratio"),
        (changed(2, "0\t1\t25\t0.1"), {"StrainMeasure": "log"}, "targets-value", "percent"),
        (changed(2, "0\t1\tabc\t0.1"), {"StrainMeasure": "log"}, "targets-value", "abc"),
        (changed(2, "0\t1.5\t0.2\t0.1"), {"StrainMeasure": "log"}, "targets-cell", "1.5"),
        (changed(2, "0\t0\t0.2\t0.1"), {"StrainMeasure": "log"}, "targets-cell-doubled", "row 0"),
        (
            ["row\tcol\tlongitudinal_strain\tpoisson_ratio", "1\t1\t0.2\t0.1", "1\t2\t0.2\t0.1"],
            {"StrainMeasure": "log"},
            "targets-from-one",
            "from 0",
        ),
        (
            ["row\tcol\tlongitudinal_strain\tpoisson_ratio", "1\t0\t0.2\t0.1", "2\t0\t0.2\t0.1"],
            {"StrainMeasure": "log"},
            "targets-from-one",
            "from row 1, col 0",
        ),
        (changed(2, "0\t1\tinf\t0.1"), {"StrainMeasure": "log"}, "targets-value", "n/a"),
        (
            ["row\tcol\tlongitudinal_strain\tpoisson_ratio", "0\t0\tn/a\tn/a"],
            {"StrainMeasure": "log"},
            "targets-empty",
            "",
        ),
        (PLAIN, {"StrainMeasure": "log", "CellMm": -3}, "targets-length", "CellMm"),
        (PLAIN, {"StrainMeasure": "log", "Grid": {"Rows": 9}}, "targets-layout", "9 x"),
        (PLAIN, {"StrainMeasure": "log", "Grid": {"Rows": "x"}}, "targets-layout", ""),
    ],
)
def test_faults_are_named(
    lines: list[str], sidecar: dict[str, object], code: str, word: str, tmp_path: Path
) -> None:
    with pytest.raises(KiribenchError) as caught:
        problem_from_table(write(tmp_path / "t.tsv", lines, **sidecar))
    assert caught.value.code == code
    assert word in str(caught.value)


def test_all_faults_at_once(tmp_path: Path) -> None:
    lines = [PLAIN[0], "0\t0\tx\ty", "z\t1\t0.2\t0.1"]
    with pytest.raises(TableError) as caught:
        problem_from_table(write(tmp_path / "t.tsv", lines, StrainMeasure="log"))
    assert [(fault.column, fault.row) for fault in caught.value.faults] == [
        ("row", 2),
        ("longitudinal_strain", 1),
        ("poisson_ratio", 1),
    ]


def test_absent_rows_are_missing_targets(tmp_path: Path) -> None:
    path = write(tmp_path / "t.tsv", [*PLAIN[:3], PLAIN[4]], StrainMeasure="log")
    asked = problem_from_table(path)
    assert asked.reason[1, 0] == "target-missing"
    assert any("1 cells have no row" in note for note in asked.notes)


def test_the_table_of_measure_and_the_subject_give_the_same_problem(tmp_path: Path) -> None:
    from kiribench.cli import main

    arguments = ["--participant", "S1", "--out", str(tmp_path), "--quiet"]
    assert main(["measure", str(SHIPPED), *arguments]) == 0
    table = problem_from_table(tmp_path / "sub-S1/sub-S1_strain.tsv")
    subject = Dataset.open(SHIPPED).subject("S1")
    direct = problem_from_subject(subject)
    assert table.shape == direct.shape == (12, 6)
    assert (table.participant, table.side) == (direct.participant, direct.side)
    assert table.region.tolist() == direct.region.tolist()
    np.testing.assert_allclose(table.poisson_ratio, direct.poisson_ratio, atol=1e-8)
    np.testing.assert_allclose(table.longitudinal_strain, direct.longitudinal_strain, atol=1e-8)
    # Without the sidecar the grid is known by its size, and the measure by its column.
    (tmp_path / "sub-S1/sub-S1_strain.json").unlink()
    bare = problem_from_table(tmp_path / "sub-S1/sub-S1_strain.tsv")
    np.testing.assert_array_equal(bare.poisson_ratio, table.poisson_ratio)
    assert any("centred" in note for note in bare.notes)


def test_the_layout_comes_back_from_its_metadata() -> None:
    from kiribench.schema.layout import LayoutMetadata

    layout = Layout.of()
    again = Layout.resolve(LayoutMetadata.model_validate(layout.as_metadata()))
    assert again.patch_offset == layout.patch_offset == (2, 3)
    assert again.regions == layout.regions and again.grid == layout.grid


@pytest.mark.parametrize(("said", "side"), [("Left", "left"), ("none", ""), (None, "")])
def test_sides_that_are_known(said: str | None, side: str, tmp_path: Path) -> None:
    path = write(tmp_path / "t.tsv", PLAIN, StrainMeasure="log", Side=said)
    assert problem_from_table(path).side == side


@pytest.mark.parametrize("said", ["up", 5, ["left"], True])
def test_a_side_that_is_none_is_refused(said: object, tmp_path: Path) -> None:
    path = write(tmp_path / "t.tsv", PLAIN, StrainMeasure="log", Side=said)
    with pytest.raises(TableError) as caught:
        problem_from_table(path)
    assert caught.value.code == "targets-side"


def test_a_wrong_row_number_does_not_make_a_hundred_million_cells(tmp_path: Path) -> None:
    lines = [*PLAIN, "9999\t9999\t0.2\t0.1"]
    with pytest.raises(TableError) as caught:
        problem_from_table(write(tmp_path / "t.tsv", lines, StrainMeasure="log"))
    assert caught.value.code == "targets-too-many"


def test_strains_in_small_percents_are_doubted(tmp_path: Path) -> None:
    doubted = [PLAIN[0], "0\t0\t3\t0.1", "0\t1\t2\t0.1", "0\t2\tn/a\tn/a"]
    asked = problem_from_table(write(tmp_path / "t.tsv", doubted, StrainMeasure="log"))
    assert any("strains are fractions" in note for note in asked.notes)
    asked = problem_from_table(write(tmp_path / "t.tsv", PLAIN, StrainMeasure="log"))
    assert not any("strains are fractions" in note for note in asked.notes)
