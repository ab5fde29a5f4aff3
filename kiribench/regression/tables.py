"""Compare a fresh table with one on disk, column by column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kiribench.regression.check import Check
from kiribench.schema.result_tables import field_text

Row = Mapping[str, Any]

#: Numbers that rounding and another processor's order of sums may change.
ROUNDING = 1e-6
#: Quantiles and shares of random draws: one draw in a thousand may fall on the other side.
DRAWN = 2e-3
_DRAWN_COLUMNS = ("overlap_low", "overlap_high", "probability_", "perfect_fit_reading")


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a TSV as text."""
    text = path.read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text), delimiter="\t"))


def bound_of(column: str) -> float:
    """Admissible drift of a recorded column."""
    return DRAWN if column.startswith(_DRAWN_COLUMNS) else ROUNDING


def compare_record(name: str, fresh: Sequence[Row], path: Path, seconds: float) -> list[Check]:
    """Every column of a fresh table against the recorded one.

    Args:
        name: such as ``S1 conform``.
        fresh: rows of values. path: the recorded TSV.
        seconds: time that the fresh table took.
    """
    if not path.is_file():
        detail = f"There is no recorded table {path.name}; review the numbers, then --update."
        return [Check("record", name, False, None, ROUNDING, detail, seconds)]
    recorded = read_rows(path)
    columns = list(fresh[0])
    if len(recorded) != len(fresh) or list(recorded[0]) != columns:
        detail = f"{path.name} has other rows or columns than the table of today."
        return [Check("record", name, False, None, ROUNDING, detail, seconds)]
    return [
        _compare_column(f"{name} {column}", column, fresh, recorded, seconds / len(columns))
        for column in columns
        if column not in ("row", "col")
    ]


def _compare_column(
    name: str, column: str, fresh: Sequence[Row], recorded: Sequence[Row], seconds: float
) -> Check:
    bound = bound_of(column)
    worst, where, mismatch = 0.0, "", ""
    for new, old in zip(fresh, recorded, strict=True):
        place = f"cell ({old['row']}, {old['col']})"
        value, before = new[column], str(old[column])
        known = number(before)
        if isinstance(value, float) and known is not None:
            # Relative above 1: areas in mm^2, unbounded ratios.
            apart = abs(value - known) / max(1.0, abs(known))
            if apart > worst:
                worst, where = apart, place
        elif field_text(value) != before:
            mismatch = mismatch or f"{place}: {before} became {field_text(value)}"
    passed = worst <= bound and not mismatch
    return Check("record", name, passed, worst, bound, mismatch or where, seconds)


def compare_truth(
    name: str,
    fresh: Mapping[tuple[int, int], float | None],
    truth: Mapping[tuple[int, int], float],
    bound: float,
    seconds: float,
) -> Check:
    """The largest difference of fresh values from true ones.

    Args:
        fresh: value a cell, None where it is masked; masked cells are not compared.
        truth: value a cell.
    """
    worst, where, compared = 0.0, "", 0
    for at, true in truth.items():
        value = fresh.get(at)
        if value is None:
            continue
        compared += 1
        if abs(value - true) > worst:
            worst, where = abs(value - true), f"worst in cell {at} of {len(truth)}"
    if compared == 0:
        return Check("truth", name, False, None, bound, "No cell could be compared.", seconds)
    return Check("truth", name, worst <= bound, worst, bound, where, seconds)


def number(text: str) -> float | None:
    """The finite number that a field holds, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def column_of(rows: Sequence[Row], column: str) -> dict[tuple[int, int], float]:
    """Finite values of a TSV column by cell."""
    out = {}
    for row in rows:
        value = number(str(row[column]))
        if value is not None:
            out[int(row["row"]), int(row["col"])] = value
    return out
