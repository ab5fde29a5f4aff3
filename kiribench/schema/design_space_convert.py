"""Design space tables of other programs, converted to stretches.

A table such as one collects from Abaqus has a row a design and load step with the cut lengths,
the displacement, the longitudinal strain and Poisson's ratio. Three things decide what its
numbers mean, and none of them is guessed: the strain measure and the strain's unit must be
declared (in a column's name, in the sidecar or by the caller); the unit of the cut lengths is
taken from the column's name or follows from the numbers, and is then reported.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.provenance import file_sha256
from kiribench.schema.design_space import read_frame, read_sidecar, settle_measure
from kiribench.schema.design_space_table import TABLE_FILE, table_of, write_design_space
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
_MOST_FAULTS = 20
_STRETCH = (0.05, 20.0)
_POISSON = (-10.0, 10.0)


@dataclass(frozen=True, eq=False)
class Converted:
    """A table of another program as stretches.

    Attributes:
        file, sidecar: what was written.
        frame: the table.
        measure: the strain measure that the source was in.
        strain_unit, cut_unit: ``fraction`` or ``percent``, of the source.
        notes: what was concluded from the numbers, as warnings.
        inputs: the files that were read.
    """

    file: Path
    sidecar: Path
    frame: pd.DataFrame
    measure: str
    strain_unit: str
    cut_unit: str
    notes: tuple[Fault, ...]
    inputs: tuple[Path, ...]


@dataclass(frozen=True)
class _Column:
    """A column of the source: its name there, and the unit that the name declares."""

    name: str
    unit: str | None


def stretch_of_strain(strain: FloatArray, measure: str) -> FloatArray:
    """Stretch (deformed / undeformed length) of strains (any shape) in a named measure.

    NaN where no stretch has that strain: engineering below -1, Green below -1/2.
    """
    if measure == "engineering":
        stretch = 1.0 + strain
    elif measure == "green":
        with np.errstate(invalid="ignore"):
            stretch = np.sqrt(1.0 + 2.0 * strain)
    else:
        stretch = np.exp(strain)
    return np.where(stretch > 0, stretch, np.nan)


def convert_table(
    path: Path,
    out: Path,
    *,
    strain_measure: str | None = None,
    strain_unit: str | None = None,
) -> Converted:
    """Read, check and convert a table of another program; write it as a design space.

    Args:
        path: CSV, TSV or Parquet with columns a, b, strain, nu and, if there is one,
            displacement. A unit may follow: ``a_percent``, ``a [%]``, ``strain (-)``. The
            sidecar of the same stem may hold ``StrainMeasure`` and ``StrainUnit``.
        out: the folder; ``design_space.parquet`` and ``.json`` are written there.
        strain_measure: ``log``, ``engineering`` or ``green``, unless the table says it.
        strain_unit: ``fraction`` or ``percent``, unless the table says it.

    Raises:
        TableError: columns are missing or there twice, measure or unit are not declared or
            declared differently, values are no numbers or impossible, or a design has two
            rows at one strain; all rows at fault are named.
    """
    frame, sidecar = read_frame(path), read_sidecar(path)
    columns = _find_columns(frame, path)
    measure = settle_measure(frame, sidecar, strain_measure, False, path)
    unit = _strain_unit(columns["strain"], sidecar, strain_unit, path)
    numbers = _numbers(frame, columns, path)
    cut_unit, notes = _cut_unit(columns, numbers, path)
    a, b = (
        np.round(numbers[name] * (100.0 if cut_unit == "fraction" else 1.0), 9) for name in "ab"
    )
    strain = numbers["strain"] / (100.0 if unit == "percent" else 1.0)
    along = stretch_of_strain(strain, measure)
    across = stretch_of_strain(-numbers["nu"] * strain, measure)
    _check(path, columns, {"a": a, "b": b, "nu": numbers["nu"]}, along, across)
    order = np.lexsort((along, b, a))
    _check_steps(path, a, b, along, numbers.get("displacement"), order)
    first = np.concatenate([[True], (np.diff(a[order]) != 0) | (np.diff(b[order]) != 0)])
    start = np.flatnonzero(first)
    step = np.arange(len(order)) - start[np.cumsum(first) - 1] + 1
    values: dict[str, Any] = {
        "design": [f"{x:.12g}-{y:.12g}" for x, y in zip(a[order], b[order], strict=True)],
        "a_percent": a[order],
        "b_percent": b[order],
        "step": step,
        "longitudinal_stretch": along[order],
        "lateral_stretch": across[order],
        "status": ["ok"] * len(order),
    }
    if "displacement" in numbers:
        values["displacement_mm"] = numbers["displacement"][order]
    table = table_of(values)
    file, beside = write_design_space(
        out / TABLE_FILE,
        table,
        {
            "Schema": "kiribench.design-space/1",
            "Model": "converted",
            "ConvertedFrom": {
                "File": path.name,
                "Sha256": file_sha256(path),
                "StrainMeasure": measure,
                "StrainUnit": unit,
                "CutUnit": cut_unit,
                "Columns": {role: column.name for role, column in columns.items()},
            },
            "Designs": int(first.sum()),
            "NotKnown": ["nominal_stress_mpa", "energy_mpa", "face_overlap_mm"]
            + ["mesh_error_poisson"]
            + ([] if "displacement" in numbers else ["displacement_mm"]),
        },
    )
    described = path.with_suffix(".json")
    inputs = (path, described) if sidecar else (path,)
    return Converted(file, beside, table, measure, unit, cut_unit, notes, inputs)


def _parse(header: str) -> tuple[str, str | None]:
    """Role-like name and unit of a column head: ``Strain [%]`` is strain, percent."""
    match = re.fullmatch(r"\s*([^\[(]+?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*", header)
    name, unit = (match[1], match[2].lower()) if match else (header.strip(), None)
    name = re.sub(r"[\s\-']+", "_", name.strip().lower().replace("'s", "s"))
    for suffix in ("percent", "fraction", "mm"):
        if unit is None and name.endswith(f"_{suffix}"):
            name, unit = name[: -len(suffix) - 1], suffix
    return name, unit


def _find_columns(frame: pd.DataFrame, path: Path) -> dict[str, _Column]:
    found: dict[str, _Column] = {}
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
        found[role] = _Column(header, meant)
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


def _strain_unit(column: _Column, sidecar: dict[str, Any], asked: str | None, path: Path) -> str:
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


def _numbers(frame: pd.DataFrame, columns: dict[str, _Column], path: Path) -> dict[str, FloatArray]:
    import pandas as pd

    result = {}
    faults = []
    for role, column in columns.items():
        values = pd.to_numeric(frame[column.name], errors="coerce").to_numpy(dtype=np.float64)
        result[role] = values
        faults += [
            Fault(
                "value-no-number",
                "The value is no number.",
                "Correct it, or leave the row out.",
                file=str(path),
                row=int(row) + 1,
                column=column.name,
                got=short(str(frame[column.name].iloc[row])),
            )
            for row in np.flatnonzero(~np.isfinite(values))[:_MOST_FAULTS]
        ]
    if faults:
        raise TableError.of(faults[:_MOST_FAULTS])
    return result


def _cut_unit(
    columns: dict[str, _Column], numbers: dict[str, FloatArray], path: Path
) -> tuple[str, tuple[Fault, ...]]:
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


def _check(
    path: Path,
    columns: dict[str, _Column],
    numbers: dict[str, FloatArray],
    along: FloatArray,
    across: FloatArray,
) -> None:
    limits = {
        "a": (numbers["a"], 0.0, 100.0, "a cut length in percent of the cell"),
        "b": (numbers["b"], 0.0, 100.0, "a cut length in percent of the cell"),
        "nu": (numbers["nu"], *_POISSON, "Poisson's ratio"),
        "strain": (along, *_STRETCH, "a stretch along the pull"),
        "lateral": (across, *_STRETCH, "a stretch across the pull, from nu and strain"),
    }
    faults = []
    for role, (values, low, high, meaning) in limits.items():
        for row in np.flatnonzero(~((values >= low) & (values <= high)))[:_MOST_FAULTS]:
            faults.append(
                Fault(
                    "value-out-of-range",
                    f"The row gives {meaning} that is impossible.",
                    "Correct the row, or check the declared measure and unit of the strains.",
                    file=str(path),
                    row=int(row) + 1,
                    column=columns["nu" if role == "lateral" else role].name,
                    got="no stretch at all" if np.isnan(values[row]) else f"{values[row]:g}",
                    expected=f"{low:g} to {high:g}",
                )
            )
    faults += [
        Fault(
            "strain-zero",
            "At zero strain Poisson's ratio is 0 / 0.",
            "Leave the row out.",
            file=str(path),
            row=int(row) + 1,
            column=columns["strain"].name,
        )
        for row in np.flatnonzero(np.abs(along - 1) < 1e-9)[:_MOST_FAULTS]
    ]
    if faults:
        raise TableError.of(faults[:_MOST_FAULTS])


def _check_steps(
    path: Path,
    a: FloatArray,
    b: FloatArray,
    along: FloatArray,
    displacement: FloatArray | None,
    order: NDArray[np.int64],
) -> None:
    """No design has two rows at one strain, and displacement and strain grow together."""
    same = (np.diff(a[order]) == 0) & (np.diff(b[order]) == 0)
    faults = [
        Fault(
            "step-twice",
            "Two rows of one design have the same strain.",
            "Leave one of them out.",
            file=str(path),
            row=int(order[k + 1]) + 1,
            got=f"also in row {int(order[k]) + 1}",
        )
        for k in np.flatnonzero(same & (np.diff(along[order]) < 1e-9))[:_MOST_FAULTS]
    ]
    if displacement is not None and not faults:
        faults = [
            Fault(
                "steps-disagree",
                "The design's strain grows where its displacement does not.",
                "Check that the rows belong to the designs that they name.",
                file=str(path),
                row=int(order[k + 1]) + 1,
                got=f"{displacement[order[k + 1]]:g} mm",
                expected=f"more than {displacement[order[k]]:g} mm (row {int(order[k]) + 1})",
            )
            for k in np.flatnonzero(same & (np.diff(displacement[order]) <= 0))[:_MOST_FAULTS]
        ]
    if faults:
        raise TableError.of(faults)
