"""The text of a tension test's table: separator, decimal mark, header, rows of numbers."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from kiribench.errors import Fault, TableError
from kiribench.schema.strict_json import decode_text, short

MAX_BYTES = 64_000_000
_POINT = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?")
_BOTH = re.compile(r"[+-]?\d{1,3}([.,]\d{3})+([.,]\d+)?")
_UNIT_ROW = re.compile(r"[\[(]?\s*([a-zA-Zµμ%°/^*·\d\- ]{0,12})\s*[\])]?")


@dataclass(frozen=True)
class NumberTable:
    """What stands in the file.

    Attributes:
        columns: names of the columns, with their units where a line of units follows.
        lines: line of the file, from 1, of every row.
        rows: the fields of every row, decimal points throughout.
        header: key and value of the lines before the table.
    """

    columns: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]
    header: tuple[tuple[str, str], ...]


def _is_number(field: str) -> bool:
    return any(pattern.fullmatch(field) for pattern in (_POINT, _COMMA, _BOTH))


def _numbers_in(fields: list[str]) -> int:
    return sum(_is_number(field) for field in fields)


def read_number_table(path: Path) -> tuple[NumberTable, tuple[Fault, ...]]:
    """Read ``;``, tab or comma separated text with any number of lines before the table.

    Returns:
        The table, and what is worth a warning.

    Raises:
        TableError: ``curve-missing``, ``curve-too-large``, text that is not UTF-8,
            ``curve-no-table``, ``curve-no-header``, ``curve-decimal-mixed``,
            ``curve-decimal-separator`` (decimal commas between separating commas).
    """
    if not path.is_file():
        raise TableError(
            "curve-missing",
            "There is no such file.",
            remedy="Give the CSV file of one tension test.",
            file=path,
        )
    if path.stat().st_size > MAX_BYTES:
        raise TableError(
            "curve-too-large",
            "The file is far larger than a tension test can be.",
            remedy="Give one test a file.",
            file=path,
            got=f"{path.stat().st_size} bytes",
            expected=f"at most {MAX_BYTES}",
        )
    text, faults = decode_text(path.read_bytes(), file=str(path))
    if text is None:
        raise TableError.of(faults)
    best: tuple[int, str, list[list[str]]] = (0, ";", [])
    for separator in (";", "\t", ","):
        parsed = [
            [field.strip() for field in row]
            for row in csv.reader(_real_lines(text), delimiter=separator)
        ]
        count = sum(_numbers_in(row) >= 2 for row in parsed)
        if count > best[0]:
            best = (count, separator, parsed)
    count, separator, parsed = best
    first = next((k for k, row in enumerate(parsed) if _starts_table(parsed, k)), None)
    if first is None:
        raise TableError(
            "curve-no-table",
            "The file holds no table: no two columns of numbers.",
            remedy="Give a CSV file with a header line and columns separated by ; , or tabs.",
            file=path,
        )
    names, units, start = _header_rows(parsed, first)
    if not names:
        raise TableError(
            "curve-no-header",
            "No line before the first numbers names the columns.",
            remedy="Add a header line with units, such as 'Displacement (mm),Force (N)'.",
            file=path,
            row=first + 1,
        )
    width = len(names)
    body = [(k + 1, row) for k, row in enumerate(parsed) if k >= first and any(row)]
    wide = next((k for k, row in body if len([f for f in row if f]) > width), None)
    if wide is not None and separator == ",":
        raise TableError(
            "curve-decimal-separator",
            "Rows have more fields than the header: the decimal mark and the separator are both "
            "commas.",
            remedy="Export with semicolons or tabs between the columns, or put quotes around "
            "the numbers.",
            file=path,
            row=wide,
            got=f"{len(parsed[wide - 1])} fields",
            expected=f"{width}",
        )
    rows = tuple(tuple((row + [""] * width)[:width]) for _, row in body)
    lines = tuple(k for k, _ in body)
    _check_decimals(rows, lines, path)
    columns = tuple(
        f"{name} {unit}".strip() if unit else name for name, unit in zip(names, units, strict=True)
    )
    plain = tuple(
        tuple(field.replace(",", ".") if _COMMA.fullmatch(field) else field for field in row)
        for row in rows
    )
    header = tuple(
        (row[0], row[1] if len(row) > 1 else "") for row in parsed[:start] if row and row[0]
    )
    return NumberTable(columns, lines, plain, header), faults


def _real_lines(text: str) -> list[str]:
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _starts_table(parsed: list[list[str]], k: int) -> bool:
    """Two numbers here, and as many in the row after the next blank ones (if there is one)."""
    if _numbers_in(parsed[k]) < 2:
        return False
    later = [row for row in parsed[k + 1 : k + 6] if any(row)]
    return not later or _numbers_in(later[0]) >= 2


def _header_rows(parsed: list[list[str]], first: int) -> tuple[list[str], list[str], int]:
    """Names, units and the index of the line of the names; no names where there are none."""
    above = [k for k in range(first) if any(parsed[k])]
    if not above:
        return [], [], 0
    last = above[-1]
    row = parsed[last]
    is_units = (
        len(above) > 1
        and sum(bool(field) for field in row) >= 2
        and all(not field or (_UNIT_ROW.fullmatch(field) and len(field) <= 12) for field in row)
        and all(not field or field[0] in "[(" or len(field) <= 4 for field in row)
        and len(parsed[above[-2]]) == len(parsed[last])
    )
    if not is_units:
        return (row, [""] * len(row), last) if sum(map(bool, row)) >= 2 else ([], [], 0)
    names = parsed[above[-2]]
    units = [
        "" if not unit else unit if unit[0] in "[(" else f"({unit})" for unit in row[: len(names)]
    ]
    return names, units + [""] * (len(names) - len(units)), above[-2]


def _check_decimals(rows: tuple[tuple[str, ...], ...], lines: tuple[int, ...], path: Path) -> None:
    seen: dict[str, tuple[int, str]] = {}
    for line, row in zip(lines, rows, strict=True):
        for field in row:
            if "," in field and "." in field and _BOTH.fullmatch(field):
                seen["both"] = (line, field)
            elif _COMMA.fullmatch(field):
                seen.setdefault("comma", (line, field))
            elif "." in field and _POINT.fullmatch(field):
                seen.setdefault("point", (line, field))
        if len(seen) > 1 or "both" in seen:
            line, field = seen.get("both", (line, ""))
            raise TableError(
                "curve-decimal-mixed",
                "Decimal points and decimal commas are mixed, or thousands are separated.",
                remedy="Export with one decimal mark and no mark for thousands.",
                file=path,
                row=line,
                got=short(", ".join(sorted({text for _, text in seen.values()} | {field} - {""}))),
            )
