"""Tab-separated tables: parsed to text fields with line numbers, faults collected."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kiribench.errors import Fault
from kiribench.schema.strict_json import decode_text, short

MAX_TSV_BYTES = 64_000_000

_DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+$")


@dataclass(frozen=True)
class TsvTable:
    """A parsed table.

    Attributes:
        file: name for messages.
        columns: header, stripped.
        lines: 1-based line of the file of each row (the header is usually line 1).
        rows: the fields of each row, stripped, as many as columns.
    """

    file: str
    columns: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]

    def column(self, name: str) -> tuple[str, ...]:
        """The fields of one column."""
        index = self.columns.index(name)
        return tuple(row[index] for row in self.rows)


def is_decimal_comma(field: str) -> bool:
    """Whether ``field`` is a number written with a decimal comma."""
    return _DECIMAL_COMMA.match(field) is not None


def parse_tsv(data: bytes, *, file: str) -> tuple[TsvTable | None, tuple[Fault, ...]]:
    """The table of a TSV file, or None; and its faults.

    Codes: ``table-too-large``, ``text-encoding``, ``text-binary``, ``text-bom`` (warning),
    ``table-empty``, ``table-separator``, ``table-duplicate-column``, ``table-ragged``.
    """
    if len(data) > MAX_TSV_BYTES:
        return None, (
            Fault(
                "table-too-large",
                "The table is far larger than a table of nodes can be.",
                "Keep one row a grid node.",
                file=file,
                got=f"{len(data)} bytes",
                expected=f"at most {MAX_TSV_BYTES}",
            ),
        )
    text, decoding = decode_text(data, file=file)
    if text is None:
        return None, decoding
    faults = list(decoding)
    # Only real line ends: splitlines() would also break at form feeds and the like.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    if not numbered:
        faults.append(
            Fault(
                "table-empty",
                "The table is empty.",
                "Write a header line and one line a row, with tabs between the columns.",
                file=file,
            )
        )
        return None, tuple(faults)
    first, header = numbered[0]
    columns = tuple(name.strip().strip('"') for name in header.split("\t"))
    if len(columns) == 1:
        for separator, name in ((",", "commas"), (";", "semicolons"), (" ", "spaces")):
            if separator in header.strip():
                faults.append(
                    Fault(
                        "table-separator",
                        f"The columns are separated by {name}.",
                        "Save the table with tabs between the columns and decimal points.",
                        file=file,
                        row=first,
                        got=short(header.strip()),
                        expected="tabs",
                    )
                )
                return None, tuple(faults)
    for name in sorted({name for name in columns if columns.count(name) > 1}):
        faults.append(
            Fault(
                "table-duplicate-column",
                "Two columns have the same name.",
                "Keep one of them.",
                file=file,
                row=first,
                column=short(name)[1:-1],
            )
        )
    kept: list[tuple[int, tuple[str, ...]]] = []
    for number, line in numbered[1:]:
        fields = tuple(field.strip().strip('"') for field in line.split("\t"))
        if len(fields) > len(columns) and not any(fields[len(columns) :]):
            fields = fields[: len(columns)]
        if len(fields) != len(columns):
            faults.append(
                Fault(
                    "table-ragged",
                    "The row has not as many fields as the header has columns.",
                    "Write n/a where there is no value.",
                    file=file,
                    row=number,
                    got=f"{len(fields)} fields",
                    expected=f"{len(columns)}",
                )
            )
            continue
        kept.append((number, fields))
    if any(fault.code == "table-duplicate-column" for fault in faults):
        return None, tuple(faults)
    table = TsvTable(
        file, columns, tuple(number for number, _ in kept), tuple(fields for _, fields in kept)
    )
    return table, tuple(faults)
