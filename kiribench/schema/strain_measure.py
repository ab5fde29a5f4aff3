"""The strain measures, and which one a table's strains are in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import TableError
from kiribench.schema.strict_json import short

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
MEASURES = ("log", "engineering", "green")
DEFAULT_MEASURE = "log"
WHY_MEASURE = (
    "Poisson's ratio is a ratio of strains, and at large strain the measures disagree: the "
    "cell (90, 90) at stretch 2 has nu = -0.34 in log and -0.27 in engineering strain."
)


def strain_of_stretch(stretch: FloatArray, measure: str) -> FloatArray:
    """Strain in a named measure of any array of stretches (deformed / reference length)."""
    if measure == "engineering":
        return np.asarray(stretch - 1.0)
    if measure == "green":
        return np.asarray(0.5 * (stretch * stretch - 1.0))
    return np.asarray(np.log(stretch))


def settle_measure(
    frame: pd.DataFrame, sidecar: dict[str, Any], asked: str | None, stretches: bool, path: Path
) -> str:
    """The measure that a table's strains are in, or that its stretches are to be read in.

    Args:
        frame, sidecar: the table and what stands beside it.
        asked: by the caller, or None.
        stretches: whether the table holds stretches, which have no measure.
        path: of the table.

    Raises:
        TableError: the measure is not declared, not known, mixed or contradicted.
    """
    if asked is not None:
        check_measure(asked, path, "--strain-measure")
    if stretches:
        return asked or DEFAULT_MEASURE
    declared: list[tuple[str, str]] = []
    if "StrainMeasure" in sidecar:
        declared.append(("the sidecar", str(sidecar["StrainMeasure"]).strip().lower()))
    if "strain_measure" in frame.columns:
        values = sorted({str(value).strip().lower() for value in frame["strain_measure"]})
        if len(values) > 1:
            raise TableError(
                "strain-measure-mixed",
                f"The table mixes strain measures. {WHY_MEASURE}",
                remedy="Convert all rows to one measure.",
                file=path,
                column="strain_measure",
                got=short(", ".join(values)),
            )
        declared.append(("the column strain_measure", values[0]))
    if asked is not None:
        declared.append(("the call", asked))
    if not declared:
        raise TableError(
            "strain-measure-missing",
            f"The table does not say in which measure its strains are. {WHY_MEASURE}",
            remedy='Write {"StrainMeasure": "log"} (or engineering, green) to '
            f"{path.with_suffix('.json').name}, or give --strain-measure.",
            file=path,
            expected=", ".join(MEASURES),
        )
    for where, value in declared:
        check_measure(value, path, where)
    if len({value for _, value in declared}) > 1:
        raise TableError(
            "strain-measure-conflict",
            f"The strain measure is declared twice and differently. {WHY_MEASURE}",
            remedy="Find out which is right, and correct the other.",
            file=path,
            got="; ".join(f"{where} says {value}" for where, value in declared),
        )
    return declared[0][1]


def check_measure(measure: str, path: Path, where: str) -> None:
    """Refuse a strain measure that does not exist.

    Raises:
        TableError: it is not one of ``MEASURES``.
    """
    if measure not in MEASURES:
        raise TableError(
            "strain-measure-unknown",
            f"There is no such strain measure (from {where}).",
            remedy="Use one of the expected names.",
            file=path,
            got=short(measure),
            expected=", ".join(MEASURES),
        )
