"""Faults of a nodes table's rows as wholes, and of the table as a grid."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from kiribench.errors import Fault
from kiribench.schema.nodes import (
    BARYCENTRIC_SUM_TOLERANCE,
    FACE_COLUMNS,
    NO_VALUE,
    NUMBER,
    REMEDIES,
    REQUIRED_COLUMNS,
)
from kiribench.schema.tsv import TsvTable

if TYPE_CHECKING:
    import pandas as pd


def row_faults(table: TsvTable, frame: pd.DataFrame) -> list[Fault]:
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
                            REMEDIES["nodes-barycentric"],
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
            if field.lower() not in NO_VALUE and not (
                NUMBER.match(field) and math.isfinite(float(field))
            ):
                lines.add(line)
    return frozenset(lines)


def completeness(table: TsvTable, frame: pd.DataFrame, shape: tuple[int, int]) -> list[Fault]:
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
