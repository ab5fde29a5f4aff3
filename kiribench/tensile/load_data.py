"""The test machine's table: time, displacement and force, in the units of its header."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from kiribench.errors import Fault, TableError
from kiribench.schema.strict_json import decode_text
from kiribench.tensile.sidecar import Load

FloatArray = npt.NDArray[np.float64]

UNITS = {
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "displacement": {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "in": 25.4},
    "force": {
        "n": 1.0,
        "kn": 1000.0,
        "mn": 1e-3,
        "gf": 9.80665e-3,
        "kgf": 9.80665,
        "lbf": 4.4482216152605,
    },
}
"""Factors to s, mm and N. ``mN`` is millinewton: no machine for sheets gives meganewton."""
WORDS = {
    "time": ("time", "zeit", "temps", "tiempo", "tempo"),
    "displacement": ("displacement", "extension", "crosshead", "stroke", "weg", "position"),
    "force": ("force", "load", "kraft"),
}
START = 1e-3
"""The crosshead has started where it has moved by this part of its whole way."""
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")


@dataclass(frozen=True, eq=False)
class LoadTable:
    """The machine's record, (n,) each; NaN where a column is missing.

    Attributes:
        time_s, displacement_mm, force_n: as named.
        file: where it was read from.
        units: as found in the header, by quantity.
        warnings: columns without a unit, and the like.
    """

    time_s: FloatArray
    displacement_mm: FloatArray
    force_n: FloatArray
    file: Path
    units: dict[str, str]
    warnings: tuple[Fault, ...]

    @property
    def start_s(self) -> float:
        """When the crosshead starts to move, by its own displacement; NaN if never."""
        moved = np.abs(self.displacement_mm - self.displacement_mm[0])
        if not np.isfinite(moved).any() or np.nanmax(moved) == 0:
            return float("nan")
        first = int(np.argmax(moved > START * np.nanmax(moved)))
        return float(self.time_s[max(first - 1, 0)])

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Displacement and force at times (k,), linear between rows; NaN outside the record."""

        def read(values: FloatArray) -> FloatArray:
            known = np.isfinite(values) & np.isfinite(self.time_s)
            if known.sum() < 2:
                return np.full(len(time_s), np.nan)
            out = np.interp(time_s, self.time_s[known], values[known], left=np.nan, right=np.nan)
            return np.where(np.isfinite(time_s), out, np.nan)

        return read(self.displacement_mm), read(self.force_n)


def read_load(path: Path, load: Load) -> LoadTable:
    """Read a machine's table: any separator, decimal points or commas, units in the header.

    Args:
        path: the file. load: names of columns that are not recognised.

    Raises:
        TableError: no file, no header with numbers below it, unknown unit, a field that is no
            number, times that do not grow; with every fault found.
    """
    if not path.is_file():
        raise TableError(
            "load-missing",
            "The machine's table is not there.",
            remedy="Put it beside the pictures, or remove 'load' from tensile.json.",
            file=path,
        )
    data = path.read_bytes()
    text, faults = decode_text(data, file=str(path))
    if text is None:
        if any(fault.code == "text-binary" for fault in faults) or data[:2] in (
            b"\xff\xfe",
            b"\xfe\xff",
        ):
            raise TableError.of(faults)
        text = data.decode("latin-1")  # µ and ° of older machines
    lines = [line.strip() for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n")]
    separator = _separator(lines)
    rows = [[field.strip().strip('"').strip() for field in line.split(separator)] for line in lines]
    first = next((k for k, row in enumerate(rows) if _numeric(row) >= 2), None)
    names_at = None if first is None else _header(rows, first)
    if first is None or names_at is None:
        raise TableError(
            "load-header",
            "No header with numbers below it was found.",
            remedy="Keep a line with names such as 'Time (s);Extension (mm);Load (N)'.",
            file=path,
            got=lines[0][:60] if lines else "an empty file",
        )
    header = rows[names_at]
    below = rows[names_at + 1] if names_at + 1 < first else []
    columns, units, doubts = _columns(header, below, load, path, names_at + 1)
    found: dict[str, list[float]] = {name: [] for name in columns}
    wrong: list[Fault] = []
    for number in range(first, len(rows)):
        if not any(rows[number]):
            continue
        for name, at in columns.items():
            field = rows[number][at] if at < len(rows[number]) else ""
            value = _value(field)
            if value is None:
                wrong.append(
                    Fault(
                        "load-value",
                        "A field of the machine's table is no number.",
                        "Correct or remove the row.",
                        file=str(path),
                        row=number + 1,
                        column=header[at],
                        got=field[:40],
                    )
                )
                value = float("nan")
            found[name].append(value * UNITS[name][units[name].lower()])
    if wrong:
        raise TableError.of(wrong[:20])
    count = len(next(iter(found.values())))
    time = np.array(found.get("time", [np.nan] * count))
    if "time" in found and np.any(np.diff(time) < 0):
        at = int(np.argmax(np.diff(time) < 0))
        raise TableError(
            "load-time-order",
            "The machine's time goes back.",
            remedy="Keep one test in the file, in its order.",
            file=path,
            row=first + at + 2,
            got=f"{time[at + 1]:g} after {time[at]:g} s",
        )
    return LoadTable(
        time,
        np.array(found.get("displacement", [np.nan] * count)),
        np.array(found.get("force", [np.nan] * count)),
        path,
        units,
        doubts,
    )


def _separator(lines: list[str]) -> str:
    for separator in ("\t", ";"):
        if sum(separator in line for line in lines) > 0.5 * sum(bool(line) for line in lines):
            return separator
    return ","


def _numeric(row: list[str]) -> int:
    return sum(_NUMBER.match(field) is not None for field in row)


def _value(field: str) -> float | None:
    if field == "" or field.lower() in ("n/a", "nan"):
        return float("nan")
    if _NUMBER.match(field) is None:
        return None
    return float(field.replace(",", "."))


def _header(rows: list[list[str]], first: int) -> int | None:
    """The line of names: the one of the last three before the numbers that has known words."""
    for at in range(first - 1, max(first - 4, -1), -1):
        low = [field.lower() for field in rows[at]]
        if any(word in field for field in low for words in WORDS.values() for word in words):
            return at
    return first - 1 if first else None


def _columns(
    header: list[str], below: list[str], load: Load, path: Path, line: int
) -> tuple[dict[str, int], dict[str, str], tuple[Fault, ...]]:
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    doubts: list[Fault] = []
    for name, words in WORDS.items():
        declared = load.columns.get(name)  # type: ignore[call-overload]
        if declared is not None:
            if declared not in header:
                raise TableError(
                    "load-column",
                    "A declared column is not in the machine's table.",
                    remedy="Copy the name from the header line.",
                    file=path,
                    row=line,
                    column=declared,
                    got="; ".join(header)[:80],
                )
            at: int | None = header.index(declared)
        else:
            at = next(
                (k for k, field in enumerate(header) if any(w in field.lower() for w in words)),
                None,
            )
        if at is None:
            continue
        columns[name] = at
        written = re.search(r"[(\[/]\s*([A-Za-zµ]+)\s*[)\]]?\s*$", header[at])
        unit = written[1] if written else ""
        if not unit and at < len(below):
            unit = below[at].strip("()[] ")
        if not unit:
            unit = {"time": "s", "displacement": "mm", "force": "N"}[name]
            doubts.append(
                Fault(
                    "load-unit-missing",
                    f"The column of the {name} has no unit; {unit} is taken.",
                    f"Write it into the header, as in '{header[at]} ({unit})'.",
                    file=str(path),
                    row=line,
                    column=header[at],
                    severity="warning",
                )
            )
        if unit.lower() not in UNITS[name] or (name == "force" and unit == "MN"):
            raise TableError(
                "load-unit",
                f"The unit of the {name} is not known.",
                remedy="Export with one of the units named.",
                file=path,
                row=line,
                column=header[at],
                got=unit,
                expected=", ".join(UNITS[name]),
            )
        units[name] = unit
    if not {"displacement", "force"} & set(columns):
        raise TableError(
            "load-columns",
            "The machine's table has neither a displacement nor a force.",
            remedy='Name them in tensile.json: "columns": {"force": "..."}.',
            file=path,
            row=line,
            got="; ".join(header)[:80],
        )
    return columns, units, tuple(doubts)
