"""Maps of a designed patch: numbers in the cells while they can be read, else colours alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.dense_map import dense_map
from kiribench.report.figures.design_cuts import length_map
from kiribench.report.figures.heatmap import heatmap, scale_limit
from kiribench.report.html import Html
from kiribench.report.palette import DIVERGING, SEQUENTIAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MANY = 600
"""Cells beyond which maps have colours alone, and figures and tables show some of the cells."""


def evenly(count: int, first: NDArray[np.bool_] | None = None) -> IntArray:
    """(k,) sorted indices of at most MANY of ``count`` things, evenly spread; some come first."""
    if count <= MANY:
        return np.arange(count)
    wanted = np.zeros(0, np.int64) if first is None else np.flatnonzero(first)
    if len(wanted) >= MANY:
        return wanted[np.linspace(0, len(wanted) - 1, MANY).astype(np.int64)]
    rest = np.setdiff1d(np.arange(count), wanted)
    spread = np.linspace(0, len(rest) - 1, MANY - len(wanted)).astype(np.int64)
    return np.union1d(wanted, rest[spread])


def of_all(shown: int, count: int, what: str) -> str:
    """The sentence that belongs to a choice of some; empty where all are shown."""
    return "" if shown == count else f" {shown} of {count} {what} are shown, evenly chosen."


def cut_lengths(
    values: FloatArray, marked: NDArray[np.bool_], letter: str, *, mirrored: bool
) -> Html:
    """The map of a or b, (R, C) fractions; ``marked`` cells carry a reason."""
    title, name = f"{letter}, %", f"map-{letter}"
    if values.size <= MANY:
        return length_map(values, marked, mirrored=mirrored, title=title, name=name)
    return dense_map(
        100 * values, low=0.0, high=100.0, colours=SEQUENTIAL, label=title, mirrored=mirrored,
        name=name, alt=f"{title}: {100 * values.min():.0f} to {100 * values.max():.0f} %",
    )  # fmt: skip


def signed_map(
    values: FloatArray,
    label: str,
    alt: str,
    name: str,
    letters: dict[tuple[int, int], str],
    *,
    mirrored: bool,
) -> Html:
    """The map of a signed quantity; ``letters`` say why a cell has none."""
    limit = scale_limit(values)
    if values.size > MANY:
        return dense_map(
            values, low=-limit, high=limit, colours=DIVERGING, label=label, mirrored=mirrored,
            name=name, alt=alt,
        )  # fmt: skip
    return heatmap(
        values, limit=limit, label=label, mirrored=mirrored, name=name, alt=alt, reasons=letters
    )
