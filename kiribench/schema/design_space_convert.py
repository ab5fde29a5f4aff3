"""Design space tables of other programs, converted to stretches.

A table such as one collects from Abaqus has a row a design and load step with the cut lengths,
the displacement, the longitudinal strain and Poisson's ratio. Three things decide what its
numbers mean, and none of them is guessed: the strain measure and the strain's unit must be
declared (in a column's name, in the sidecar or by the caller); the unit of the cut lengths is
taken from the column's name or follows from the numbers, and is then reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.provenance import file_sha256
from kiribench.schema.design_space_columns import Column, cut_unit_of, find_columns, strain_unit_of
from kiribench.schema.design_space_table import TABLE_FILE, table_of, write_design_space
from kiribench.schema.strain_measure import settle_measure
from kiribench.schema.strict_json import short
from kiribench.schema.table_files import read_frame, read_sidecar

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

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
    columns = find_columns(frame, path)
    measure = settle_measure(frame, sidecar, strain_measure, False, path)
    unit = strain_unit_of(columns["strain"], sidecar, strain_unit, path)
    numbers = _numbers(frame, columns, path)
    cut_unit, notes = cut_unit_of(columns, numbers, path)
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


def _numbers(frame: pd.DataFrame, columns: dict[str, Column], path: Path) -> dict[str, FloatArray]:
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


def _check(
    path: Path,
    columns: dict[str, Column],
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
