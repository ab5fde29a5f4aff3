"""Designs and load steps as a person types them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kiribench.errors import Fault, TableError, UsageError
from kiribench.fem.campaign_settings import Design, paper_designs
from kiribench.schema.design_space import read_frame

_MOST_STEPS = 10_000


def read_designs(words: str) -> tuple[tuple[Design, ...], tuple[Path, ...]]:
    """The designs that ``words`` name, and the files that were read.

    Args:
        words: ``paper``, pairs in percent such as ``35,85;90,90``, or a CSV, TSV or Parquet
            file with the columns ``a_percent`` and ``b_percent``.

    Raises:
        UsageError: neither pairs of numbers nor a file.
        TableError: the file has no such columns, or values that are no cut lengths.
    """
    if words.strip() == "paper":
        return paper_designs(), ()
    path = Path(words)
    if path.suffix.lower() in (".csv", ".tsv", ".parquet", ".pq") or _is_file(path):
        return _designs_of(path), (path,)
    found = []
    for pair in filter(None, (part.strip() for part in words.split(";"))):
        try:
            a, b = (float(value) for value in pair.split(","))
        except ValueError:
            raise UsageError(
                "designs-words",
                "The designs are no pairs of numbers, and no such file exists.",
                remedy='Give "paper", a table, or pairs "a,b" in percent joined by semicolons.',
                got=pair,
                expected="35,85;90,90",
            ) from None
        found.append(Design(a, b))
    lengths = [value for design in found for value in (design.a_percent, design.b_percent)]
    if lengths and 0 < max(lengths) < 1:
        raise UsageError(
            "cut-lengths-are-fractions",
            "No cut is as long as 1 percent of the cell: these look like fractions.",
            remedy="Give percent: 35,85 for .35 and .85.",
            got=words,
        )
    return tuple(found), ()


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # many pairs make words too long for the name of a file
        return False


def _designs_of(path: Path) -> tuple[Design, ...]:
    import pandas as pd

    frame = read_frame(path)
    absent = [name for name in ("a_percent", "b_percent") if name not in frame.columns]
    if absent:
        raise TableError(
            "column-missing",
            "The table of designs lacks a column.",
            remedy="Give the columns a_percent and b_percent.",
            file=path,
            column=absent[0],
            got=", ".join(map(str, frame.columns)),
        )
    lengths = np.column_stack(
        [
            pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
            for name in ("a_percent", "b_percent")
        ]
    )
    bad = np.argwhere(~((lengths >= 0) & (lengths < 100)))
    if len(bad):
        raise TableError.of(
            Fault(
                "cut-length-range",
                "The cut length is no percentage of the cell edge.",
                "Neighbouring cuts meet at 100.",
                file=str(path),
                row=int(row) + 1,
                column=("a_percent", "b_percent")[column],
                got=str(frame.iloc[row][("a_percent", "b_percent")[column]]),
                expected="0 <= length < 100",
            )
            for row, column in bad[:20]
        )
    if 0 < lengths.max() < 1:
        raise TableError(
            "cut-lengths-are-fractions",
            "No cut is as long as 1 percent of the cell: these look like fractions.",
            remedy="Multiply a_percent and b_percent by 100.",
            file=path,
            got=f"at most {lengths.max():g}",
        )
    return tuple(Design(float(a), float(b)) for a, b in lengths)


def read_steps(words: str) -> tuple[float, ...]:
    """Load steps from ``10,50,120`` or ``10:250:10`` (first:last:step), or both in turn.

    Raises:
        UsageError: not of this form.
    """
    steps: list[float] = []
    try:
        for part in filter(None, (part.strip() for part in words.split(","))):
            if ":" in part:
                first, last, step = (float(value) for value in part.split(":"))
                count = int(np.floor((last - first) / step * (1 + 1e-12) + 1e-9)) + 1
                if not 1 <= count <= _MOST_STEPS:
                    raise ValueError
                steps += [round(first + k * step, 9) for k in range(count)]
            else:
                steps.append(float(part))
    except (ValueError, ZeroDivisionError, OverflowError):
        raise UsageError(
            "steps-words",
            "The load steps are neither numbers nor a range.",
            remedy="Give numbers with commas, or first:last:step.",
            got=words,
            expected="10,50,120 or 10:250:10",
        ) from None
    return tuple(steps)
