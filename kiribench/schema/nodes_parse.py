"""From the text fields of a nodes table to a checked :class:`NodesTable`."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault
from kiribench.schema.nodes import (
    BARYCENTRIC_SUM_TOLERANCE,
    DEFAULT_NODE_SD_MM,
    FACE_COLUMNS,
    REQUIRED_COLUMNS,
    NodesTable,
    nodes_schema,
)
from kiribench.schema.strict_json import short
from kiribench.schema.tsv import TsvTable, is_decimal_comma

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_NO_VALUE = frozenset({"", "n/a", "na"})
_NAN = frozenset({"nan", "-nan", "+nan", "inf", "-inf", "+inf", "infinity", "-infinity"})

_REMEDIES = {
    "nodes-coordinate-range": "Give millimetres in the scan's frame; move far-away scans first.",
    "nodes-barycentric": "Give the weights of the face's three corners; they sum to 1.",
    "nodes-index-range": "Count rows and columns from 0, proximal lateral first; describe another "
    "grid under Grid (nodes of worn scans: under Patch) in dataset_description.json.",
    "nodes-face-range": "Count the scan's faces from 0.",
    "nodes-sd": "Give the standard deviation of the node's position in millimetres.",
    "nodes-status": "Write ok, missing or hidden.",
}

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
    faults += _row_faults(table, frame)
    if not any(fault.severity == "error" for fault in faults):
        faults += _completeness(table, frame, shape)
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
            if field.lower() in _NO_VALUE and name not in ("row", "col"):
                continue
            value = float(field) if _NUMBER.match(field) else math.nan
            if math.isfinite(value) and not (integral and value != round(value)):
                values[index] = value
            else:
                faults.append(_number_fault(table, name, index, field, integral))
        columns[name] = values
    if "status" in table.columns:
        columns["status"] = [
            "ok" if field.lower() in _NO_VALUE else field.lower()
            for field in table.column("status")
        ]
    bad = {fault.row for fault in faults if fault.column in ("row", "col")}
    for name in ("row", "col"):  # rows without an index are reported; leave them out below
        columns[name] = np.nan_to_num(columns[name], nan=0.0, posinf=0.0).clip(-(2**31), 2**31)
        columns[name] = columns[name].astype(np.int64)
    frame = pd.DataFrame(columns, index=pd.Index(table.lines, name="line", dtype="int64"))
    return frame.loc[[line not in bad for line in table.lines]], faults


def _number_fault(table: TsvTable, name: str, index: int, field: str, integral: bool) -> Fault:
    line = table.lines[index]
    if field.lower() in _NAN or (_NUMBER.match(field) and not math.isfinite(float(field))):
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
    elif integral and _NUMBER.match(field):
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
                _REMEDIES.get(code, "Correct the value."),
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


def _row_faults(table: TsvTable, frame: pd.DataFrame) -> list[Fault]:
    """What is wrong with a row as a whole: half-given values and duplicates."""
    faults: list[Fault] = []
    xyz = frame[["x_mm", "y_mm", "z_mm"]].to_numpy()
    absent = np.isnan(xyz)
    status = list(frame["status"]) if "status" in frame else ["ok"] * len(frame)
    unreadable = _unreadable_lines(table)
    for index, line in enumerate(frame.index):
        if absent[index].any() and line not in unreadable:
            partial = not absent[index].all()
            if partial or status[index] == "ok":
                faults.append(
                    Fault(
                        "nodes-coordinates-missing",
                        "A node has no complete position.",
                        "Give x_mm, y_mm and z_mm; for a node that was not seen write n/a three "
                        "times and status missing.",
                        file=table.file,
                        row=int(line),
                        column=REQUIRED_COLUMNS[2 + int(np.argmax(absent[index]))],
                        got="n/a",
                        expected="millimetres",
                    )
                )
    if all(name in frame for name in FACE_COLUMNS):
        places = frame[list(FACE_COLUMNS)].to_numpy()
        empty = np.isnan(places)
        for index, line in enumerate(frame.index):
            if line in unreadable:
                continue
            if empty[index].any() and not empty[index].all():
                faults.append(
                    Fault(
                        "nodes-barycentric-half",
                        "The node's place on its face is given by half.",
                        "Give face, b0, b1 and b2, or n/a four times.",
                        file=table.file,
                        row=int(line),
                        column=FACE_COLUMNS[int(np.argmax(empty[index]))],
                    )
                )
            elif not empty[index].any():
                total = float(places[index, 1:].sum())
                if abs(total - 1.0) > BARYCENTRIC_SUM_TOLERANCE:
                    faults.append(
                        Fault(
                            "nodes-barycentric",
                            "The barycentric weights do not sum to 1.",
                            _REMEDIES["nodes-barycentric"],
                            file=table.file,
                            row=int(line),
                            column="b0",
                            got=f"{total:.6g}",
                            expected=f"1 within {BARYCENTRIC_SUM_TOLERANCE:g}",
                        )
                    )
    first: dict[tuple[int, int], int] = {}
    for line, row, col in zip(frame.index, frame["row"], frame["col"], strict=True):
        key = (int(row), int(col))
        if key in first:
            faults.append(
                Fault(
                    "nodes-duplicate",
                    f"Node ({key[0]}, {key[1]}) stands twice; first in row {first[key]}.",
                    "Keep one row a node, or correct its row and col.",
                    file=table.file,
                    row=int(line),
                    column="row",
                )
            )
        first.setdefault(key, int(line))
    return faults


def _unreadable_lines(table: TsvTable) -> frozenset[int]:
    """Lines with a field that is no number: already reported."""
    names = [name for name in (*REQUIRED_COLUMNS, *FACE_COLUMNS) if name in table.columns]
    lines = set()
    for name in names:
        for line, field in zip(table.lines, table.column(name), strict=True):
            if field.lower() not in _NO_VALUE and not (
                _NUMBER.match(field) and math.isfinite(float(field))
            ):
                lines.add(line)
    return frozenset(lines)


def _completeness(table: TsvTable, frame: pd.DataFrame, shape: tuple[int, int]) -> list[Fault]:
    """Nodes that have no row; a wholly absent border line is an error."""
    listed = np.zeros(shape, dtype=bool)
    listed[frame["row"].to_numpy(), frame["col"].to_numpy()] = True
    faults: list[Fault] = []
    borders = {
        "row 0 (proximal)": listed[0],
        f"row {shape[0] - 1} (distal)": listed[-1],
        "col 0 (lateral)": listed[:, 0],
        f"col {shape[1] - 1} (medial)": listed[:, -1],
    }
    for name, line in borders.items():
        if not line.any():
            faults.append(
                Fault(
                    "nodes-edge-missing",
                    f"No node of {name} is listed. A plain grid looks the same after losing a "
                    "border line, so a lost one shifts every index and every cell's result.",
                    "List the line's nodes; if they were not seen, list them with n/a "
                    "coordinates and status missing; if the grid is smaller, say so under Grid.",
                    file=table.file,
                    column="row" if name.startswith("row") else "col",
                    got=f"{int(listed.sum())} nodes listed",
                    expected=f"{shape[0]} x {shape[1]} = {listed.size} nodes",
                )
            )
    absent = np.argwhere(~listed)
    if len(absent) and not faults:
        some = ", ".join(f"({row}, {col})" for row, col in absent[:5].tolist())
        faults.append(
            Fault(
                "nodes-absent",
                f"{len(absent)} nodes have no row and count as missing: {some}"
                + (", ..." if len(absent) > 5 else "")
                + ".",
                "List them with n/a coordinates and status missing, to say that they were looked "
                "for.",
                file=table.file,
                got=f"{int(listed.sum())} rows",
                expected=f"{listed.size}",
                severity="warning",
            )
        )
    if "status" in frame and not (frame["status"] == "ok").any():
        faults.append(
            Fault(
                "nodes-none",
                "Not one node of the table was seen.",
                "Find the nodes on the scan; without them there is nothing to measure.",
                file=table.file,
                column="status",
            )
        )
    return faults


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
