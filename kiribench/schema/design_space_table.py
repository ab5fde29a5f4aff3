"""The columns of a design space table of stretches, and how it is written.

One row a design and load step. Stretches are length ratios and need no strain measure; strain
and Poisson's ratio are derived from them by whoever reads the table, in a measure that they name
(:func:`kiribench.schema.design_space.read_design_space`).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

TABLE_FILE = "design_space.parquet"
DIGITS = 9
"""Significant digits of the numbers in a table; the solver's own tolerance is coarser."""

COLUMNS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "design": ("", "name of the design: a and b in percent, joined by a hyphen"),
        "a_percent": ("%", "length of the cuts across the pull / cell edge"),
        "b_percent": ("%", "length of the cuts along the pull / cell edge"),
        "step": ("", "load step of the design, from 1"),
        "displacement_mm": ("mm", "displacement of the pulled end against the fixed one"),
        "longitudinal_stretch": ("1", "deformed / undeformed length along the pull"),
        "lateral_stretch": ("1", "deformed / undeformed length across the pull"),
        "nominal_stress_mpa": ("MPa", "pulling force / undeformed width and thickness"),
        "energy_mpa": ("MPa", "stored elastic energy / undeformed volume of the model"),
        "face_overlap_mm": ("mm", "largest depth to which two faces of a cut interpenetrate"),
        "mesh_error_poisson": ("1", "estimated mesh error of Poisson's ratio in log strain"),
        "status": ("", "ok, not-converged, not-reached or failed; no numbers unless ok"),
    }
)
"""Name -> unit and meaning, in the order of the file."""

TEXT_COLUMNS = ("design", "status")
NO_MEASURE = (
    "none: the table stores stretches (length ratios). Poisson's ratio is a ratio of strains: "
    "name the measure in which you compute them."
)


def rounded(values: FloatArray, digits: int = DIGITS) -> FloatArray:
    """The numbers (any shape) to so many significant digits; NaN stays NaN."""
    result = np.array(values, dtype=np.float64)
    some = np.isfinite(result) & (result != 0)
    scale = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(result[some]))))
    result[some] = np.round(result[some] * scale) / scale
    return result


def table_of(columns: Mapping[str, Any]) -> pd.DataFrame:
    """The table with its columns in order, each in its type, numbers rounded.

    Args:
        columns: name -> (n,) values; numeric columns that are left out are NaN.
    """
    import pandas as pd

    count = len(columns["design"])
    frame: dict[str, Any] = {}
    for name in COLUMNS:
        if name in TEXT_COLUMNS:
            frame[name] = pd.array([str(value) for value in columns[name]], dtype="string")
        elif name == "step":
            frame[name] = np.asarray(columns[name], dtype=np.int32)
        else:
            values = columns.get(name, np.full(count, np.nan))
            frame[name] = rounded(np.asarray(values, dtype=np.float64))
    return pd.DataFrame(frame)


def column_notes() -> dict[str, dict[str, str]]:
    """Unit and meaning of every column, for a sidecar."""
    return {
        name: {"Description": meaning} | ({"Units": unit} if unit else {})
        for name, (unit, meaning) in COLUMNS.items()
    }


def write_design_space(
    path: Path, frame: pd.DataFrame, sidecar: Mapping[str, Any]
) -> tuple[Path, Path]:
    """Write a table as Parquet and its JSON sidecar, each whole or not at all.

    The same table gives the same bytes.

    Args:
        path: the ``.parquet`` file; its folder is made.
        frame: of :func:`table_of`.
        sidecar: what is known beyond the numbers; the notes on the columns are added.

    Returns:
        The two files.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    passing = path.with_name(f".{path.name}.{os.getpid()}.part")
    frame.to_parquet(passing, index=False, compression="zstd")
    passing.replace(path)
    notes = {**sidecar, "StoredMeasure": NO_MEASURE, "Columns": column_notes()}
    beside = path.with_suffix(".json")
    write_whole(beside, json.dumps(notes, indent=2, allow_nan=False, ensure_ascii=False) + "\n")
    return path, beside


def write_whole(path: Path, text: str) -> None:
    """Write a text file so that it is there in full or not at all, even after kill -9."""
    passing = path.with_name(f".{path.name}.{os.getpid()}.part")
    with passing.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    passing.replace(path)
