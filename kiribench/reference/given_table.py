"""A table of another solver, or of a measurement, to compare a simulated design with.

Cells: ``row, col, longitudinal_stretch, lateral_stretch`` and, if known, ``shear``. Corners:
``row, col, u_mm, v_mm``, skin coordinates counted from the patch's corner (0, 0) as drawn, with
(R+1) x (C+1) rows. ``n/a`` where there is no number; further columns are passed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.reference.check import CheckedDesign
from kiribench.schema.tsv import TsvTable, parse_tsv
from kiribench.strain.measures import strain_of

FloatArray = NDArray[np.float64]

CELLS = ("longitudinal_stretch", "lateral_stretch")
CORNERS = ("u_mm", "v_mm")


@dataclass(frozen=True, eq=False)
class GivenTable:
    """What was read; NaN where the table has no number.

    Attributes:
        file: the table. kind: ``cells`` or ``corners``.
        longitudinal_stretch, lateral_stretch, shear: (R, C), for ``cells``; shear may be absent.
        corner_mm: (R+1, C+1, 2) from the patch's corner (0, 0), for ``corners``.
    """

    file: Path
    kind: str
    longitudinal_stretch: FloatArray | None = None
    lateral_stretch: FloatArray | None = None
    shear: FloatArray | None = None
    corner_mm: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class TableComparison:
    """Simulated minus given.

    Attributes:
        given: the table. measure: of the strains.
        differences: name -> array: ``longitudinal_strain``, ``lateral_strain``,
            ``poisson_ratio`` and ``shear`` by cell, or ``corner_mm`` (distances) by corner.
        overlap: (R, C) of the given corners, for ``corners`` (graded definition), else None.
    """

    given: GivenTable
    measure: str
    differences: dict[str, FloatArray]
    overlap: FloatArray | None

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Root mean square and largest difference of each quantity, with the count."""
        out: dict[str, dict[str, float | int]] = {}
        for name, values in self.differences.items():
            known = values[np.isfinite(values)]
            if known.size:
                out[name] = {
                    "rms": float(np.sqrt((known**2).mean())),
                    "largest": float(np.abs(known).max()),
                    "mean": float(known.mean()),
                    "count": int(known.size),
                }
        return out


def read_given(path: Path, shape: tuple[int, int]) -> GivenTable:
    """Read a table for a patch of (R, C) cells.

    Raises:
        TableError: ``reference-missing``, ``reference-columns``, ``reference-number``,
            ``reference-cell``, ``reference-empty``, ``reference-stretch``; all faults at once.
    """
    if not path.is_file():
        raise TableError(
            "reference-missing",
            "There is no such table to compare with.",
            remedy="Give 'simulated', 'tensile', or the path of a table.",
            file=path,
        )
    table, faults = parse_tsv(path.read_bytes(), file=str(path))
    if table is None:
        raise TableError.of(faults)
    has = set(table.columns)
    cells = {"row", "col", *CELLS} <= has
    corners = {"row", "col", *CORNERS} <= has
    if not (cells or corners):
        raise TableError(
            "reference-columns",
            "The table has neither the columns of cells nor those of corners.",
            remedy=f"Give row, col, {', '.join(CELLS)} (and shear), or row, col, "
            f"{', '.join(CORNERS)}.",
            file=path,
            got=", ".join(table.columns),
        )
    if cells:
        names = (*CELLS, *(("shear",) if "shear" in has else ()))
        values = _arrays(table, names, shape)
        for name in CELLS:
            if np.nanmin(values[name], initial=np.inf) <= 0:
                raise TableError(
                    "reference-stretch",
                    "A stretch is a length ratio and larger than 0.",
                    remedy="Give stretches (deformed / rest), not strains.",
                    file=path,
                    column=name,
                    got=f"{np.nanmin(values[name]):g}",
                )
        return GivenTable(path, "cells", values[CELLS[0]], values[CELLS[1]], values.get("shear"))
    values = _arrays(table, CORNERS, (shape[0] + 1, shape[1] + 1))
    return GivenTable(
        path, "corners", corner_mm=np.stack([values[name] for name in CORNERS], axis=-1)
    )


def _arrays(
    table: TsvTable, names: tuple[str, ...], shape: tuple[int, int]
) -> dict[str, FloatArray]:
    out = {name: np.full(shape, np.nan) for name in names}
    seen: set[tuple[int, int]] = set()
    faults: list[Fault] = []
    for line, fields in zip(table.lines, table.rows, strict=True):
        row = dict(zip(table.columns, fields, strict=True))
        place = [int(row[key]) if row[key].isdecimal() else -1 for key in ("row", "col")]
        at = (place[0], place[1])
        inside = 0 <= at[0] < shape[0] and 0 <= at[1] < shape[1]
        if not inside or at in seen:
            faults.append(
                Fault(
                    "reference-cell",
                    "The row is outside of the patch, or given twice.",
                    f"Number rows 0 to {shape[0] - 1} from proximal and columns 0 to "
                    f"{shape[1] - 1} from lateral.",
                    file=table.file,
                    row=line,
                    got=f"({row['row']}, {row['col']})",
                )
            )
            continue
        seen.add(at)
        for name in names:
            try:
                value = np.nan if row[name].lower() in ("n/a", "") else float(row[name])
            except ValueError:
                value = np.inf
            if np.isinf(value):
                faults.append(
                    Fault(
                        "reference-number",
                        "A field is no number.",
                        "Write a number, or n/a.",
                        file=table.file,
                        row=line,
                        column=name,
                        got=row[name],
                    )
                )
                value = np.nan
            out[name][at] = value
    if not faults and not any(np.isfinite(values).any() for values in out.values()):
        faults.append(
            Fault(
                "reference-empty",
                "The table holds no number.",
                "Give one row a cell or corner.",
                file=table.file,
            )
        )
    if faults:
        raise TableError.of(faults)
    return out


def compare_table(checked: CheckedDesign, given: GivenTable) -> TableComparison:
    """Simulated minus given, in the design's strain measure."""
    measure = checked.design.strain_measure
    worn = checked.worn
    if given.corner_mm is not None:
        own = worn.corner_q_mm - np.asarray(checked.ground.origin_q_mm)
        score = checked.ground.score(
            given.corner_mm + np.asarray(checked.ground.origin_q_mm),
            checked.design,
            checked.options.score,
        )
        apart = np.linalg.norm(own - given.corner_mm, axis=-1)
        return TableComparison(given, measure, {"corner_mm": apart}, score.overlap)
    if given.longitudinal_stretch is None or given.lateral_stretch is None:
        raise ValueError("a table of cells has stretches")
    along, across = (
        strain_of(one, measure) for one in (given.longitudinal_stretch, given.lateral_stretch)
    )
    differences = {
        "longitudinal_strain": checked.longitudinal_strain - along,
        "lateral_strain": strain_of(worn.lateral_stretch, measure) - across,
    }
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(np.abs(along) >= 0.03, -across / along, np.nan)
    differences["poisson_ratio"] = checked.poisson_ratio - ratio
    if given.shear is not None:
        differences["shear"] = worn.shear - given.shear
    return TableComparison(given, measure, differences, None)


def comparison_object(comparison: TableComparison) -> dict[str, Any]:
    """The JSON object of a comparison."""
    content: dict[str, Any] = {
        "file": comparison.given.file.name,
        "kind": comparison.given.kind,
        "strain_measure": comparison.measure,
        "simulated_minus_given": comparison.summary(),
    }
    if comparison.overlap is not None:
        known = comparison.overlap[np.isfinite(comparison.overlap)]
        content["given_mean_overlap"] = float(known.mean()) if known.size else None
    return content


def comparison_text(comparison: TableComparison) -> str:
    """The same for a person."""
    lines = [f"  Simulated minus {comparison.given.file.name} ({comparison.given.kind}):"]
    for name, one in comparison.summary().items():
        words = name.replace("_", " ").replace("corner mm", "distance of corners, mm")
        lines.append(
            f"    {words:<26} rms {one['rms']:.4f}   largest {one['largest']:.4f}   "
            f"({one['count']})"
        )
    return "\n".join(lines)
