"""Tables of another solver or of a measurement: read, refused, compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kiribench.errors import TableError
from kiribench.reference.check import CheckOptions, check_design
from kiribench.reference.given_table import compare_table, read_given
from kiribench.reference.ground import FlatGround
from kiribench.schema.patch_design import PatchDesign

SHAPE = (3, 3)


def design() -> PatchDesign:
    return PatchDesign(
        participant="", method="given", side="", cell_mm=10.0, thickness_mm=2.0,
        strain_measure="log", a=np.full(SHAPE, 0.6), b=np.full(SHAPE, 0.5),
        region=np.full(SHAPE, "P"), reason=np.full(SHAPE, ""),
    )  # fmt: skip


def write(path: Path, head: str, rows: list[str]) -> Path:
    path.write_text("\n".join([head.replace(" ", "\t"), *rows]) + "\n", encoding="utf-8")
    return path


def test_a_table_of_cells_is_compared_in_the_designs_measure(tmp_path: Path) -> None:
    checked = check_design(design(), FlatGround(SHAPE, 10.0, pull=1.2), CheckOptions(elements=6))
    worn = checked.worn
    rows = [
        f"{r}\t{c}\t{worn.longitudinal_stretch[r, c] * 1.01:.9f}"
        f"\t{worn.lateral_stretch[r, c]:.9f}\t{worn.shear[r, c] + 0.02:.9f}"
        for r, c in np.ndindex(SHAPE)
    ]
    rows[4] = "1\t1\tn/a\tn/a\tn/a"
    table = write(tmp_path / "t.tsv", "row col longitudinal_stretch lateral_stretch shear", rows)
    found = compare_table(checked, read_given(table, SHAPE))
    summary = found.summary()
    assert summary["longitudinal_strain"]["rms"] == pytest.approx(np.log(1.01), abs=1e-7)
    assert summary["longitudinal_strain"]["count"] == 8
    assert summary["lateral_strain"]["largest"] < 1e-7
    assert summary["shear"]["mean"] == pytest.approx(-0.02, abs=1e-7)
    assert summary["poisson_ratio"]["rms"] > 0


def test_a_table_of_corners_is_compared_by_distance_and_scored(tmp_path: Path) -> None:
    checked = check_design(design(), FlatGround(SHAPE, 10.0, pull=1.2), CheckOptions(elements=6))
    corner = checked.worn.corner_q_mm + np.array([0.3, -0.4])
    rows = [f"{r}\t{c}\t{corner[r, c, 0]:.9f}\t{corner[r, c, 1]:.9f}" for r, c in np.ndindex(4, 4)]
    given = read_given(write(tmp_path / "c.tsv", "row col u_mm v_mm", rows), SHAPE)
    found = compare_table(checked, given)
    assert found.summary()["corner_mm"]["rms"] == pytest.approx(0.5, abs=1e-6)
    assert found.overlap is not None
    assert found.overlap.shape == SHAPE


@pytest.mark.parametrize(
    ("head", "rows", "code"),
    [
        ("row col a_percent", ["0\t0\t1"], "reference-columns"),
        ("row col longitudinal_stretch lateral_stretch", ["3\t0\t1\t1"], "reference-cell"),
        (
            "row col longitudinal_stretch lateral_stretch",
            ["0\t0\t1\t1", "0\t0\t1\t1"],
            "reference-cell",
        ),
        ("row col longitudinal_stretch lateral_stretch", ["0\t0\tx\t1"], "reference-number"),
        ("row col longitudinal_stretch lateral_stretch", ["0\t0\t-0.1\t1"], "reference-stretch"),
        ("row col longitudinal_stretch lateral_stretch", ["0\t0\tn/a\tn/a"], "reference-empty"),
        ("row col u_mm v_mm", ["4\t0\t1\t1"], "reference-cell"),
    ],
)
def test_tables_that_cannot_be_compared_are_refused(
    tmp_path: Path, head: str, rows: list[str], code: str
) -> None:
    with pytest.raises(TableError) as error:
        read_given(write(tmp_path / "t.tsv", head, rows), SHAPE)
    assert error.value.code == code


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(TableError) as error:
        read_given(tmp_path / "none.tsv", SHAPE)
    assert error.value.code == "reference-missing"


def test_a_cut_that_no_laser_can_cut_is_none() -> None:
    faint = design()
    faint.b[2, 1] = 2e-10  # as an optimiser leaves it
    none = design()
    none.b[2, 1] = 0.0
    ground, options = FlatGround(SHAPE, 10.0, pull=1.2), CheckOptions(elements=6)
    one, other = (check_design(given, ground, options).worn for given in (faint, none))
    assert one.status == "ok"
    assert one.corner_q_mm == pytest.approx(other.corner_q_mm, abs=1e-12)
