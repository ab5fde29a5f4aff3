"""The design table of a patch: one row a cell, what it was asked for and how it is cut.

`design` writes it, `export` cuts it, `check` judges it: ``sub-ID_design.tsv`` with a JSON sidecar
of the same stem. Columns: ``row, col, region, a_percent, b_percent,
target_longitudinal_strain, target_poisson_ratio, predicted_poisson_ratio,
predicted_poisson_ratio_sd, reachable_low, reachable_high, distance, reason``; ``n/a`` where there
is no number. Only ``row, col, a_percent, b_percent`` are required: a cut map drawn by hand, or by
another program, is a design too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.schema.result_tables import write_table
from kiribench.schema.strict_json import parse_json
from kiribench.schema.tsv import TsvTable, parse_tsv

FloatArray = NDArray[np.float64]

SCHEMA = "kiribench.patch_design/1"

#: Quantities of a cell that may be absent, with the unit that the sidecar states.
QUANTITIES = {
    "target_longitudinal_strain": "fraction, in StrainMeasure",
    "target_poisson_ratio": "minus lateral over longitudinal strain, in StrainMeasure",
    "predicted_poisson_ratio": "of the chosen cuts at the target strain, by the surrogate",
    "predicted_poisson_ratio_sd": "the surrogate's standard deviation",
    "reachable_low": "smallest Poisson's ratio of any allowed cuts at the target strain",
    "reachable_high": "largest Poisson's ratio of any allowed cuts at the target strain",
    "distance": "of the target Poisson's ratio to the reachable range; 0 inside of it",
    "error": "predicted minus target Poisson's ratio",
    "cutting_error": "standard deviation of Poisson's ratio by errors of cut lengths and kerf",
    "nominal_stress_mpa": "pulling force at the target strain / undeformed section, MPa",
}


@dataclass(frozen=True, eq=False)
class PatchDesign:
    """The cuts of a patch; arrays are (R, C), row 0 proximal, column 0 lateral.

    Attributes:
        participant: id of the subject, without ``sub-``; empty where there is none.
        method: how it was designed, such as ``exact``; ``given`` for a table from elsewhere.
        side: of the body: ``left``, ``right`` or empty.
        cell_mm: cell edge, mm.
        thickness_mm: of the sheet, mm.
        strain_measure: of every strain and Poisson's ratio here.
        a, b: cut lengths / cell edge, in [0, 1).
        region: label of the cell's region, such as ``LS``; empty where there is none.
        reason: why the cell misses its target, as a code; empty where it does not.
        quantities: name of :data:`QUANTITIES` -> (R, C), NaN where there is no number.
        settings: what else the sidecar holds (method settings, limits, provenance).
        file: where it was read from, None where it was computed.
    """

    participant: str
    method: str
    side: str
    cell_mm: float
    thickness_mm: float
    strain_measure: str
    a: FloatArray
    b: FloatArray
    region: NDArray[np.str_]
    reason: NDArray[np.str_]
    quantities: dict[str, FloatArray] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    file: Path | None = None

    def __post_init__(self) -> None:
        unknown = set(self.quantities) - set(QUANTITIES)
        if unknown:
            raise ValueError(f"unknown quantities of a design: {sorted(unknown)}")
        shapes = {array.shape for array in (self.a, self.b, self.region, self.reason)}
        shapes |= {array.shape for array in self.quantities.values()}
        if len(shapes) != 1 or len(self.a.shape) != 2:
            raise ValueError(f"arrays of a design with unequal shapes: {sorted(shapes)}")

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C) cells down and across."""
        rows, columns = self.a.shape
        return int(rows), int(columns)

    def quantity(self, name: str) -> FloatArray:
        """(R, C) of one of :data:`QUANTITIES`; NaN everywhere where the design has none."""
        return self.quantities.get(name, np.full(self.shape, np.nan))


def design_stem(design: PatchDesign) -> str:
    """``sub-ID_design``, or ``design`` where there is no participant."""
    return f"sub-{design.participant}_design" if design.participant else "design"


def write_design(folder: Path, design: PatchDesign) -> Path:
    """Write ``folder/<stem>.tsv`` and ``.json``; the path of the table."""
    rows = []
    for r, c in np.ndindex(design.shape):
        row: dict[str, Any] = {
            "row": r,
            "col": c,
            "region": str(design.region[r, c]) or None,
            "a_percent": 100 * float(design.a[r, c]),
            "b_percent": 100 * float(design.b[r, c]),
        }
        for name in QUANTITIES:
            value = float(design.quantity(name)[r, c])
            row[name] = value if np.isfinite(value) else None
        row["reason"] = str(design.reason[r, c]) or None
        rows.append(row)
    path = folder / f"{design_stem(design)}.tsv"
    write_table(path, rows, design_sidecar(design))
    return path


def design_sidecar(design: PatchDesign) -> dict[str, Any]:
    """The JSON sidecar of a design table."""
    return {
        "Schema": SCHEMA,
        "Participant": design.participant,
        "Method": design.method,
        "Side": design.side,
        "CellMm": design.cell_mm,
        "ThicknessMm": design.thickness_mm,
        "StrainMeasure": design.strain_measure,
        "Columns": {
            "row": "0 is proximal",
            "col": "0 is lateral",
            "region": "label of the region",
            "a_percent": "length of the cuts across the pull, percent of the cell edge",
            "b_percent": "length of the cuts along the pull, percent of the cell edge",
            **QUANTITIES,
            "reason": "why the cell misses its target, as a code",
        },
        **design.settings,
    }


_OWN_KEYS = {
    "Schema",
    "Participant",
    "Method",
    "Side",
    "CellMm",
    "ThicknessMm",
    "StrainMeasure",
    "Columns",
}


def read_design(path: Path, *, cell_mm: float | None = None) -> PatchDesign:
    """Read and check a design table with its sidecar.

    Args:
        path: the ``.tsv``, or a folder with exactly one ``*_design.tsv`` or ``design.tsv`` below.
        cell_mm: cell edge of a table without a sidecar.

    Raises:
        TableError: no such file, or with every fault found: missing columns, cells that are
            missing or doubled, cut lengths that are no numbers or not within 0 <= length < 100,
            no cell size.
    """
    path = _table_of(path)
    table, faults = parse_tsv(path.read_bytes(), file=str(path))
    if table is None:
        raise TableError.of(faults)
    if not table.rows:
        raise TableError(
            "table-empty", "The table has no rows.", remedy="Add one row a cell.", file=path
        )
    missing = [
        name for name in ("row", "col", "a_percent", "b_percent") if name not in table.columns
    ]
    if missing:
        raise TableError(
            "design-columns",
            "The design table lacks columns.",
            remedy="Give row, col, a_percent and b_percent for every cell.",
            file=path,
            got=", ".join(table.columns),
            expected=", ".join(missing),
        )
    sidecar = _sidecar(path)
    cell = sidecar.get("CellMm", cell_mm)
    if isinstance(cell, bool) or not isinstance(cell, (int, float)) or not 0 < cell < 1e4:
        raise TableError(
            "design-cell-size",
            "The cell edge of the design is not known.",
            remedy='Put {"CellMm": 15} into the JSON of the same stem.',
            file=path.with_suffix(".json"),
            got=cell,
        )
    numbers, cells = _numbers(table, path)
    shape = (1 + max(r for r, _ in cells), 1 + max(c for _, c in cells))
    arrays = {name: np.full(shape, np.nan) for name in numbers}
    words = {name: np.full(shape, "", dtype="<U64") for name in ("region", "reason")}
    for index, cell_at in enumerate(cells):
        for name, values in numbers.items():
            arrays[name][cell_at] = values[index]
        for name in words:
            if name in table.columns:
                text = table.rows[index][table.columns.index(name)]
                words[name][cell_at] = "" if text.lower() in ("n/a", "") else text
    return PatchDesign(
        participant=str(sidecar.get("Participant", "")),
        method=str(sidecar.get("Method", "given")),
        side=str(sidecar.get("Side", "")),
        cell_mm=float(cell),
        thickness_mm=float(sidecar.get("ThicknessMm", 2.0)),
        strain_measure=str(sidecar.get("StrainMeasure", "log")),
        a=arrays.pop("a_percent") / 100,
        b=arrays.pop("b_percent") / 100,
        region=words["region"],
        reason=words["reason"],
        quantities=arrays,
        settings={key: value for key, value in sidecar.items() if key not in _OWN_KEYS},
        file=path,
    )


def _table_of(path: Path) -> Path:
    """The table itself, looked for where a folder was given."""
    if path.is_dir():
        found = sorted({*path.rglob("*_design.tsv"), *path.rglob("design.tsv")})
        if len(found) != 1:
            raise TableError(
                "design-missing" if not found else "design-ambiguous",
                "The folder does not hold exactly one design table.",
                remedy="Give the path of a ..._design.tsv, as 'kiribench design' writes it.",
                file=path,
                got=", ".join(str(one.relative_to(path)) for one in found[:6]) or "none",
            )
        return found[0]
    if not path.is_file():
        raise TableError(
            "design-missing",
            "There is no such design table.",
            remedy="Make one with 'kiribench design', or check the path.",
            file=path,
        )
    return path


def _sidecar(path: Path) -> dict[str, Any]:
    beside = path.with_suffix(".json")
    if not beside.is_file():
        return {}
    content, faults = parse_json(beside.read_bytes(), file=str(beside))
    if faults and content is None:
        raise TableError.of(faults)
    if not isinstance(content, dict):
        raise TableError(
            "design-sidecar",
            "The sidecar of the design is no JSON object.",
            remedy='Write one, such as {"CellMm": 15}, or remove the file.',
            file=beside,
        )
    return content


def _numbers(table: TsvTable, path: Path) -> tuple[dict[str, list[float]], list[tuple[int, int]]]:
    """Columns of numbers and the cell of each row; all faults at once."""
    names = ["a_percent", "b_percent", *(name for name in QUANTITIES if name in table.columns)]
    faults: list[Fault] = []
    numbers: dict[str, list[float]] = {name: [] for name in names}
    cells: list[tuple[int, int]] = []

    def fault(code: str, what: str, remedy: str, line: int, column: str, got: object) -> None:
        faults.append(
            Fault(code, what, remedy, file=str(path), row=line, column=column, got=str(got))
        )

    for line, fields in zip(table.lines, table.rows, strict=True):
        row = dict(zip(table.columns, fields, strict=True))
        place = []
        for name in ("row", "col"):
            if not row[name].isdecimal() or int(row[name]) > 10_000:
                fault(
                    "design-cell",
                    "A cell's place is no whole number from 0.",
                    "Number rows from proximal and columns from lateral, from 0.",
                    line,
                    name,
                    row[name],
                )
                place.append(0)
            else:
                place.append(int(row[name]))
        cells.append((place[0], place[1]))
        for name in names:
            value = _number(row[name])
            cut = name in ("a_percent", "b_percent")
            if value is None or (cut and not 0 <= value < 100):
                fault(
                    "design-cut-length" if cut else "design-number",
                    "A cut length is out of range." if cut else "A field is no number.",
                    "Give percent of the cell edge, 0 <= length < 100."
                    if cut
                    else "Write a number, or n/a.",
                    line,
                    name,
                    row[name],
                )
                value = np.nan
            numbers[name].append(value)
    if not faults:
        faults += _incomplete(cells, table, path)
    if faults:
        raise TableError.of(faults)
    return numbers, cells


def _number(text: str) -> float | None:
    if text.lower() in ("n/a", ""):
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) else None


def _incomplete(cells: list[tuple[int, int]], table: TsvTable, path: Path) -> list[Fault]:
    """Cells that are given twice or not at all."""
    faults = []
    seen: set[tuple[int, int]] = set()
    for line, cell in zip(table.lines, cells, strict=True):
        if cell in seen:
            faults.append(
                Fault(
                    "design-cell-twice",
                    f"Cell (row {cell[0]}, column {cell[1]}) is given twice.",
                    "Keep one row a cell.",
                    file=str(path),
                    row=line,
                )
            )
        seen.add(cell)
    rows, columns = 1 + max(r for r, _ in cells), 1 + max(c for _, c in cells)
    absent = sorted(set(np.ndindex(rows, columns)) - seen)
    if absent:
        first = absent[0]
        faults.append(
            Fault(
                "design-cell-missing",
                f"{len(absent)} cells of {rows} x {columns} have no row; the first is "
                f"(row {first[0]}, column {first[1]}).",
                "Give one row for every cell of the patch.",
                file=str(path),
            )
        )
    return faults
