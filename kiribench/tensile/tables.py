"""The tables of a tensile test on disk: ``cells.tsv`` by cell, ``curve.tsv`` by frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.schema.result_tables import write_table
from kiribench.schema.strict_json import parse_json
from kiribench.schema.tsv import TsvTable, parse_tsv
from kiribench.tensile.result import STATES, TensileTest

FloatArray = NDArray[np.float64]

SCHEMA = "kiribench.tensile_table/1"
CELLS_FILE = "cells.tsv"
CURVE_FILE = "curve.tsv"

CELL_COLUMNS = {
    "frame": "name of the picture",
    "cell": "name of the cell",
    "row": "of the cell in the followed block, along the pull",
    "col": "of the cell in the followed block, across the pull",
    "longitudinal_stretch": "deformed over reference length along the pull",
    "lateral_stretch": "the same across the pull",
    "longitudinal_stretch_sd": "standard deviation by the noise of the pictures",
    "lateral_stretch_sd": "the same across the pull",
    "status": "; ".join(f"{state}: {words}" for state, words in STATES.items()),
}
CURVE_COLUMNS = {
    "frame": "name of the picture",
    "time_s": "of the picture, s",
    "displacement_mm": "of the crosshead, mm",
    "force_n": "of the load cell, N",
    "longitudinal_strain_mean": "over the measured cells, in StrainMeasure",
    "longitudinal_strain_sd": "over the measured cells",
    "lateral_strain_mean": "over the measured cells, in StrainMeasure",
    "lateral_strain_sd": "over the measured cells",
    "poisson_ratio_mean": "of the cells' own ratios, in StrainMeasure",
    "poisson_ratio_sd": "over the measured cells",
    "block_longitudinal_stretch": "of one affine map over everything followed",
    "block_lateral_stretch": "the same across the pull",
    "cells": "number of measured cells",
}


def write_tensile(
    folder: Path, test: TensileTest, *, measure: str = "log", min_strain: float = 0.01
) -> tuple[Path, Path]:
    """Write ``cells.tsv`` and ``curve.tsv``, each with its JSON; the two tables.

    Args:
        folder: made if it is not there.
        test: what was measured.
        measure: of the strains in ``curve.tsv``; the stretches have no measure.
        min_strain: Poisson's ratio is left out below this strain.
    """
    cells = folder / CELLS_FILE
    write_table(
        cells,
        cell_rows(test),
        {
            "Schema": SCHEMA,
            "Columns": CELL_COLUMNS,
            "Marker": test.marker,
            "ScaleMmPerPx": test.scale_mm_per_px,
            "StrainSd": _number(test.strain_sd),
            "Notes": list(test.notes),
            **test.record,
        },
    )
    curve = folder / CURVE_FILE
    write_table(
        curve,
        curve_rows(test, measure, min_strain),
        {
            "Schema": "kiribench.tensile_curve/1",
            "StrainMeasure": measure,
            "MinStrain": min_strain,
            "Columns": CURVE_COLUMNS,
        },
    )
    return cells, curve


def cell_rows(test: TensileTest) -> list[dict[str, Any]]:
    """The rows of ``cells.tsv``."""
    rows = []
    for n, frame in enumerate(test.frame):
        for k, cell in enumerate(test.cell):
            rows.append(
                {
                    "frame": frame,
                    "cell": cell,
                    "row": int(test.row[k]),
                    "col": int(test.col[k]),
                    "longitudinal_stretch": _number(test.longitudinal_stretch[n, k]),
                    "lateral_stretch": _number(test.lateral_stretch[n, k]),
                    "longitudinal_stretch_sd": _number(test.stretch_sd[n, k, 0]),
                    "lateral_stretch_sd": _number(test.stretch_sd[n, k, 1]),
                    "status": str(test.status[n, k]),
                }
            )
    return rows


def curve_rows(test: TensileTest, measure: str, min_strain: float) -> list[dict[str, Any]]:
    """The rows of ``curve.tsv``."""
    curve = test.curve(measure, min_strain)
    return [
        {
            "frame": frame,
            "time_s": _number(test.time_s[n]),
            "displacement_mm": _number(test.displacement_mm[n]),
            "force_n": _number(test.force_n[n]),
            "longitudinal_strain_mean": _number(curve.longitudinal_strain[n]),
            "longitudinal_strain_sd": _number(curve.longitudinal_sd[n]),
            "lateral_strain_mean": _number(curve.lateral_strain[n]),
            "lateral_strain_sd": _number(curve.lateral_sd[n]),
            "poisson_ratio_mean": _number(curve.poisson_ratio[n]),
            "poisson_ratio_sd": _number(curve.poisson_sd[n]),
            "block_longitudinal_stretch": _number(test.block_stretch[n, 0]),
            "block_lateral_stretch": _number(test.block_stretch[n, 1]),
            "cells": int(curve.cells[n]),
        }
        for n, frame in enumerate(test.frame)
    ]


def read_tensile(folder: Path) -> TensileTest:
    """Read what :func:`write_tensile` wrote; the pictures are not needed.

    Where the cells' corners were in the pictures is not in the tables: ``corner_px`` is NaN.

    Raises:
        TableError: a table is missing, or with every fault found in it.
    """
    cells = _table(folder / CELLS_FILE, CELL_COLUMNS)
    curve = _table(folder / CURVE_FILE, CURVE_COLUMNS)
    sidecar = _sidecar((folder / CELLS_FILE).with_suffix(".json"))
    frames = tuple(dict.fromkeys(curve.column("frame")))
    names = tuple(dict.fromkeys(cells.column("cell")))
    shape = (len(frames), len(names))
    if len(frames) != len(curve.rows) or len(cells.rows) != shape[0] * shape[1]:
        raise TableError(
            "tensile-rows",
            "The tables do not hold one row a frame, and one a frame and cell.",
            remedy="Run 'kiribench tensile' again, or restore the tables as it wrote them.",
            file=folder / CELLS_FILE,
            got=f"{len(cells.rows)} rows, {len(curve.rows)} frames",
            expected=f"{shape[0]} x {shape[1]}",
        )
    along, across = np.full(shape, np.nan), np.full(shape, np.nan)
    sd = np.full((*shape, 2), np.nan)
    status = np.full(shape, "lost", dtype="<U16")
    row, col = np.zeros(shape[1], dtype=np.int64), np.zeros(shape[1], dtype=np.int64)
    where = {name: index for index, name in enumerate(frames)}
    which = {name: index for index, name in enumerate(names)}
    columns = {name: cells.columns.index(name) for name in CELL_COLUMNS if name in cells.columns}
    faults: list[Fault] = []
    for line, fields in zip(cells.lines, cells.rows, strict=True):
        read = _Row(cells.file, line, fields, columns, faults)
        n, k = where.get(fields[columns["frame"]]), which[fields[columns["cell"]]]
        if n is None:
            read.fault("frame", "a frame of curve.tsv")
            continue
        row[k], col[k] = read.integer("row"), read.integer("col")
        along[n, k] = read.number("longitudinal_stretch", positive=True)
        across[n, k] = read.number("lateral_stretch", positive=True)
        if "longitudinal_stretch_sd" in columns and "lateral_stretch_sd" in columns:
            sd[n, k] = read.number("longitudinal_stretch_sd"), read.number("lateral_stretch_sd")
        status[n, k] = fields[columns["status"]]
    load = {
        name: np.array(
            [
                _Row(curve.file, line, fields, {name: curve.columns.index(name)}, faults).number(
                    name
                )
                for line, fields in zip(curve.lines, curve.rows, strict=True)
            ]
        )
        for name in ("time_s", "displacement_mm", "force_n")
    }
    block = np.full((shape[0], 2), np.nan)
    for axis, name in enumerate(("block_longitudinal_stretch", "block_lateral_stretch")):
        if name in curve.columns:
            at = {name: curve.columns.index(name)}
            block[:, axis] = [
                _Row(curve.file, line, fields, at, faults).number(name)
                for line, fields in zip(curve.lines, curve.rows, strict=True)
            ]
    if faults:
        raise TableError.of(faults)
    own = ("Schema", "Columns", "Marker", "ScaleMmPerPx", "StrainSd", "Notes")
    floor = sidecar.get("StrainSd")
    return TensileTest(
        frame=frames,
        time_s=load["time_s"],
        displacement_mm=load["displacement_mm"],
        force_n=load["force_n"],
        cell=names,
        row=row,
        col=col,
        longitudinal_stretch=along,
        lateral_stretch=across,
        status=status,
        stretch_sd=sd,
        block_stretch=block,
        corner_px=np.full((shape[0], int(row.max()) + 2, int(col.max()) + 2, 2), np.nan),
        strain_sd=float(floor) if isinstance(floor, (int, float)) else float("nan"),
        scale_mm_per_px=sidecar.get("ScaleMmPerPx"),
        marker=str(sidecar.get("Marker", "")),
        notes=tuple(str(note) for note in sidecar.get("Notes", ())),
        warnings=(),
        record={key: value for key, value in sidecar.items() if key not in own},
        files=(folder / CELLS_FILE, folder / CURVE_FILE),
    )


class _Row:
    """One row of a table, its numbers read with their faults collected."""

    def __init__(
        self,
        file: str,
        line: int,
        fields: tuple[str, ...],
        columns: dict[str, int],
        faults: list[Fault],
    ) -> None:
        self._file, self._line, self._fields = file, line, fields
        self._columns, self._faults = columns, faults

    def fault(self, name: str, expected: str) -> None:
        self._faults.append(
            Fault(
                "tensile-value",
                "A field cannot be used.",
                "Run 'kiribench tensile' again, or correct the table.",
                file=self._file,
                row=self._line,
                column=name,
                got=self._fields[self._columns[name]],
                expected=expected,
            )
        )

    def number(self, name: str, *, positive: bool = False) -> float:
        text = self._fields[self._columns[name]]
        if text.lower() in ("n/a", ""):
            return float("nan")
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value) or (positive and value <= 0):
            self.fault(name, "a positive number or n/a" if positive else "a number or n/a")
            return float("nan")
        return value

    def integer(self, name: str) -> int:
        text = self._fields[self._columns[name]]
        if text.isascii() and text.isdigit():
            return int(text)
        self.fault(name, "0, 1, 2, ...")
        return 0


def _table(path: Path, required: dict[str, str]) -> TsvTable:
    if not path.is_file():
        raise TableError(
            "tensile-table-missing",
            "There is no table of a measured tensile test here.",
            remedy="Make it with 'kiribench tensile FRAMES --out FOLDER', and give FOLDER.",
            file=path,
        )
    table, faults = parse_tsv(path.read_bytes(), file=str(path))
    if table is None or any(fault.severity == "error" for fault in faults):
        raise TableError.of([fault for fault in faults if fault.severity == "error"] or faults)
    optional: tuple[str, ...] = ("longitudinal_stretch_sd", "lateral_stretch_sd")
    optional += ("block_longitudinal_stretch", "block_lateral_stretch")
    optional += tuple(name for name in CURVE_COLUMNS if name.endswith(("_mean", "_sd")))
    missing = [name for name in required if name not in table.columns and name not in optional]
    if missing or not table.rows:
        raise TableError(
            "tensile-columns",
            "The table lacks columns or rows.",
            remedy="Run 'kiribench tensile' again.",
            file=path,
            got=", ".join(table.columns),
            expected=", ".join(missing) or "at least one row",
        )
    return table


def _sidecar(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    content, faults = parse_json(path.read_bytes(), file=str(path))
    if content is None:
        raise TableError.of(faults)
    return content


def _number(value: object) -> float | None:
    number = float(value)  # type: ignore[arg-type]
    return number if np.isfinite(number) else None
