"""Result tables on disk: TSV with a JSON sidecar that says what every column is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: Digits of a number in a table: micrometres and parts in 10^8, more than any scan holds,
#: few enough that a table reads well and does not change with the order of a sum.
DIGITS = 9


def field_text(value: object) -> str:
    """A table field: ``n/a`` for no value, ``true`` and ``false``, else the plain value."""
    if value is None:
        return "n/a"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    return str(value)


def write_table(
    path: Path, rows: Sequence[Mapping[str, Any]], sidecar: Mapping[str, Any]
) -> tuple[Path, Path]:
    """Write rows as TSV and the sidecar as JSON beside it.

    Args:
        path: the ``.tsv`` file; its folder is made.
        rows: at least one, all with the same keys in the same order.
        sidecar: what the columns mean and how the numbers came about.

    Returns:
        The two files.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["\t".join(rows[0])]
    lines += ["\t".join(field_text(value) for value in row.values()) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    beside = path.with_suffix(".json")
    text = json.dumps(sidecar, indent=2, allow_nan=False, ensure_ascii=False)
    beside.write_text(text + "\n", encoding="utf-8", newline="\n")
    return path, beside
