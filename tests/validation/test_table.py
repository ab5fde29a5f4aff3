"""Tables from design spaces and from anywhere else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kiribench.errors import TableError
from kiribench.schema.design_space import read_design_space
from kiribench.validation.table import (
    column_of_space,
    grouped_by,
    of_design_space,
    read_regression_table,
)

CSV = "p,q,y,patient,fold\n1,2,3,anna,x\n2,2,4,anna,y\n3,1,5,ben,x\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "t.csv"
    path.write_text(CSV)
    return path


def test_groups_and_folds_by_column(path: Path) -> None:
    table = read_regression_table(path, ["p", "q"], "y", group_column="patient", fold_column="fold")
    assert table.X.tolist() == [[1, 2], [2, 2], [3, 1]]
    assert table.group.tolist() == [0, 0, 1] and table.group_names == ("anna", "ben")
    assert table.own_fold is not None and table.own_fold.tolist() == [0, 1, 0]
    assert table.fold_names == ("x", "y") and table.group_word == "group"
    alone = read_regression_table(path, ["p"], "y")
    assert alone.groups == 3 and alone.group_word == "row"


def test_faults_name_row_and_column(path: Path) -> None:
    path.write_text("p,q,y,g\n1,,3,a\n2,inf,4,\n3,1,five,b\n")
    with pytest.raises(TableError) as caught:
        read_regression_table(path, ["p", "q"], "y")
    places = {(fault.row, fault.column) for fault in caught.value.faults}
    assert places == {(1, "q"), (2, "q"), (3, "y")}
    path.write_text("p,y,g\n1,3,a\n2,4,\n")
    with pytest.raises(TableError, match="label-missing"):
        read_regression_table(path, ["p"], "y", group_column="g")


@pytest.mark.parametrize(
    ("features", "target", "code"),
    [(["p", "z"], "y", "column-missing"), (["p", "y"], "y", "column-twice"),
     (["p", "p"], "y", "column-twice")],
)  # fmt: skip
def test_columns_that_are_wrong(path: Path, features: list[str], target: str, code: str) -> None:
    with pytest.raises(TableError, match=code):
        read_regression_table(path, features, target)


def test_rows_of_a_design_space_stay_with_their_columns(tmp_path: Path) -> None:
    path = tmp_path / "space.csv"
    path.write_text(
        "design,a_percent,b_percent,longitudinal_strain,poisson_ratio,strain_measure,status,lab\n"
        "u,10,20,0.1,0.4,log,ok,one\n"
        "u,10,20,0.2,0.3,log,not-converged,one\n"
        "v,30,20,0.1,0.2,log,ok,two\n"
        "w,10,20,0.2,0.1,log,ok,two\n"
    )
    space = read_design_space(path)
    table = of_design_space(space)
    # u and w have the same cuts: one group, or leaving one out would not hide its answer.
    assert table.group.tolist() == [0, 1, 0] and table.group_names == ("u", "v")
    labels = column_of_space(space, "lab")
    assert labels == ["one", "two", "two"]
    assert grouped_by(table, labels).group.tolist() == [0, 1, 1]
    with pytest.raises(TableError, match="column-missing"):
        column_of_space(space, "nobody")


def test_the_hash_is_of_the_content(path: Path, tmp_path: Path) -> None:
    table = read_regression_table(path, ["p", "q"], "y")
    other = tmp_path / "other.csv"
    other.write_text(CSV)
    assert read_regression_table(other, ["p", "q"], "y").sha256 == table.sha256
    for changed in (
        read_regression_table(path, ["q", "p"], "y"),
        read_regression_table(path, ["p", "q"], "y", group_column="patient"),
        read_regression_table(path, ["p", "q"], "y", fold_column="fold"),
    ):
        assert changed.sha256 != table.sha256
    assert np.array_equal(table.y, [3, 4, 5])
