"""Tab-separated tables."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiribench.schema.tsv import MAX_TSV_BYTES, is_decimal_comma, parse_tsv


def test_fields_are_stripped_and_lines_are_numbered_as_in_an_editor() -> None:
    table, faults = parse_tsv(b"\n a \tb\t\r\n\r\n1\t 2 \t\r\n\n3\t4\t\n", file="t.tsv")
    assert table is not None
    assert not faults
    assert table.columns == ("a", "b", "")
    assert table.lines == (4, 6)
    assert table.rows == (("1", "2", ""), ("3", "4", ""))
    assert table.column("b") == ("2", "4")


def test_trailing_tabs_and_old_mac_line_ends_are_harmless() -> None:
    table, faults = parse_tsv(b"a\tb\r1\t2\t\t\r", file="t.tsv")
    assert table is not None
    assert not faults
    assert table.rows == (("1", "2"),)


@pytest.mark.parametrize(
    ("data", "code", "row"),
    [
        (b"", "table-empty", None),
        (b"\n\n", "table-empty", None),
        (b"row,col,x_mm\n0,0,1\n", "table-separator", 1),
        (b"row;col;x_mm\n0;0;1,5\n", "table-separator", 1),
        (b"row col x_mm\n0 0 1\n", "table-separator", 1),
        (b"a\tb\ta\n1\t2\t3\n", "table-duplicate-column", 1),
        (b"a\tb\n1\t2\n1\n", "table-ragged", 3),
        (b"a\tb\n1\t2\t3\n", "table-ragged", 2),
        (b"a\tb\n\xff\t1\n", "text-encoding", 2),
        ("a\tb\n".encode("utf-16"), "text-encoding", None),
        (b"a\tb\n\0\0\t1\n", "text-binary", 2),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "text-encoding", 1),
        (b"a" * (MAX_TSV_BYTES + 1), "table-too-large", None),
    ],
)
def test_faults(data: bytes, code: str, row: int | None) -> None:
    _, faults = parse_tsv(data, file="t.tsv")
    assert [(fault.code, fault.row) for fault in faults] == [(code, row)]
    assert faults[0].file == "t.tsv"


def test_separator_fault_says_which() -> None:
    _, faults = parse_tsv(b"row;col;x_mm\n", file="t.tsv")
    assert "semicolons" in faults[0].what


@pytest.mark.parametrize(("field", "comma"), [("1,5", True), ("-0,25", True), ("1.5", False)])
def test_decimal_comma(field: str, comma: bool) -> None:
    assert is_decimal_comma(field) is comma


@given(st.binary(max_size=300))
def test_any_bytes_give_a_table_or_a_fault(data: bytes) -> None:
    table, faults = parse_tsv(data, file="t.tsv")
    assert table is not None or faults
