"""From the text fields of a nodes table to a checked :class:`NodesTable`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault
from kiribench.schema.nodes import (
    DEFAULT_NODE_SD_MM,
    FACE_COLUMNS,
    NO_VALUE,
    NUMBER,
    REMEDIES,
    REQUIRED_COLUMNS,
    NodesTable,
    nodes_schema,
)
from kiribench.schema.nodes_rows import completeness, row_faults
from kiribench.schema.strict_json import short
from kiribench.schema.tsv import TsvTable, is_decimal_comma

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_NAN = frozenset({"nan", "-nan", "+nan", "inf", "-inf", "+inf", "infinity", "-infinity"})

_WHAT = {
    "nodes-coordinate-range": "A coordinate is implausibly large.",
    "nodes-barycentric": "A barycentric weight lies outside 0 to 1.",
    "nodes-index-range": "A node lies outside the grid.",
    "nodes-face-range": "A face index is impossible.",
    "nodes-sd": "A standard deviation is impossible.",
    "nodes-status": "A status is not known.",
}


def parse_nodes(
    table: TsvTable,
    path: Path,
    shape: tuple[int, int],
    *,
    node_sd_mm: float | None = None,
) -> tuple[NodesTable | None, tuple[Fault, ...]]:
    """The nodes of a parsed table, or None if it has any error; and all its faults.

    ``shape`` is (node rows, node columns); ``node_sd_mm`` the sidecar's, for tables without
    ``sd_mm``. Codes: ``nodes-column-missing``, ``nodes-columns-half``, ``nodes-number``,
    ``nodes-not-finite``, ``nodes-coordinates-missing``, ``nodes-barycentric-half``, those of
    :func:`nodes_schema`, ``nodes-duplicate``, ``nodes-edge-missing``, ``nodes-absent``
    (warning), ``nodes-none``.
    """
    missing = [name for name in REQUIRED_COLUMNS if name not in table.columns]
    if missing:
        return None, tuple(_missing_column(table, name) for name in missing)
    faults: list[Fault] = []
    given = [name for name in FACE_COLUMNS if name in table.columns]
    if given and len(given) < len(FACE_COLUMNS):
        faults.append(
            Fault(
                "nodes-columns-half",
                "Places on faces are given by half.",
                "Give all of face, b0, b1, b2, or none of them.",
                file=table.file,
                got=", ".join(given),
                expected=", ".join(FACE_COLUMNS),
            )
        )
    if not table.rows:
        faults.append(
            Fault("nodes-none", "The table has no rows.", "List every node.", file=table.file)
        )
        return None, tuple(faults)
    frame, parsing = _numbers(table)
    faults += parsing
    faults += _schema_faults(table, frame, shape)
    faults += row_faults(table, frame)
    if not any(fault.severity == "error" for fault in faults):
        faults += completeness(table, frame, shape)
    if any(fault.severity == "error" for fault in faults):
        return None, tuple(faults)
    return _build(table, path, frame, shape, node_sd_mm), tuple(faults)


def _missing_column(table: TsvTable, name: str) -> Fault:
    bare = name.removesuffix("_mm")
    similar = [
        column
        for column in table.columns
        if column.lower() in {name, bare, "column" if name == "col" else bare}
    ]
    remedy = f"Name the column {name}."
    if name.endswith("_mm"):
        remedy += " Its unit is the millimetre: convert the values if they are in another unit."
    return Fault(
        "nodes-column-missing",
        "A column is missing.",
        remedy,
        file=table.file,
        column=name,
        got=short(", ".join(similar or table.columns), 100)[1:-1],
        expected=", ".join(REQUIRED_COLUMNS),
    )


def _numbers(table: TsvTable) -> tuple[pd.DataFrame, list[Fault]]:
    """The known columns as numbers (NaN where no value), and what is no number."""
    import pandas as pd

    faults: list[Fault] = []
    columns: dict[str, Any] = {}
    for name in (*REQUIRED_COLUMNS, *FACE_COLUMNS, "sd_mm"):
        if name not in table.columns:
            continue
        integral = name in ("row", "col", "face")
        values = np.full(len(table.rows), np.nan)
        for index, field in enumerate(table.column(name)):
            if field.lower() in NO_VALUE and name not in ("row", "col"):
                continue
            value = float(field) if NUMBER.match(field) else math.nan
            if math.isfinite(value) and not (integral and value != round(value)):
                values[index] = value
            else:
                faults.append(_number_fault(table, name, index, field, integral))
        columns[name] = values
    columns["status"] = _status(table)
    bad = {fault.row for fault in faults if fault.column in ("row", "col")}
    for name in ("row", "col"):  # rows without an index are reported; leave them out below
        columns[name] = np.nan_to_num(columns[name], nan=0.0, posinf=0.0).clip(-(2**31), 2**31)
        columns[name] = columns[name].astype(np.int64)
    frame = pd.DataFrame(columns, index=pd.Index(table.lines, name="line", dtype="int64"))
    return frame.loc[[line not in bad for line in table.lines]], faults


def _status(table: TsvTable) -> list[str]:
    """The status of each row; without one, a row of three ``n/a`` is a node not seen."""
    places = [table.column(name) for name in ("x_mm", "y_mm", "z_mm")]
    unseen = [all(f.lower() in NO_VALUE for f in xyz) for xyz in zip(*places, strict=True)]
    stated = table.column("status") if "status" in table.columns else [""] * len(unseen)
    return [
        field.lower() if field.lower() not in NO_VALUE else "missing" if absent else "ok"
        for field, absent in zip(stated, unseen, strict=True)
    ]


def _number_fault(table: TsvTable, name: str, index: int, field: str, integral: bool) -> Fault:
    line = table.lines[index]
    if field.lower() in _NAN or (NUMBER.match(field) and not math.isfinite(float(field))):
        return Fault(
            "nodes-not-finite",
            "A value is not a finite number.",
            "Give a number; for a node that was not seen write n/a and status missing.",
            file=table.file,
            row=line,
            column=name,
            got=short(field),
            expected="a finite number",
        )
    what, remedy = "A value is not a number.", "Give a number with a decimal point."
    if is_decimal_comma(field):
        what = "A number is written with a decimal comma."
        remedy = "Write decimal points."
    elif integral and NUMBER.match(field):
        what, remedy = "An index is not a whole number.", "Give a whole number, counted from 0."
    return Fault(
        "nodes-number",
        what,
        remedy,
        file=table.file,
        row=line,
        column=name,
        got=short(field),
        expected="a whole number" if integral else "a number",
    )


def _schema_faults(table: TsvTable, frame: pd.DataFrame, shape: tuple[int, int]) -> list[Fault]:
    from pandera.errors import SchemaErrors

    try:
        nodes_schema(*shape).validate(frame, lazy=True)
    except SchemaErrors as error:
        cases, codes = error.failure_cases, _case_codes(error)
    else:
        return []
    faults = []
    for column, code, value, line in zip(
        cases["column"], codes, cases["failure_case"], cases["index"], strict=True
    ):
        low_high = {"row": shape[0] - 1, "col": shape[1] - 1}
        faults.append(
            Fault(
                code,
                _WHAT.get(code, "A value is wrong."),
                REMEDIES.get(code, "Correct the value."),
                file=table.file,
                row=int(line),
                column=str(column),
                got=short(value) if isinstance(value, str) else f"{value:g}",
                expected=f"0 to {low_high[column]}" if column in low_high else None,
            )
        )
    return faults


def _case_codes(error: Any) -> list[str]:
    """The name of the check behind each failure case, in the order of the cases."""
    codes: list[str] = []
    for single in error.schema_errors:
        code = str(getattr(single.check, "name", None) or single.check)
        codes += [code] * len(single.failure_cases)
    return codes


def _build(
    table: TsvTable,
    path: Path,
    frame: pd.DataFrame,
    shape: tuple[int, int],
    node_sd_mm: float | None,
) -> NodesTable:
    face: IntArray | None = None
    barycentric: FloatArray | None = None
    if all(name in frame for name in FACE_COLUMNS):
        weights = frame[["b0", "b1", "b2"]].to_numpy(dtype=np.float64).clip(min=0.0)
        barycentric = weights / weights.sum(axis=1, keepdims=True)
        face = np.nan_to_num(frame["face"].to_numpy(dtype=np.float64), nan=-1.0).astype(np.int32)
    fallback = DEFAULT_NODE_SD_MM if node_sd_mm is None else node_sd_mm
    sd = np.full(len(frame), fallback)
    source: Literal["column", "sidecar", "default"] = "default" if node_sd_mm is None else "sidecar"
    if "sd_mm" in frame and not frame["sd_mm"].isna().all():
        given = frame["sd_mm"].to_numpy(dtype=np.float64)
        sd = np.where(np.isnan(given), fallback, given)
        source = "column"
    status = tuple(frame["status"]) if "status" in frame else ("ok",) * len(frame)
    return NodesTable(
        file=path,
        shape=shape,
        row=frame["row"].to_numpy(dtype=np.int32),
        col=frame["col"].to_numpy(dtype=np.int32),
        xyz_mm=frame[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=np.float64).copy(),
        face=face,
        barycentric=barycentric,
        sd_mm=sd,
        sd_source=source,
        status=status,
        line=np.asarray(frame.index, dtype=np.int32),
    )
