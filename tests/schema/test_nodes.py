"""The nodes table: every fault with its line and column, and no guess."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiribench.errors import Fault
from kiribench.schema.nodes import DEFAULT_NODE_SD_MM, NodesTable
from kiribench.schema.nodes_parse import parse_nodes
from kiribench.schema.tsv import parse_tsv

SHAPE = (3, 4)
Row = dict[str, str]


def rows() -> list[Row]:
    return [
        {"row": str(r), "col": str(c), "x_mm": f"{15 * c}", "y_mm": f"{-15.5 * r}", "z_mm": "1e1"}
        for r in range(SHAPE[0])
        for c in range(SHAPE[1])
    ]


def parse(table: list[Row], **options: float) -> tuple[NodesTable | None, tuple[Fault, ...]]:
    columns = list(dict.fromkeys(name for row in table for name in row))
    lines = ["\t".join(columns)]
    lines += ["\t".join(row.get(name, "n/a") for name in columns) for row in table]
    parsed, faults = parse_tsv("\n".join(lines).encode(), file="n.tsv")
    assert parsed is not None
    assert not faults
    return parse_nodes(parsed, Path("n.tsv"), SHAPE, **options)


def test_plain_table() -> None:
    nodes, faults = parse(rows())
    assert nodes is not None
    assert not faults
    assert len(nodes) == 12
    assert nodes.grid_shape == SHAPE
    assert nodes.face is None
    assert nodes.barycentric is None
    assert nodes.present.all()
    assert nodes.sd_source == "default"
    np.testing.assert_array_equal(nodes.sd_mm, DEFAULT_NODE_SD_MM)
    np.testing.assert_array_equal(nodes.grid_xyz_mm()[2, 3], [45.0, -31.0, 10.0])
    assert nodes.line.tolist() == list(range(2, 14))


def test_order_of_rows_does_not_matter() -> None:
    forward, _ = parse(rows())
    backward, faults = parse(rows()[::-1])
    assert forward is not None
    assert backward is not None
    assert not faults
    np.testing.assert_array_equal(forward.grid_xyz_mm(), backward.grid_xyz_mm())


def test_faces_weights_sd_status_and_extra_columns() -> None:
    table = rows()
    for index, row in enumerate(table):
        row |= {"face": str(index), "b0": "0.333", "b1": "0.333", "b2": "0.333", "note": "x"}
    table[0] |= {"face": "n/a", "b0": "", "b1": "NA", "b2": "n/a"}
    table[1] |= {"sd_mm": "0.1"}
    table[2] |= {"status": "Missing", "x_mm": "n/a", "y_mm": "n/a", "z_mm": "n/a"}
    table[3] |= {"status": "hidden"}
    nodes, faults = parse(table, node_sd_mm=0.4)
    assert nodes is not None
    assert not faults
    assert nodes.face is not None
    assert nodes.barycentric is not None
    assert nodes.face.tolist() == [-1, *range(1, 12)]
    assert np.isnan(nodes.barycentric[0]).all()
    np.testing.assert_allclose(nodes.barycentric[1:].sum(axis=1), 1.0, rtol=1e-15)
    assert nodes.sd_source == "column"
    assert nodes.sd_mm[:2].tolist() == [0.4, 0.1]
    assert nodes.status[:4] == ("ok", "ok", "missing", "hidden")
    assert nodes.present.tolist() == [True, True, False, False] + [True] * 8
    assert np.isnan(nodes.grid_xyz_mm()[0, 2:]).all()


def test_sidecar_gives_the_sd() -> None:
    nodes, _ = parse(rows(), node_sd_mm=0.05)
    assert nodes is not None
    assert nodes.sd_source == "sidecar"
    np.testing.assert_array_equal(nodes.sd_mm, 0.05)


def put(index: int, **fields: str) -> Callable[[list[Row]], list[Row]]:
    def change(table: list[Row]) -> list[Row]:
        table[index] |= fields
        return table

    return change


def without(column: str) -> Callable[[list[Row]], list[Row]]:
    return lambda table: [{k: v for k, v in row.items() if k != column} for row in table]


def all_rows(**fields: str) -> Callable[[list[Row]], list[Row]]:
    return lambda table: [row | fields for row in table]


@pytest.mark.parametrize(
    ("change", "code", "line", "column"),
    [
        (without("z_mm"), "nodes-column-missing", None, "z_mm"),
        (without("row"), "nodes-column-missing", None, "row"),
        (all_rows(face="1", b0="1"), "nodes-columns-half", None, None),
        (put(4, x_mm="abc"), "nodes-number", 6, "x_mm"),
        (put(4, x_mm="1_000"), "nodes-number", 6, "x_mm"),
        (put(4, x_mm="12,5"), "nodes-number", 6, "x_mm"),
        (put(4, x_mm="0x10"), "nodes-number", 6, "x_mm"),
        (put(4, y_mm="nan"), "nodes-not-finite", 6, "y_mm"),
        (put(4, y_mm="-inf"), "nodes-not-finite", 6, "y_mm"),
        (put(4, y_mm="1e999"), "nodes-not-finite", 6, "y_mm"),
        (put(4, z_mm="n/a"), "nodes-coordinates-missing", 6, "z_mm"),
        (put(4, z_mm="n/a", status="missing"), "nodes-coordinates-missing", 6, "z_mm"),
        (put(4, x_mm="1e7"), "nodes-coordinate-range", 6, "x_mm"),
        (put(4, row="3"), "nodes-index-range", 6, "row"),
        (put(4, row="-1"), "nodes-index-range", 6, "row"),
        (put(4, col="1e300"), "nodes-index-range", 6, "col"),
        (put(4, row="1.5"), "nodes-number", 6, "row"),
        (put(4, row="n/a"), "nodes-number", 6, "row"),
        (put(4, col="0", row="0"), "nodes-duplicate", 6, "row"),
        (put(4, sd_mm="-0.1"), "nodes-sd", 6, "sd_mm"),
        (put(4, sd_mm="x"), "nodes-number", 6, "sd_mm"),
        (put(4, status="lost"), "nodes-status", 6, "status"),
        (put(4, status="<script>alert(1)</script>"), "nodes-status", 6, "status"),
        (put(4, face="1", b0="1", b1="0"), "nodes-columns-half", None, None),
        (put(4, face="1", b0="1", b1="0", b2="n/a"), "nodes-barycentric-half", 6, "b2"),
        (put(4, face="1", b0="0.5", b1="0.6", b2="0.2"), "nodes-barycentric", 6, "b0"),
        (put(4, face="1", b0="1.5", b1="-0.5", b2="0"), "nodes-barycentric", 6, "b0"),
        (put(4, face="-3", b0="1", b1="0", b2="0"), "nodes-face-range", 6, "face"),
        (put(4, face="1.5", b0="1", b1="0", b2="0"), "nodes-number", 6, "face"),
        (all_rows(status="missing"), "nodes-none", None, "status"),
    ],
)
def test_faults(
    change: Callable[[list[Row]], list[Row]], code: str, line: int | None, column: str | None
) -> None:
    nodes, faults = parse(change(rows()))
    assert nodes is None
    assert (code, line, column) in [(f.code, f.row, f.column) for f in faults], faults
    assert all(fault.file == "n.tsv" and str(fault).isprintable() for fault in faults)


def test_missing_millimetre_column_names_what_is_there() -> None:
    renamed = [{k.removesuffix("_mm"): v for k, v in row.items()} for row in rows()]
    _, faults = parse(renamed)
    assert [fault.column for fault in faults] == ["x_mm", "y_mm", "z_mm"]
    assert faults[0].got == "x"
    assert "millimetre" in faults[0].remedy


def test_decimal_comma_is_said() -> None:
    table = rows()
    table[0]["x_mm"] = "0,5"
    _, faults = parse(table)
    assert "decimal comma" in faults[0].what


def test_every_fault_at_once() -> None:
    table = rows()
    table[0]["x_mm"] = "abc"
    table[3] |= {"row": "9"}
    table[5] |= {"row": "0", "col": "0"}
    table[7]["y_mm"] = "nan"
    _, faults = parse(table)
    assert {(fault.code, fault.row) for fault in faults} == {
        ("nodes-number", 2),
        ("nodes-index-range", 5),
        ("nodes-duplicate", 7),
        ("nodes-not-finite", 9),
    }


@pytest.mark.parametrize(
    ("lost", "name"),
    [
        (lambda row: row["row"] == "0", "row 0 (proximal)"),
        (lambda row: row["row"] == "2", "row 2 (distal)"),
        (lambda row: row["col"] == "0", "col 0 (lateral)"),
        (lambda row: row["col"] == "3", "col 3 (medial)"),
    ],
)
def test_lost_border_line_is_an_error_that_explains(lost: Callable[[Row], bool], name: str) -> None:
    nodes, faults = parse([row for row in rows() if not lost(row)])
    assert nodes is None
    assert [fault.code for fault in faults] == ["nodes-edge-missing"]
    assert name in faults[0].what
    assert "shifts every index" in faults[0].what


def test_border_line_that_is_listed_as_missing_is_an_assertion_of_the_index() -> None:
    table = rows()
    for row in table[:4]:
        row |= {"x_mm": "n/a", "y_mm": "n/a", "z_mm": "n/a", "status": "missing"}
    nodes, faults = parse(table)
    assert nodes is not None
    assert not faults
    assert nodes.present.sum() == 8


def test_absent_inner_nodes_are_a_warning() -> None:
    table = rows()
    del table[5]
    nodes, faults = parse(table)
    assert nodes is not None
    assert [(fault.code, fault.severity) for fault in faults] == [("nodes-absent", "warning")]
    assert "(1, 1)" in faults[0].what
    assert np.isnan(nodes.grid_xyz_mm()[1, 1]).all()


def test_header_only() -> None:
    parsed, _ = parse_tsv(b"row\tcol\tx_mm\ty_mm\tz_mm\n", file="n.tsv")
    assert parsed is not None
    nodes, faults = parse_nodes(parsed, Path("n.tsv"), SHAPE)
    assert nodes is None
    assert [fault.code for fault in faults] == ["nodes-none"]


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            *[st.text(st.characters(codec="utf-8", exclude_characters="\t\n\r\0"), max_size=6)] * 6
        ),
        max_size=8,
    )
)
def test_any_fields_give_nodes_or_faults(fields: list[tuple[str, ...]]) -> None:
    text = "row\tcol\tx_mm\ty_mm\tz_mm\tsd_mm\n" + "\n".join("\t".join(f) for f in fields)
    parsed, _ = parse_tsv(text.encode(), file="n.tsv")
    if parsed is None:
        return
    nodes, faults = parse_nodes(parsed, Path("n.tsv"), SHAPE)
    assert (nodes is None) == any(fault.severity == "error" for fault in faults)


def test_a_node_without_position_and_status_is_missing() -> None:
    """As if its row were absent; only the claim ``ok`` contradicts ``n/a``."""
    nowhere = {"x_mm": "n/a", "y_mm": "n/a", "z_mm": ""}
    table = rows()
    table[4] |= nowhere
    nodes, faults = parse(table)
    assert nodes is not None
    assert not faults
    assert np.flatnonzero(~nodes.present).tolist() == [4]
    table[5] |= nowhere | {"status": "ok"}
    nodes, faults = parse(table)
    assert nodes is None
    assert [(fault.code, fault.row) for fault in faults] == [("nodes-coordinates-missing", 7)]
