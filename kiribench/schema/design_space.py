"""The design space table: one row a design and load step, (a, b, strain) to Poisson's ratio.

Two forms are read, as CSV, TSV or Parquet:

- stretches (``kiribench simulate``): ``a_percent``, ``b_percent``, ``longitudinal_stretch``,
  ``lateral_stretch``; strains and Poisson's ratio follow in the measure that is asked for;
- strains: ``a_percent``, ``b_percent``, ``longitudinal_strain``, ``poisson_ratio``, with the
  measure declared in the JSON sidecar of the same stem (``{"StrainMeasure": "log"}``), in a
  column ``strain_measure``, or by the caller.

Further columns that are used where they are there: ``design``, ``status`` (rows that are not
``ok`` are dropped and counted), ``mesh_error_poisson``, ``nominal_stress_mpa``. Others are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.schema.strain_measure import (
    DEFAULT_MEASURE,
    MEASURES,
    check_measure,
    settle_measure,
    strain_of_stretch,
)
from kiribench.schema.strict_json import short
from kiribench.schema.table_files import read_frame, read_sidecar

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

__all__ = [
    "DEFAULT_MEASURE",
    "MEASURES",
    "DesignSpace",
    "read_design_space",
    "read_frame",
    "read_points",
    "read_sidecar",
    "settle_measure",
    "strain_of_stretch",
]

LEAST_STRAIN = 1e-9  # below it Poisson's ratio is 0 / 0
_MOST_FAULTS = 20


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """A design space, checked.

    Attributes:
        file: where it was read from.
        a_percent, b_percent: (n,) cut lengths, percent of the cell.
        longitudinal_strain: (n,) fraction, in ``measure``.
        poisson_ratio: (n,) minus lateral over longitudinal strain, both in ``measure``.
        design: (n,) number of each row's design, 0 to p - 1.
        design_names: (p,) the designs' names in the table, or ``a-b`` where it has none.
        measure: ``log``, ``engineering`` or ``green``.
        mesh_error_poisson: (n,) the simulation's own error of Poisson's ratio, or ``None``.
        longitudinal_stretch, lateral_stretch: (n,), or ``None`` in a table of strains.
        nominal_stress_mpa: (n,) pulling force / undeformed section, NaN where it is no number,
            or ``None`` in a table without it.
        table_row: (n,) 1-based data row of the file.
        dropped: rows left out, by reason.
        sidecar: the JSON sidecar's content, empty where there is none.
    """

    file: Path
    a_percent: FloatArray
    b_percent: FloatArray
    longitudinal_strain: FloatArray
    poisson_ratio: FloatArray
    design: NDArray[np.int64]
    design_names: tuple[str, ...]
    measure: str
    mesh_error_poisson: FloatArray | None = None
    longitudinal_stretch: FloatArray | None = None
    lateral_stretch: FloatArray | None = None
    nominal_stress_mpa: FloatArray | None = None
    table_row: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    dropped: dict[str, int] = field(default_factory=dict)
    sidecar: dict[str, Any] = field(default_factory=dict)

    @property
    def inputs(self) -> FloatArray:
        """(n, 3): a_percent, b_percent, longitudinal_strain; what the surrogates take."""
        return np.column_stack([self.a_percent, self.b_percent, self.longitudinal_strain])

    @property
    def files(self) -> tuple[Path, ...]:
        """The table and its sidecar, for the provenance."""
        sidecar = self.file.with_suffix(".json")
        return (self.file, sidecar) if self.sidecar else (self.file,)


def read_design_space(path: Path, *, measure: str | None = None) -> DesignSpace:
    """Read and check a design space table.

    Args:
        path: CSV, TSV or Parquet.
        measure: ``log``, ``engineering`` or ``green``. For a table of stretches the measure
            to compute (log by default); for a table of strains the measure that its numbers
            are in, where the table does not say so itself.

    Raises:
        TableError: the file cannot be read, or with every fault found: columns that are
            missing, values that are no numbers or out of range, a strain measure that is
            not declared, unknown, mixed or contradicted, designs whose rows disagree.
    """
    frame = read_frame(path)
    sidecar = read_sidecar(path)
    stretches = {"longitudinal_stretch", "lateral_stretch"} <= set(frame.columns)
    wanted = ["a_percent", "b_percent"] + (
        ["longitudinal_stretch", "lateral_stretch"]
        if stretches
        else ["longitudinal_strain", "poisson_ratio"]
    )
    _check_columns(frame, wanted, path)
    settled = settle_measure(frame, sidecar, measure, stretches, path)
    table_row = np.arange(1, len(frame) + 1)
    dropped: dict[str, int] = {}
    if "status" in frame.columns:
        status = frame["status"].astype(str).to_numpy()
        for reason in sorted(set(status) - {"ok"}):
            dropped[reason] = int(np.sum(status == reason))
        frame, table_row = frame[status == "ok"], table_row[status == "ok"]
    numbers = _numbers(frame, wanted, table_row, path)
    if stretches:
        strain = strain_of_stretch(numbers["longitudinal_stretch"], settled)
        lateral = strain_of_stretch(numbers["lateral_stretch"], settled)
    else:
        strain = numbers["longitudinal_strain"]
    some = np.abs(strain) > LEAST_STRAIN
    if not some.all():
        dropped["zero-strain"] = int(np.sum(~some))
    if not some.any():
        raise TableError(
            "design-space-empty",
            "No row is left.",
            remedy="Give at least one row with status ok and a strain that is not zero.",
            file=path,
            got=f"{len(table_row)} rows, dropped: {dropped}",
        )
    design, names = _designs(frame, numbers, table_row, path)
    poisson = -lateral[some] / strain[some] if stretches else numbers["poisson_ratio"][some]
    error = None
    if "mesh_error_poisson" in frame.columns:
        error = _numbers(frame, ["mesh_error_poisson"], table_row, path, missing_ok=True)
    stress = None
    if "nominal_stress_mpa" in frame.columns:
        stress = _numbers(frame, ["nominal_stress_mpa"], table_row, path, missing_ok=True)
    used, number = np.unique(design[some], return_inverse=True)
    return DesignSpace(
        file=path,
        a_percent=numbers["a_percent"][some],
        b_percent=numbers["b_percent"][some],
        longitudinal_strain=strain[some],
        poisson_ratio=np.asarray(poisson),
        design=number.ravel().astype(np.int64),
        design_names=tuple(names[index] for index in used),
        measure=settled,
        mesh_error_poisson=None if error is None else error["mesh_error_poisson"][some],
        longitudinal_stretch=numbers["longitudinal_stretch"][some] if stretches else None,
        lateral_stretch=numbers["lateral_stretch"][some] if stretches else None,
        nominal_stress_mpa=None if stress is None else stress["nominal_stress_mpa"][some],
        table_row=table_row[some],
        dropped=dropped,
        sidecar=sidecar,
    )


def _check_columns(frame: pd.DataFrame, wanted: list[str], path: Path) -> None:
    absent = [name for name in wanted if name not in frame.columns]
    if absent:
        raise TableError.of(
            Fault(
                "column-missing",
                f"The column {name} is missing.",
                "Give a_percent, b_percent and either longitudinal_stretch with lateral_stretch "
                "or longitudinal_strain with poisson_ratio.",
                file=str(path),
                column=name,
                got=short(", ".join(map(str, frame.columns)), 200),
            )
            for name in absent
        )


def _numbers(
    frame: pd.DataFrame,
    names: list[str],
    table_row: NDArray[np.int64],
    path: Path,
    *,
    missing_ok: bool = False,
) -> dict[str, FloatArray]:
    import pandas as pd

    faults: list[Fault] = []
    result: dict[str, FloatArray] = {}
    for name in names:
        values = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
        result[name] = values
        if missing_ok:
            continue
        low, high = _RANGES[name]
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.isfinite(values) & (values >= low) & (values <= high)))
        for index in bad[:_MOST_FAULTS]:
            faults.append(
                Fault(
                    "value-out-of-range" if np.isfinite(values[index]) else "value-no-number",
                    "The value is not admissible.",
                    "Correct it, or leave the row out.",
                    file=str(path),
                    row=int(table_row[index]),
                    column=name,
                    got=short(str(frame[name].iloc[index])),
                    expected=f"a number from {low:g} to {high:g}",
                )
            )
    faults += _fractions(result, path)
    if faults:
        raise TableError.of(faults[:_MOST_FAULTS])
    return result


_RANGES = {
    "a_percent": (0.0, 100.0),
    "b_percent": (0.0, 100.0),
    "longitudinal_stretch": (0.05, 20.0),
    "lateral_stretch": (0.05, 20.0),
    "longitudinal_strain": (-0.95, 200.0),
    "poisson_ratio": (-10.0, 10.0),
    "mesh_error_poisson": (-np.inf, np.inf),
}


def _fractions(numbers: dict[str, FloatArray], path: Path) -> list[Fault]:
    both = [numbers[name] for name in ("a_percent", "b_percent") if name in numbers]
    if len(both) < 2 or max(np.nanmax(x, initial=0.0) for x in both) > 1.0:
        return []
    if len(np.unique(both[0])) < 3:
        return []
    return [
        Fault(
            "cut-lengths-are-fractions",
            "No cut is longer than 1 percent of the cell: these look like fractions.",
            "Multiply a_percent and b_percent by 100.",
            file=str(path),
            column="a_percent",
            got=f"at most {max(x.max() for x in both):g}",
            expected="percent, 0 to 100",
        )
    ]


def _designs(
    frame: pd.DataFrame,
    numbers: dict[str, FloatArray],
    table_row: NDArray[np.int64],
    path: Path,
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    cuts = np.column_stack([numbers["a_percent"], numbers["b_percent"]])
    if "design" not in frame.columns:
        unique, number = np.unique(cuts, axis=0, return_inverse=True)
        names = tuple(f"{a:g}-{b:g}" for a, b in unique)
        return number.ravel().astype(np.int64), names
    labels, number = np.unique(frame["design"].astype(str).to_numpy(), return_inverse=True)
    number = number.ravel().astype(np.int64)
    first = np.zeros(len(labels), dtype=np.int64)
    first[number[::-1]] = np.arange(len(number))[::-1]
    differs = np.flatnonzero((cuts != cuts[first[number]]).any(axis=1))
    if len(differs):
        raise TableError.of(
            Fault(
                "design-not-one",
                "Rows of one design have different cut lengths.",
                "Give each pair (a, b) a design name of its own, or leave the column out.",
                file=str(path),
                row=int(table_row[index]),
                column="design",
                got=f"a, b = {cuts[index, 0]:g}, {cuts[index, 1]:g}",
                expected="{:g}, {:g}".format(*cuts[first[number[index]]]),
            )
            for index in differs[:_MOST_FAULTS]
        )
    return number, tuple(str(label) for label in labels)


def read_points(path: Path) -> tuple[FloatArray, str | None]:
    """Points to predict at: (n, 3) a_percent, b_percent, strain; and their declared measure.

    Raises:
        TableError: as :func:`read_design_space`.
    """
    wanted = ["a_percent", "b_percent", "longitudinal_strain"]
    frame = read_frame(path)
    sidecar = read_sidecar(path)
    _check_columns(frame, wanted, path)
    numbers = _numbers(frame, wanted, np.arange(1, len(frame) + 1), path)
    measure = sidecar.get("StrainMeasure")
    if "strain_measure" in frame.columns:
        measure = settle_measure(frame, sidecar, None, False, path)
    if measure is not None:
        check_measure(str(measure), path, "the sidecar")
    return np.column_stack([numbers[name] for name in wanted]), measure
