"""Tables of targets: what ``kiribench measure`` writes, or one row a cell of any origin.

Columns: ``row``, ``col`` (from 0; row 0 proximal, column 0 lateral) and

- ``longitudinal_strain`` with ``poisson_ratio`` or ``lateral_strain``, their measure named in a
  column ``strain_measure``, in the sidecar (``{"StrainMeasure": "log"}``) or by the caller; or
- ``longitudinal_stretch`` with ``lateral_stretch``: length ratios, which have no measure.

Optional: ``region``, ``reason``, ``poisson_reason``. The sidecar may hold ``CellMm``,
``ThicknessMm``, ``Participant``, ``Side`` and the layout's ``Grid``, ``Patch`` and ``Regions``:
where it names a ``Grid``, the rows are the drawn grid's, and the patch lies on a part of it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from kiribench.errors import Fault, TableError
from kiribench.schema.design_space import DEFAULT_MEASURE, read_frame, read_sidecar, settle_measure
from kiribench.schema.layout import Layout, LayoutMetadata
from kiribench.schema.strict_json import short
from kiribench.strain.measures import strain_of

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

CELL_MM = 15.0
"""Cell edge where nobody says it: the paper's."""

THICKNESS_MM = 2.0
"""Thickness of the sheet where nobody says it: the paper's."""

_MOST_FAULTS = 20
_MOST_CELLS = 10_000
_MOST_IN_ALL = 100_000
_SIDES = ("left", "right", "none", "")
_STRAINS = ("longitudinal_strain", "poisson_ratio", "lateral_strain")
_STRETCHES = ("longitudinal_stretch", "lateral_stretch")
_RANGES = {
    "longitudinal_strain": (-0.95, 5.0),
    "lateral_strain": (-0.95, 5.0),
    "poisson_ratio": (-20.0, 20.0),
    "longitudinal_stretch": (0.05, 10.0),
    "lateral_stretch": (0.05, 10.0),
}
_GRID_ONLY = {"gradient_longitudinal_stretch", "longitudinal_stretch_sd"}


@dataclass(frozen=True, eq=False)
class TargetTable:
    """A table of targets, checked; arrays are (R, C) over the rows and columns that it names.

    Attributes:
        longitudinal_strain, poisson_ratio: NaN where there is none, in ``strain_measure``.
        longitudinal_stretch, lateral_stretch: NaN where they are not known.
        reason: why there is no target; empty where there is one.
        region: labels, or None.
        layout: of the drawn grid whose cells the rows are; None where they are the patch's.
        notes: what was assumed.
        has_strain: whether the table gave strains and not stretches alone.
    """

    participant: str
    side: str
    cell_mm: float
    thickness_mm: float
    strain_measure: str
    longitudinal_strain: FloatArray
    poisson_ratio: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    reason: NDArray[np.str_]
    region: NDArray[np.str_] | None
    layout: Layout | None
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    has_strain: bool


def read_targets(
    path: Path, *, strain_measure: str | None = None, cell_mm: float | None = None
) -> TargetTable:
    """Read and check a table of targets.

    Args:
        path: TSV, CSV or Parquet.
        strain_measure: the measure of its strains where it does not say so itself; for a table
            of stretches alone the measure to compute.
        cell_mm: cell edge where the sidecar does not say it.

    Raises:
        TableError: with every fault found: columns that are missing, numbers that are none or
            out of range (percent for fractions), cells given twice or numbered from 1, a strain
            measure that is missing, unknown, mixed or contradicted, a layout that is wrong.
    """
    frame = read_frame(path)
    sidecar = read_sidecar(path)
    measurement = sidecar.get("Measurement")
    measurement = measurement if isinstance(measurement, dict) else {}
    if "StrainMeasure" not in sidecar and "strain_measure" in measurement:
        sidecar = sidecar | {"StrainMeasure": measurement["strain_measure"]}
    strains = "longitudinal_strain" in frame.columns and (
        "poisson_ratio" in frame.columns or "lateral_strain" in frame.columns
    )
    stretches = set(_STRETCHES) <= set(frame.columns)
    _check_columns(frame, strains or stretches, path)
    measure = settle_measure(frame, sidecar, strain_measure, not strains, path)
    names = [name for name in (*_STRAINS, *_STRETCHES) if name in frame.columns]
    numbers, cells = _numbers(frame, names, path)
    shape = (1 + max(r for r, _ in cells), 1 + max(c for _, c in cells))
    if shape[0] * shape[1] > _MOST_IN_ALL:
        raise TableError(
            "targets-too-many",
            "The rows and columns that the table names span more cells than any patch has.",
            remedy="Look for a wrong number in row or col.",
            file=path,
            got=f"{shape[0]} x {shape[1]} cells, {len(cells)} of them given",
            expected=f"at most {_MOST_IN_ALL} cells",
        )
    arrays = {name: np.full(shape, np.nan) for name in (*_STRAINS, *_STRETCHES)}
    given = np.zeros(shape, dtype=bool)
    at = tuple(np.array(cells).T)
    given[at] = True
    for name in names:
        arrays[name][at] = numbers[name]
    if not strains:
        measure = strain_measure or DEFAULT_MEASURE
        arrays["longitudinal_strain"] = strain_of(arrays["longitudinal_stretch"], measure)
        arrays["lateral_strain"] = strain_of(arrays["lateral_stretch"], measure)
    if not strains or "poisson_ratio" not in frame.columns:
        arrays["poisson_ratio"] = _ratio(arrays)
    known = np.isfinite(arrays["longitudinal_strain"]) & np.isfinite(arrays["poisson_ratio"])
    words = {name: _words(frame, name, shape, at) for name in ("reason", "poisson_reason")}
    reason = np.where(words["reason"] != "", words["reason"], words["poisson_reason"])
    reason = np.where(reason != "", reason, "target-missing")
    layout = _layout(sidecar, frame, shape, path)
    notes: list[str] = []
    if layout is not None and "CellMm" not in sidecar:
        cell = layout.patch.cell_mm
    else:
        cell, notes = _cell_edge(sidecar, cell_mm, path)
    if not given.all():
        notes.append(f"{int((~given).sum())} cells have no row: they are filled from neighbours.")
    if known.any() and float(np.median(arrays["longitudinal_strain"][known])) > 1:
        notes.append("Most targets ask for more than 100 % strain: strains are fractions.")
    if layout is not None and not {"Grid", "Patch"} & set(sidecar):
        notes.append(
            f"The rows are taken as the drawn grid of {shape[0]} x {shape[1]} cells, the patch of "
            f"{layout.patch.rows} x {layout.patch.columns} cells centred on it."
        )
    beside = path.with_suffix(".json")
    return TargetTable(
        participant=_participant(sidecar, measurement, path),
        side=_side(sidecar.get("Side"), path),
        cell_mm=cell,
        thickness_mm=_positive(
            sidecar.get("ThicknessMm", layout.patch.thickness_mm if layout else THICKNESS_MM),
            "ThicknessMm",
            path,
        ),
        strain_measure=measure,
        longitudinal_strain=arrays["longitudinal_strain"],
        poisson_ratio=np.where(known, arrays["poisson_ratio"], np.nan),
        longitudinal_stretch=arrays["longitudinal_stretch"],
        lateral_stretch=arrays["lateral_stretch"],
        reason=np.where(known, "", reason),
        region=_words(frame, "region", shape, at) if "region" in frame.columns else None,
        layout=layout,
        files=(path, beside) if beside.is_file() and beside != path else (path,),
        notes=tuple(notes),
        has_strain=strains,
    )


def _check_columns(frame: pd.DataFrame, targets: bool, path: Path) -> None:
    absent = [name for name in ("row", "col") if name not in frame.columns]
    if not targets:
        absent.append("longitudinal_strain with poisson_ratio")
    if absent:
        raise TableError(
            "targets-columns",
            "The table of targets lacks columns.",
            remedy="Give row, col, and longitudinal_strain with poisson_ratio (or "
            "longitudinal_stretch with lateral_stretch) for every cell.",
            file=path,
            got=short(", ".join(map(str, frame.columns)), 200),
            expected=", ".join(absent),
        )


def _numbers(
    frame: pd.DataFrame, names: list[str], path: Path
) -> tuple[dict[str, FloatArray], list[tuple[int, int]]]:
    import pandas as pd

    faults: list[Fault] = []

    def fault(code: str, what: str, remedy: str, row: int, column: str, got: object) -> None:
        if len(faults) < _MOST_FAULTS:
            faults.append(
                Fault(code, what, remedy, file=str(path), row=row + 1, column=column, got=str(got))
            )

    place = {}
    for name in ("row", "col"):
        values = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
        with np.errstate(invalid="ignore"):
            bad = ~((values >= 0) & (values < _MOST_CELLS) & (values == np.floor(values)))
        for index in np.flatnonzero(bad):
            fault(
                "targets-cell",
                "A cell's place is no whole number from 0.",
                "Number rows from proximal and columns from lateral, from 0.",
                int(index),
                name,
                frame[name].iloc[index],
            )
        place[name] = np.where(bad, 0, values).astype(np.int64)
    numbers = {}
    for name in names:
        text = frame[name]
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=np.float64)
        absent = text.isna().to_numpy() | text.astype(str).str.strip().isin(["", "n/a"]).to_numpy()
        low, high = _RANGES[name]
        with np.errstate(invalid="ignore"):
            bad = ~absent & ~((values >= low) & (values <= high))
        percent = name.endswith("_strain") and bool(
            (np.abs(values[np.isfinite(values)]) > 5.0).any()
        )
        for index in np.flatnonzero(bad):
            fault(
                "targets-value",
                "A target is no admissible number.",
                "Strains are fractions, not percent: divide by 100."
                if percent
                else "Write a number, or n/a where there is none.",
                int(index),
                name,
                text.iloc[index],
            )
        numbers[name] = np.where(absent, np.nan, values)
    cells = list(zip(place["row"].tolist(), place["col"].tolist(), strict=True))
    if not faults:
        faults += _doubled(cells, path)
    if faults:
        raise TableError.of(faults)
    if not any(np.isfinite(values).any() for values in numbers.values()):
        raise TableError(
            "targets-empty",
            "No cell has a target.",
            remedy="Give at least one cell a strain and a Poisson's ratio.",
            file=path,
        )
    return numbers, cells


def _doubled(cells: list[tuple[int, int]], path: Path) -> list[Fault]:
    seen: set[tuple[int, int]] = set()
    faults = []
    for index, cell in enumerate(cells):
        if cell in seen:
            faults.append(
                Fault(
                    "targets-cell-doubled",
                    "A cell has two rows.",
                    "Give each cell one row, and each participant a table.",
                    file=str(path),
                    row=index + 1,
                    got=f"row {cell[0]}, col {cell[1]}",
                )
            )
        seen.add(cell)
    if min(r for r, _ in cells) > 0 or min(c for _, c in cells) > 0:
        faults.append(
            Fault(
                "targets-from-one",
                "Row 0 or column 0 has no cell.",
                "Number rows and columns from 0; a cell without a target gets n/a.",
                file=str(path),
                got=f"from row {min(r for r, _ in cells)}, col {min(c for _, c in cells)}",
            )
        )
    return faults[:_MOST_FAULTS]


def _ratio(arrays: dict[str, FloatArray]) -> FloatArray:
    strain = arrays["longitudinal_strain"]
    some = np.abs(np.nan_to_num(strain)) > 1e-9
    return np.asarray(np.where(some, -arrays["lateral_strain"] / np.where(some, strain, 1), np.nan))


def _words(
    frame: pd.DataFrame, name: str, shape: tuple[int, int], at: tuple[Any, ...]
) -> NDArray[np.str_]:
    words = np.full(shape, "", dtype="<U64")
    if name in frame.columns:
        column = frame[name].astype(object).where(frame[name].notna(), "").astype(str).str.strip()
        words[at] = column.where(~column.str.lower().isin(["n/a", "nan"]), "").to_numpy(dtype=str)
    return words


def _layout(
    sidecar: dict[str, Any], frame: pd.DataFrame, shape: tuple[int, int], path: Path
) -> Layout | None:
    """The layout of the drawn grid whose cells the rows are, or None."""
    named = {"Grid", "Patch"} & set(sidecar)
    if not named and not (set(frame.columns) >= _GRID_ONLY and shape == (16, 12)):
        return None
    try:
        metadata = LayoutMetadata.model_validate(
            {
                key: sidecar[key]
                for key in ("BodyPart", "Grid", "Patch", "Regions")
                if key in sidecar
            }
        )
    except ValidationError as error:
        raise TableError(
            "targets-layout",
            "The layout in the sidecar is wrong.",
            remedy="Describe Grid and Patch as in dataset_description.json.",
            file=path.with_suffix(".json"),
            got=short(str(error.errors()[0]["loc"]) + " " + error.errors()[0]["msg"], 120),
        ) from error
    layout = Layout.resolve(metadata)
    if (layout.grid.rows, layout.grid.columns) != shape:
        raise TableError(
            "targets-layout",
            "The table does not have the cells of the grid that its sidecar names.",
            remedy="Give every cell of the grid a row, or remove Grid and Patch from the sidecar "
            "where the rows are the patch's own cells.",
            file=path,
            got=f"{shape[0]} x {shape[1]} cells",
            expected=f"{layout.grid.rows} x {layout.grid.columns}",
        )
    return layout


def _cell_edge(sidecar: dict[str, Any], asked: float | None, path: Path) -> tuple[float, list[str]]:
    value = sidecar.get("CellMm", asked)
    if value is None:
        return CELL_MM, [f"Nobody says how large a cell is: {CELL_MM:g} mm, as in the paper."]
    return _positive(value, "CellMm", path), []


def _positive(value: Any, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1e4:
        raise TableError(
            "targets-length",
            f"{name} is no positive length.",
            remedy="Give it in mm.",
            file=path.with_suffix(".json"),
            got=value,
        )
    return float(value)


def _side(value: Any, path: Path) -> str:
    side = value.strip().lower() if isinstance(value, str) else value or ""
    if side not in _SIDES:
        raise TableError(
            "targets-side",
            "Side is neither left nor right: the patch of a left leg is drawn mirrored.",
            remedy="Write left or right, or leave Side out.",
            file=path.with_suffix(".json"),
            got=short(str(value), 60),
            expected="left, right",
        )
    return "" if side == "none" else str(side)


def _participant(sidecar: dict[str, Any], measurement: dict[str, Any], path: Path) -> str:
    for value in (sidecar.get("Participant"), measurement.get("id")):
        if isinstance(value, str) and re.fullmatch(r"[A-Za-z0-9]{1,40}", value):
            return value
    named = re.match(r"sub-([A-Za-z0-9]+)_", path.name)
    return named[1] if named else ""
