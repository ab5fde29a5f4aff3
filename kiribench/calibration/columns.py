"""Roles and units of a tension test's columns, from their names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from kiribench.errors import Fault, TableError
from kiribench.schema.strict_json import short

Role = Literal["time", "displacement", "force", "strain", "stress", "stretch"]
Kind = Literal["engineering", "true"]

UNITS: dict[Role, dict[str, float]] = {
    "time": {"s": 1, "sec": 1, "min": 60, "ms": 1e-3},
    "displacement": {"mm": 1, "cm": 10, "m": 1000, "um": 1e-3, "in": 25.4, "inch": 25.4},
    "force": {"n": 1, "kn": 1e3, "mn": 1e-3, "cn": 1e-2, "gf": 9.80665e-3, "kgf": 9.80665,
              "lbf": 4.4482216152605},
    "strain": {"%": 0.01, "percent": 0.01, "mm/mm": 1, "m/m": 1, "-": 1, "1": 1, "fraction": 1},
    "stress": {"mpa": 1, "kpa": 1e-3, "pa": 1e-6, "gpa": 1e3, "n/mm2": 1, "psi": 6.894757293168e-3},
    "stretch": {"": 1, "-": 1, "1": 1, "mm/mm": 1, "m/m": 1},
}  # fmt: skip
"""Accepted units of each role and their factor to s, mm, N, a fraction, MPa, a ratio."""

_WORDS: tuple[tuple[str, Role], ...] = (
    (r"\bstress\b", "stress"),
    (r"\bstretch\b|\blambda\b|λ", "stretch"),
    (r"\bstrain\b|\belongation\b", "strain"),
    (r"\bforce\b|\bload\b", "force"),
    (r"\bdisplacement\b|\bextension\b|\bcrosshead\b|\bposition\b|\bstroke\b|\btravel\b",
     "displacement"),
    (r"\btime\b", "time"),
)  # fmt: skip


@dataclass(frozen=True)
class Column:
    """One column of the table.

    Attributes:
        index: its place, from 0.
        name: its head.
        role: what it holds.
        unit: as written, lower case (``mN`` and ``MN`` are kept apart); empty where absent.
        kind: engineering or true, where the name says it.
    """

    index: int
    name: str
    role: Role
    unit: str
    kind: Kind | None

    @property
    def factor(self) -> float:
        """Factor to the unit of kiribench (s, mm, N, fraction, MPa)."""
        return UNITS[self.role][self.unit]


def find_columns(heads: tuple[str, ...], path: Path) -> tuple[Column, ...]:
    """The columns whose names say what they hold.

    Raises:
        TableError: ``curve-unit`` for a unit that is not known, with every such column.
    """
    found, faults = [], []
    for index, head in enumerate(heads):
        match = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]\s*(?:[\[(].*)?", head)
        name, unit = (match[1], match[2]) if match else (head.strip(), "")
        low = name.lower()
        role = next((role for word, role in _WORDS if re.search(word, low)), None)
        if role is None:
            continue
        unit = _plain_unit(unit)
        if unit and unit not in UNITS[role]:
            faults.append(
                Fault(
                    "curve-unit",
                    "The unit in the column's name is not known.",
                    "Use one of: " + ", ".join(key for key in UNITS[role] if key) + ".",
                    file=str(path),
                    column=short(head),
                    got=short(unit),
                )
            )
            continue
        kind: Kind | None = None
        if re.search(r"\btrue\b|\bcauchy\b|\blog\b|\bhencky\b|\blogarithmic\b", low):
            kind = "true"
        elif re.search(r"\bengineering\b|\bnominal\b|\beng\b|\belongation\b", low):
            kind = "engineering"
        found.append(Column(index, head, role, unit, kind))
    if faults:
        raise TableError.of(faults)
    return tuple(found)


def _plain_unit(unit: str) -> str:
    text = unit.strip().replace("²", "2").replace("^", "").replace("µ", "u").replace("μ", "u")
    # MN would become mN in lower case; nobody pulls a sample with a meganewton.
    return "meganewton" if text == "MN" else text.lower()


def pick(columns: tuple[Column, ...], role: Role, kind: Kind | None, path: Path) -> Column | None:
    """The column of a role: the engineering one where both are there, ``kind`` if undeclared.

    Raises:
        TableError: two columns that say the same, or no unit, or no kind.
    """
    there = [column for column in columns if column.role == role]
    if not there:
        return None
    for wanted in ("engineering", None, "true"):
        of_kind = [column for column in there if column.kind == wanted]
        if len(of_kind) > 1:
            raise TableError(
                "curve-column-twice",
                f"Several columns give the {role}.",
                remedy="Remove or rename all but one of them.",
                file=path,
                got=short(", ".join(column.name for column in of_kind)),
            )
        if of_kind:
            column = of_kind[0]
            break
    if role in ("strain", "stress") and column.kind is None and kind is None:
        raise TableError(
            "curve-kind-missing",
            f"The table does not say whether its {role} is engineering (by undeformed size) or "
            "true.",
            remedy=f"Name the column 'Engineering {role}' or 'True {role}', or give --kind.",
            file=path,
            column=short(column.name),
        )
    return column
