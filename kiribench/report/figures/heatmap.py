"""Heatmaps over the drawn grid: a number in every cell, masked cells hatched with a reason."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kiribench.report.figures.cellmap import Sheet
from kiribench.report.html import Html
from kiribench.report.palette import DIVERGING, INK, MASKED, QUIET, ink_on
from kiribench.report.svg import drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from numpy.typing import NDArray


def heatmap(
    values: NDArray[np.float64],
    *,
    limit: float,
    label: str,
    mirrored: bool,
    name: str,
    alt: str,
    reasons: Mapping[tuple[int, int], str] | None = None,
    doubtful: NDArray[np.bool_] | None = None,
    patch: tuple[int, int, int, int] | None = None,
) -> Html:
    """A map of a signed quantity on a scale that is symmetric about zero.

    Args:
        values: (R, C) fractions or ratios; NaN where masked.
        limit: the scale runs from -limit to +limit; what lies beyond gets the end colour and
            the scale ends in arrows. Its own number stands in every cell.
        label: name of the quantity with its strain measure.
        mirrored: lateral at the right (a left leg seen from the front).
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
        reasons: (row, column) -> one letter that says why a cell is masked.
        doubtful: (R, C) cells whose value gets an asterisk.
        patch: row, column, rows and columns of the patch in this grid, drawn as an outline.
    """
    from matplotlib.colors import LinearSegmentedColormap

    rows, columns = values.shape
    scale = LinearSegmentedColormap.from_list("signed", DIVERGING, N=256)
    with drawing():
        sheet = Sheet(
            rows, columns, cell_px=32.0 if columns > 8 else 44.0, mirrored=mirrored,
            extra_bottom=46.0,
        )  # fmt: skip
        figure, axes = sheet.open()
        for row in range(rows):
            for column in range(columns):
                value = float(values[row, column])
                if np.isnan(value):
                    sheet.box(
                        axes, row, column, facecolor=MASKED, hatch="////", edgecolor="#93a1ac",
                        linewidth=0.4,
                    )  # fmt: skip
                    letter = (reasons or {}).get((row, column), "?")
                    axes.text(
                        sheet.x(column) + 0.5, row + 0.5, letter, ha="center", va="center",
                        fontsize=10, color=INK,
                        bbox={"facecolor": MASKED, "edgecolor": "none", "pad": 0.6},
                    )  # fmt: skip
                    continue
                fill = scale(0.5 + 0.5 * float(np.clip(value / limit, -1, 1)))[:3]
                sheet.box(axes, row, column, facecolor=fill, linewidth=0.8)
                star = "*" if doubtful is not None and doubtful[row, column] else ""
                sheet.write(
                    axes, row, column, short(value) + star, fontsize=9.5, color=ink_on(fill)
                )
        _extremes(sheet, axes, values)
        if patch is not None:
            sheet.frame(axes, *patch)
        beyond = bool(np.nanmax(np.abs(values), initial=0.0) > limit * (1 + 1e-9))
        _scale(sheet, axes, scale, limit, label, beyond)
        return inline_svg(figure, name, alt)


def scale_limit(*arrays: NDArray[np.float64], ceiling: float | None = None) -> float:
    """The end of a symmetric scale that holds all values, rounded up to a round number.

    Args:
        arrays: the quantities that share the scale; NaN is passed over.
        ceiling: never beyond this.
    """
    largest = max((float(np.nanmax(np.abs(a), initial=0.0)) for a in arrays), default=0.0)
    if ceiling is not None:
        largest = min(largest, ceiling)
    for step in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0):
        if largest <= step:
            return step
    return float(np.ceil(largest))


def short(value: float) -> str:
    """A value with two decimals and no leading zero, as narrow as a map needs it."""
    shown = f"{value:.2f}".replace("-", "−")
    if shown in {"−0.00", "0.00"}:
        return "0"
    return shown.replace("0.", ".", 1) if shown.lstrip("−").startswith("0.") else shown


def _extremes(sheet: Sheet, axes: Axes, values: NDArray[np.float64]) -> None:
    if np.all(np.isnan(values)):
        return
    for flat in {int(np.nanargmin(values)), int(np.nanargmax(values))}:
        row, column = divmod(flat, values.shape[1])
        sheet.frame(axes, row, column, 1, 1, linewidth=1.4, linestyle=(0, (2, 1.2)))


def _scale(
    sheet: Sheet, axes: Axes, scale: Colormap, limit: float, label: str, beyond: bool
) -> None:
    from matplotlib.patches import Polygon, Rectangle

    unit = 1 / sheet.cell_px
    top = sheet.rows + 28 * unit
    left, right = 0.5, sheet.columns - 0.5
    height = 9 * unit
    steps = 120
    for step in range(steps):
        x = left + (right - left) * step / steps
        axes.add_patch(
            Rectangle(
                (x, top), (right - left) / steps * 1.05, height, linewidth=0, clip_on=False,
                facecolor=scale((step + 0.5) / steps),
            )
        )  # fmt: skip
    if beyond:
        for x, sign, end in ((left, -1, 0.0), (right, 1, 1.0)):
            tip = [(x, top), (x + sign * height, top + height / 2), (x, top + height)]
            axes.add_patch(
                Polygon(tip, closed=True, facecolor=scale(end), linewidth=0, clip_on=False)
            )
    for part in (0.0, 0.25, 0.5, 0.75, 1.0):
        value = limit * (2 * part - 1)
        shown = "0" if part == 0.5 else f"{value:+.3g}".replace("-", "−")
        axes.text(
            left + part * (right - left), top + height + 9 * unit, shown, ha="center", va="center",
            fontsize=9.5,
        )  # fmt: skip
    axes.text(
        (left + right) / 2, top + height + 24 * unit, label, ha="center", va="center", fontsize=10,
        color=QUIET,
    )  # fmt: skip
