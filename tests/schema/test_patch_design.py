"""The design table: what is written is read again; every fault is named with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kiribench.errors import TableError
from kiribench.schema.patch_design import QUANTITIES, PatchDesign, read_design, write_design


def design() -> PatchDesign:
    rng = np.random.default_rng(5)
    shape = (3, 2)
    quantities = {name: rng.uniform(-1, 1, shape) for name in QUANTITIES}
    quantities["target_poisson_ratio"][1, 0] = np.nan
    region = np.full(shape, "P", dtype="<U64")
    reason = np.full(shape, "", dtype="<U64")
    reason[1, 0] = "target-missing"
    return PatchDesign(
        "S9", "exact", "left", 15.0, 2.0, "log",
        rng.uniform(0, 0.9, shape), rng.uniform(0, 0.9, shape),
        region, reason, quantities, {"Limits": {"ligament_mm": 1.0}},
    )  # fmt: skip


def test_round_trip(tmp_path: Path) -> None:
    written = design()
    path = write_design(tmp_path / "sub-S9", written)
    assert path.name == "sub-S9_design.tsv"
    for given in (path, tmp_path):
        read = read_design(given)
        assert (read.participant, read.method, read.side) == ("S9", "exact", "left")
        assert (read.cell_mm, read.thickness_mm, read.strain_measure) == (15.0, 2.0, "log")
        np.testing.assert_allclose(read.a, written.a, rtol=1e-8)
        np.testing.assert_allclose(read.b, written.b, rtol=1e-8)
        np.testing.assert_array_equal(read.region, written.region)
        np.testing.assert_array_equal(read.reason, written.reason)
        for name in QUANTITIES:
            np.testing.assert_allclose(read.quantity(name), written.quantity(name), rtol=1e-8)
        assert read.settings == {"Limits": {"ligament_mm": 1.0}}


def test_a_table_from_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "mine.tsv"
    path.write_text("row\tcol\ta_percent\tb_percent\n0\t1\t50\t60\n0\t0\t40\t0\n")
    read = read_design(path, cell_mm=12)
    assert read.method == "given"
    np.testing.assert_allclose(read.a, [[0.4, 0.5]])
    np.testing.assert_allclose(read.b, [[0.0, 0.6]])
    assert np.isnan(read.quantity("target_poisson_ratio")).all()
    with pytest.raises(TableError) as error:
        read_design(path)
    assert error.value.code == "design-cell-size"


HEAD = "row\tcol\ta_percent\tb_percent\n"


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        (HEAD + "0\t0\t50\t100\n", "design-cut-length", 2),
        (HEAD + "0\t0\t50\tn/a\n", "design-cut-length", 2),
        (HEAD + "0\t0\t-1\t5\n", "design-cut-length", 2),
        (HEAD + "0\t0\t5\t5\n-1\t0\t5\t5\n", "design-cell", 3),
        (HEAD + "0\t0\t5\t5\n0\t0\t5\t5\n", "design-cell-twice", 3),
        (HEAD + "0\t0\t5\t5\n1\t1\t5\t5\n", "design-cell-missing", None),
        ("row\tcol\ta_percent\n0\t0\t5\n", "design-columns", None),
        (HEAD.strip() + "\ttarget_poisson_ratio\n0\t0\t5\t5\tx\n", "design-number", 2),
        ("", "table-empty", None),
        (HEAD, "table-empty", None),
    ],
)
def test_faults_are_named(tmp_path: Path, text: str, code: str, line: int | None) -> None:
    path = tmp_path / "design.tsv"
    path.write_text(text)
    with pytest.raises(TableError) as error:
        read_design(path, cell_mm=15)
    fault = error.value.faults[0]
    assert (fault.code, fault.row) == (code, line)


def test_a_folder_must_hold_one_design(tmp_path: Path) -> None:
    with pytest.raises(TableError) as error:
        read_design(tmp_path)
    assert error.value.code == "design-missing"
    for name in ("sub-A", "sub-B"):
        write_design(tmp_path / name, design())
    with pytest.raises(TableError) as error:
        read_design(tmp_path)
    assert error.value.code == "design-ambiguous"
