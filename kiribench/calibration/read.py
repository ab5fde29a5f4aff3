"""Reading a tension test: a table of text to stretch and nominal stress, checked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.calibration.columns import Column, Kind, find_columns, pick
from kiribench.calibration.curve import Sample, StrainSource, TensileCurve
from kiribench.calibration.sizes import merged_sizes, stated_sizes
from kiribench.calibration.table_text import NumberTable, read_number_table
from kiribench.errors import Fault, TableError
from kiribench.schema.strict_json import short

FloatArray = npt.NDArray[np.float64]

FEWEST_ROWS = 8
"""A test of fewer rows is refused."""
BACKWARD = 0.002
"""Part of the strain range by which the strain may fall (resolution of the readings)."""
LEADING = 0.02
"""Part of the largest strain and stress below zero that leading rows may reach (slack)."""
FAILED = 0.9
"""A fall of the stress below this part of its peak is taken for the failure of the sample."""
PLAUSIBLE_MPA = (1e-3, 1e3)
"""Young's moduli outside of this are no rubber: the unit is probably wrong."""
_AGREE = 0.002
_MOST_FAULTS = 20


def read_curve(
    path: Path,
    *,
    sample: Sample | None = None,
    kind: Kind | None = None,
    strain_unit: Literal["fraction", "percent"] | None = None,
    strain_from: StrainSource | None = None,
) -> TensileCurve:
    """Read one tension test.

    Args:
        path: CSV with a header line, any number of lines before it (``key;value``), separated by
            ``;``, tabs or commas, with decimal points or commas. Columns are found by their
            names, units stand in brackets or in a line of their own: strain and stress
            (engineering or true), or stretch and stress, or displacement and force.
        sample: sizes of the sample where the file does not say them; needed for force.
        kind: of strain and stress where the columns do not say it.
        strain_unit: where the strain's column does not say it.
        strain_from: what the strain was measured by, where the file does not say it.

    Raises:
        TableError: ``curve-...``; see :mod:`kiribench.calibration.table_text` and
            :mod:`kiribench.calibration.columns` for the text, here ``curve-column-missing``,
            ``curve-unit-missing``, ``curve-sample-missing``, ``curve-sample-conflict``,
            ``curve-value``, ``curve-too-short``, ``curve-compressive``,
            ``curve-not-monotonic``, ``curve-kinds-disagree``.
    """
    table, notes = read_number_table(path)
    columns = find_columns(table.columns, path)
    stated = stated_sizes(table.header, path)
    merged = merged_sizes(stated, sample, path)
    strain = pick(columns, "stretch", kind, path) or pick(columns, "strain", kind, path)
    stress = pick(columns, "stress", kind, path)
    travel = None if strain else pick(columns, "displacement", kind, path)
    force = None if stress else pick(columns, "force", kind, path)
    _require(strain, travel, stress, force, merged, table, path)
    used = [column for column in (strain, travel, stress, force) if column is not None]
    numbers = _numbers(table, used, path)
    along = _stretch(strain, travel, numbers, merged, kind, strain_unit, columns, table, path)
    pull = (
        numbers[stress.index] * stress.factor
        if stress
        else (
            numbers[force.index] * force.factor / float(merged.area_mm2 or np.nan)
            if force
            else None
        )
    )
    if pull is None:
        raise AssertionError("a column of stress or force was required above")
    if stress is not None and (stress.kind or kind) == "true":
        pull = pull / along
    curve = TensileCurve(
        along,
        np.asarray(pull),
        strain_from or _source(table, strain, travel),
        merged,
        path,
        tuple(column.name for column in used),
        table.header,
        table.lines,
        notes,
    )
    return checked(curve)


def checked(curve: TensileCurve) -> TensileCurve:
    """The curve from the first pull to failure, or the error that says why it is none.

    Leading rows without pull, rows in which the strain does not grow by its resolution, and rows
    from the failure on are left out with a note.

    Raises:
        TableError: ``curve-compressive``, ``curve-not-monotonic``, ``curve-too-short``.
    """
    file = None if curve.file is None else str(curve.file)
    strain, stress = curve.strain, curve.stress_mpa
    lines = curve.line or tuple(range(1, len(strain) + 1))
    notes = list(curve.notes)
    if len(strain) < FEWEST_ROWS:
        raise _too_short(len(strain), file)
    far, high = float(np.abs(strain).max()), float(np.abs(stress).max())
    below = (strain < -LEADING * far) | (stress < -LEADING * high)
    if below.any() or strain.max() <= 0 or stress.max() <= 0:
        row = int(np.flatnonzero(below)[0]) if below.any() else 0
        raise TableError(
            "curve-compressive",
            "The sample is compressed, or the sign of strain or stress is turned.",
            remedy="Give a test in tension with positive strain and stress; cut off the part "
            "before the pull.",
            file=file,
            row=lines[row],
            got=f"strain {strain[row]:.4g}, stress {stress[row]:.4g} MPa",
        )
    keep = np.ones(len(strain), dtype=bool)
    peak = int(stress.argmax())
    fallen = np.flatnonzero(stress[peak:] < FAILED * stress[peak])
    reach = np.maximum.accumulate(strain)
    back = np.flatnonzero(reach - strain > BACKWARD * far)
    if len(back) and (not len(fallen) or back[0] <= peak + fallen[0]):
        row = int(back[0])
        raise TableError(
            "curve-not-monotonic",
            "The strain falls: the test is unloaded, cyclic, or out of order.",
            remedy="Give one loading branch, in the order of time.",
            file=file,
            row=lines[row],
            got=f"strain {strain[row]:.5g} after {reach[row]:.5g}",
        )
    if len(fallen):
        keep[peak + 1 :] = False
        notes.append(
            _note(
                "curve-failure",
                f"The stress falls after line {lines[peak]}: {len(strain) - peak - 1} rows from "
                "the failure on are left out.",
                file,
            )
        )
    slack = (strain <= 0) | (stress <= 0)
    keep &= ~slack
    if slack.any():
        notes.append(
            _note(
                "curve-slack",
                f"{int(slack.sum())} rows without pull (strain or stress not above 0) are left "
                "out.",
                file,
            )
        )
    before = np.concatenate([[-np.inf], reach[:-1]])
    standing = keep & (strain <= before)
    keep &= ~standing
    if standing.any():
        notes.append(
            _note(
                "curve-standing",
                f"{int(standing.sum())} rows in which the strain does not grow are left out.",
                file,
            )
        )
    if keep.sum() < FEWEST_ROWS:
        raise _too_short(int(keep.sum()), file)
    rows = np.flatnonzero(keep)
    young = stress[rows[:5]].mean() / strain[rows[:5]].mean()
    if not PLAUSIBLE_MPA[0] <= young <= PLAUSIBLE_MPA[1]:
        notes.append(
            _note(
                "curve-implausible",
                f"The initial slope of {young:.3g} MPa is not that of a rubber: check the units "
                "of force, stress and the sample's sizes.",
                file,
            )
        )
    return replace(
        curve,
        stretch=curve.stretch[rows],
        stress_mpa=stress[rows],
        line=tuple(lines[row] for row in rows),
        notes=tuple(notes),
    )


def _too_short(rows: int, file: str | None) -> TableError:
    return TableError(
        "curve-too-short",
        "The tension test has too few rows.",
        remedy="Give a test with more readings.",
        file=file,
        got=rows,
        expected=f"{FEWEST_ROWS} or more",
    )


def _note(code: str, what: str, file: str | None) -> Fault:
    return Fault(code, what, "Look at the rows that are named.", file=file, severity="warning")


def _require(
    strain: Column | None,
    travel: Column | None,
    stress: Column | None,
    force: Column | None,
    sample: Sample,
    table: NumberTable,
    path: Path,
) -> None:
    faults = []
    have = short(", ".join(table.columns), 200)
    if strain is None and travel is None:
        faults.append(
            Fault(
                "curve-column-missing",
                "No column gives the strain.",
                "Name a column 'Engineering strain (%)', 'Stretch' or 'Displacement (mm)'.",
                file=str(path),
                column="strain",
                got=have,
            )
        )
    if stress is None and force is None:
        faults.append(
            Fault(
                "curve-column-missing",
                "No column gives the stress.",
                "Name a column 'Engineering stress (MPa)' or 'Force (N)'.",
                file=str(path),
                column="stress",
                got=have,
            )
        )
    faults += [
        Fault(
            "curve-unit-missing",
            f"The {column.role}'s column has no unit.",
            f"Write it behind the name, such as '{column.name} ({example})'.",
            file=str(path),
            column=short(column.name),
        )
        for column, example in ((travel, "mm"), (stress, "MPa"), (force, "N"))
        if column is not None and not column.unit
    ]
    if travel is not None and sample.length_mm is None:
        faults.append(
            Fault(
                "curve-sample-missing",
                "The strain needs the sample's undeformed length.",
                "Give --length-mm.",
                file=str(path),
            )
        )
    if force is not None and sample.area_mm2 is None:
        faults.append(
            Fault(
                "curve-sample-missing",
                "The stress needs the sample's undeformed cross-section.",
                "Give --width-mm and --thickness-mm.",
                file=str(path),
            )
        )
    if faults:
        raise TableError.of(faults)


def _numbers(table: NumberTable, used: list[Column], path: Path) -> dict[int, FloatArray]:
    faults: list[Fault] = []
    result = {}
    for column in used:
        values = np.full(len(table.rows), np.nan)
        for k, row in enumerate(table.rows):
            try:
                values[k] = float(row[column.index])
            except ValueError:
                values[k] = np.nan
            if not np.isfinite(values[k]):
                faults.append(
                    Fault(
                        "curve-value",
                        "The field is no number.",
                        "Correct it, or delete the row.",
                        file=str(path),
                        row=table.lines[k],
                        column=short(column.name),
                        got=short(row[column.index]),
                    )
                )
        result[column.index] = values
    if faults:
        raise TableError.of(faults[:_MOST_FAULTS])
    return result


def _stretch(
    strain: Column | None,
    travel: Column | None,
    numbers: dict[int, FloatArray],
    sample: Sample,
    kind: Kind | None,
    strain_unit: str | None,
    columns: tuple[Column, ...],
    table: NumberTable,
    path: Path,
) -> FloatArray:
    if strain is None:
        if travel is None or sample.length_mm is None:
            raise AssertionError("displacement and length were required before")
        return np.asarray(1 + numbers[travel.index] * travel.factor / sample.length_mm)
    values = numbers[strain.index]
    if strain.role == "stretch":
        return values
    if strain.unit:
        factor = strain.factor
    elif strain_unit is not None:
        factor = 0.01 if strain_unit == "percent" else 1.0
    else:
        factor = _unit_by_pair(strain, columns, table, path)
    is_true = (strain.kind or kind) == "true"
    return np.exp(values * factor) if is_true else np.asarray(1 + values * factor)


def _unit_by_pair(
    strain: Column, columns: tuple[Column, ...], table: NumberTable, path: Path
) -> float:
    """The unit of an engineering strain that has the true strain beside it: only one fits."""
    other = [column for column in columns if column.role == "strain" and column.kind == "true"]
    if strain.kind != "engineering" or len(other) != 1:
        raise TableError(
            "curve-unit-missing",
            "The table does not say whether its strain is a fraction or percent: 0.5 is half the "
            "length or half a percent.",
            remedy="Name the column 'Engineering strain (%)' or '(mm/mm)', or give --strain-unit.",
            file=path,
            column=short(strain.name),
        )
    numbers = _numbers(table, [strain, other[0]], path)
    engineering, true = numbers[strain.index], numbers[other[0].index]
    for factor in (1.0, 0.01):
        if (engineering * factor <= -1).any():
            continue
        error = np.abs(np.log1p(engineering * factor) - true * factor)
        if error.max() <= _AGREE * max(1e-3, float(np.abs(true * factor).max())):
            return factor
    raise TableError(
        "curve-kinds-disagree",
        "The true strain is not the logarithm of one plus the engineering strain.",
        remedy="Find out which column is right, and delete the other; or give --strain-unit.",
        file=path,
        column=short(f"{strain.name}, {other[0].name}"),
    )


def _source(table: NumberTable, strain: Column | None, travel: Column | None) -> StrainSource:
    words = " ".join(f"{key} {value}" for key, value in table.header).lower()
    if travel is not None:
        return "crosshead"
    name = "" if strain is None else strain.name.lower()
    for text in (name, words):
        if "extensometer" in text:
            return "extensometer"
        if "camera" in text or "video" in text:
            return "camera"
        if "crosshead" in text or "(extension)" in text:
            return "crosshead"
    return "unknown"
