"""Which column of another program's table is what, and in which unit."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.schema.strict_json import short

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

_NAMES = {
    "a": "a",
    "b": "b",
    "strain": "strain",
    "longitudinal_strain": "strain",
    "nu": "nu",
    "poisson": "nu",
    "poisson_ratio": "nu",
    "poissons_ratio": "nu",
    "displacement": "displacement",
    "u": "displacement",
}
_UNITS = {
    "%": "percent",
    "percent": "percent",
    "fraction": "fraction",
    "-": "fraction",
    "1": "fraction",
    "mm/mm": "fraction",
    "mm": "mm",
}


@dataclass(frozen=True)
class Column:
    """A column of the source: its name there, and the unit that the name declares."""

    name: str
    unit: str | None


def _parse(header: str) -> tuple[str, str | None]:
    """Role-like name and unit of a column head: ``Strain [%]`` is strain, percent."""
    match = re.fullmatch(r"\s*([^\[(]+?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*", header)
    name, unit = (match[1], match[2].lower()) if match else (header.strip(), None)
    name = re.sub(r"[\s\-']+", "_", name.strip().lower().replace("'s", "s"))
    for suffix in ("percent", "fraction", "mm"):
        if unit is None and name.endswith(f"_{suffix}"):
            name, unit = name[: -len(suffix) - 1], suffix
    return name, unit


def find_columns(frame: pd.DataFrame, path: Path) -> dict[str, Column]:
    """The columns a, b, strain, nu and, if it is there, displacement, by role.

    Raises:
        TableError: a column is missing or there twice, or its unit is not known.
    """
    found: dict[str, Column] = {}
    faults = []
    for header in map(str, frame.columns):
        name, unit = _parse(header)
        role = _NAMES.get(name)
        if role is None:
            continue
        if role in found:
            faults.append(
                Fault(
                    "column-twice",
                    f"Two columns give {role}.",
                    "Rename or remove one of them.",
                    file=str(path),
                    column=header,
                    got=f"{found[role].name}, {header}",
                )
            )
        if unit is not None and unit not in _UNITS:
            faults.append(
                Fault(
                    "unit-unknown",
                    "The unit in the column's name is not known.",
                    "Use %, -, fraction or mm.",
                    file=str(path),
                    column=header,
                    got=unit,
                )
            )
        meant = None if unit is None else _UNITS.get(unit)
        # The name that kiribench itself uses is a fraction by its convention.
        if name == "longitudinal_strain" and meant is None:
            meant = "fraction"
        found[role] = Column(header, meant)
    faults += [
        Fault(
            "column-missing",
            f"No column gives {role}.",
            "Give the columns a, b, strain and nu (displacement too, if there is one).",
            file=str(path),
            column=role,
            got=short(", ".join(map(str, frame.columns)), 200),
        )
        for role in ("a", "b", "strain", "nu")
        if role not in found
    ]
    if "displacement" in found and found["displacement"].unit not in (None, "mm"):
        faults.append(
            Fault(
                "unit-unknown",
                "The displacement is not in mm.",
                "Convert it to mm.",
                file=str(path),
                column=found["displacement"].name,
            )
        )
    if faults:
        raise TableError.of(faults)
    return found


def strain_unit_of(column: Column, sidecar: dict[str, Any], asked: str | None, path: Path) -> str:
    """``fraction`` or ``percent``: by the column's name, the sidecar or the caller.

    Raises:
        TableError: nobody says it, or two say different things.
    """
    declared = []
    if column.unit is not None:
        declared.append((f"the column {column.name}", column.unit))
    if "StrainUnit" in sidecar:
        word = str(sidecar["StrainUnit"]).strip().lower()
        declared.append(("the sidecar", _UNITS.get(word, word)))
    if asked is not None:
        declared.append(("the call", asked))
    wrong = [entry for entry in declared if entry[1] not in ("fraction", "percent")]
    if not declared or wrong:
        raise TableError(
            "strain-unit-missing",
            "The table does not say whether its strains are fractions or percent: 0.5 is "
            "half the length or half a percent.",
            remedy=f"Name the column 'strain [%]' or 'strain [-]', write "
            f'{{"StrainUnit": "fraction"}} to {path.with_suffix(".json").name}, or give '
            "--strain-unit.",
            file=path,
            column=column.name,
            got="; ".join(f"{where} says {unit}" for where, unit in wrong) or None,
            expected="fraction or percent",
        )
    if len({unit for _, unit in declared}) > 1:
        raise TableError(
            "strain-unit-conflict",
            "The unit of the strains is declared twice and differently.",
            remedy="Find out which is right, and correct the other.",
            file=path,
            column=column.name,
            got="; ".join(f"{where} says {unit}" for where, unit in declared),
        )
    return declared[0][1]


def cut_unit_of(
    columns: dict[str, Column], numbers: dict[str, FloatArray], path: Path
) -> tuple[str, tuple[Fault, ...]]:
    """Unit of the cut lengths, declared or concluded from their size; then with a warning.

    Raises:
        TableError: a and b differ in unit, or nothing can be concluded.
    """
    declared = {columns[name].unit for name in "ab"} - {None}
    both = np.concatenate([numbers["a"], numbers["b"]])
    if len(declared) > 1 or declared - {"percent", "fraction"}:
        raise TableError(
            "cut-unit-conflict",
            "The columns a and b are in different units.",
            remedy="Give both in percent of the cell, or both as fractions.",
            file=path,
            got=", ".join(columns[name].name for name in "ab"),
        )
    if declared:
        return str(declared.pop()), ()
    if both.max() > 1:
        unit, why = "percent", "some exceed 1, and a cut is shorter than its cell"
    elif ((both > 0) & (both < 1)).sum() > 1 and both.max() > 0.01:
        unit, why = "fraction", "none exceeds 1"
    else:
        raise TableError(
            "cut-unit-missing",
            "The cut lengths may be percent or fractions.",
            remedy="Name the columns a_percent and b_percent, or a_fraction and b_fraction.",
            file=path,
            column=columns["a"].name,
            got=f"{both.min():g} to {both.max():g}",
        )
    note = Fault(
        "cut-unit-concluded",
        f"The cut lengths are taken for {unit}: {why}.",
        f"Name the columns a_{unit} and b_{unit} to say so.",
        file=str(path),
        got=f"{both.min():g} to {both.max():g}",
        severity="warning",
    )
    return unit, (note,)
