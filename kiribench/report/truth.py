"""The known truth of a synthetic subject, to put beside what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.grades import grade_of
from kiribench.conformability.result import DEFINITIONS, FAIR_FROM, Conformability, GradeBy
from kiribench.dataset import Dataset
from kiribench.dataset.files import Folder
from kiribench.errors import Fault, TableError
from kiribench.schema.tsv import parse_tsv
from kiribench.strain.result import StrainField

FloatArray = NDArray[np.float64]

STRAIN_COLUMNS = ("longitudinal_stretch", "lateral_stretch", "shear")


@dataclass(frozen=True, eq=False)
class Truth:
    """What the closed forms of a synthetic subject say.

    Attributes:
        overlap: (R, C) of the patch by definition, or None.
        strain: (R, C) of the grid by column name (stretches and shear), or None.
    """

    overlap: dict[GradeBy, FloatArray] | None
    strain: dict[str, FloatArray] | None


@dataclass(frozen=True)
class Agreement:
    """How far a measured quantity is from its truth.

    Attributes:
        quantity: its name.
        cells: compared.
        largest, rms: of the difference.
    """

    quantity: str
    cells: int
    largest: float
    rms: float


def read_truth(dataset: Dataset, participant: str) -> Truth | None:
    """The truth tables under ``derivatives/truth``, or None where there are none.

    Raises:
        TableError: a table is there but cannot be read; make the dataset anew.
    """
    overlap = _read(dataset, participant, "overlap", [f"overlap_{name}" for name in DEFINITIONS])
    strain = _read(dataset, participant, "strain", STRAIN_COLUMNS)
    if overlap is None and strain is None:
        return None
    by = None if overlap is None else {name: overlap[f"overlap_{name}"] for name in DEFINITIONS}
    return Truth(by, strain)


def agreements(
    truth: Truth, score: Conformability | None, strain: StrainField | None
) -> tuple[Agreement, ...]:
    """Differences of all quantities that have a truth; overlaps for global alignment only."""
    listed = []
    if score is not None and truth.overlap is not None and score.alignment == "global":
        measured: dict[GradeBy, FloatArray] = {
            "paper": score.overlap_paper,
            "strict": score.overlap_strict,
            "iou": score.overlap_iou,
        }
        for name in DEFINITIONS:
            listed.append(_agreement(f"overlap, {name}", measured[name], truth.overlap[name]))
    if strain is not None and truth.strain is not None:
        for column, value in zip(
            STRAIN_COLUMNS,
            (strain.longitudinal_stretch, strain.lateral_stretch, strain.shear),
            strict=True,
        ):
            listed.append(_agreement(column.replace("_", " "), value.value, truth.strain[column]))
    return tuple(found for found in listed if found is not None)


def grades_agreeing(truth: Truth, score: Conformability) -> tuple[int, int] | None:
    """(cells with the true grade, cells compared), or None where nothing can be compared."""
    if truth.overlap is None or score.alignment != "global":
        return None
    true = grade_of(truth.overlap[score.grade_by])
    if true.shape != score.grade.shape:
        return None
    both = score.scored & (true != "")
    return int((true == score.grade)[both].sum()), int(both.sum())


def true_satisfactory(truth: Truth, grade_by: GradeBy) -> float | None:
    """The true share of cells that are at least fair, or None."""
    if truth.overlap is None:
        return None
    known = truth.overlap[grade_by]
    known = known[np.isfinite(known)]
    return float((known >= FAIR_FROM).mean()) if len(known) else None


def _agreement(quantity: str, measured: FloatArray, true: FloatArray) -> Agreement | None:
    if measured.shape != true.shape:
        return None
    difference = (measured - true)[np.isfinite(measured) & np.isfinite(true)]
    if not len(difference):
        return None
    return Agreement(
        quantity,
        len(difference),
        float(np.abs(difference).max()),
        float(np.sqrt((difference**2).mean())),
    )


def _read(
    dataset: Dataset, participant: str, kind: str, columns: list[str] | tuple[str, ...]
) -> dict[str, FloatArray] | None:
    folder = Folder.at(dataset.root)
    name = f"sub-{participant}"
    path = dataset.root / "derivatives" / "truth" / name / f"{name}_{kind}.tsv"
    if not folder.usable(path):
        return None
    data, faults = folder.read(path)
    table = None
    if data is not None:
        table, faults = parse_tsv(data, file=folder.name(path))
    if table is None or not {"row", "col", *columns} <= set(table.columns):
        fault = Fault(
            "truth-table",
            "The table of the synthetic truth cannot be read.",
            "Make the synthetic dataset anew with 'kiribench synth'.",
            file=folder.name(path),
            expected=", ".join(("row", "col", *columns)),
        )
        raise TableError.of([*faults, fault])
    row = np.array([int(field) for field in table.column("row")])
    col = np.array([int(field) for field in table.column("col")])
    arrays = {}
    for column in columns:
        values = np.full((row.max() + 1, col.max() + 1), np.nan)
        values[row, col] = [
            np.nan if field == "n/a" else float(field) for field in table.column(column)
        ]
        arrays[column] = values
    return arrays
