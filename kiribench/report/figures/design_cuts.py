"""The cuts of a patch drawn: maps of their lengths, and the lattice itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.lattice import CutMap
from kiribench.report.figures.cellmap import Sheet
from kiribench.report.html import Html, tag
from kiribench.report.palette import INK, QUIET, SEQUENTIAL, ink_on
from kiribench.report.svg import drawing, inline_svg

FloatArray = NDArray[np.float64]

PX_PER_MM = 2.6


def length_map(
    values: FloatArray, marked: NDArray[np.bool_], *, mirrored: bool, title: str, name: str
) -> Html:
    """A map of cut lengths in percent, with a number in every cell.

    Args:
        values: (R, C) fractions of the cell edge.
        marked: (R, C) cells that carry a reason; their number gets an asterisk.
        mirrored: lateral at the right.
        title: what it is.
        name: unique on the page.
    """
    from matplotlib.colors import LinearSegmentedColormap

    scale = LinearSegmentedColormap.from_list("lengths", list(SEQUENTIAL))
    rows, columns = values.shape
    with drawing():
        sheet = Sheet(rows, columns, cell_px=38.0, mirrored=mirrored, extra_bottom=22.0)
        figure, axes = sheet.open()
        for row, column in np.ndindex(rows, columns):
            fill = scale(float(values[row, column]))[:3]
            sheet.box(axes, row, column, facecolor=fill, linewidth=0.8)
            star = "*" if marked[row, column] else ""
            sheet.write(
                axes, row, column, f"{100 * values[row, column]:.0f}{star}", fontsize=9.5,
                color=ink_on(fill),
            )  # fmt: skip
        axes.text(
            columns / 2, rows + 34 / sheet.cell_px, title, ha="center", va="center", fontsize=10,
            color=INK,
        )  # fmt: skip
        return inline_svg(
            figure, name, f"{title}: {100 * values.min():.0f} to {100 * values.max():.0f} %"
        )


def cuts_drawing(cut_map: CutMap, *, mirrored: bool, name: str = "cuts") -> Html:
    """The outline and the cuts, seen from outside; lateral at the right if ``mirrored``."""
    width, length = cut_map.size_mm
    cuts = cut_map.half_cuts().cuts()
    x = np.column_stack([cuts.start_mm[:, 0], cuts.end_mm[:, 0]])
    if mirrored:
        x = width - x
    y = np.column_stack([cuts.start_mm[:, 1], cuts.end_mm[:, 1]])
    path = "".join(
        f"M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}" for (x0, x1), (y0, y1) in zip(x, y, strict=True)
    )
    margin = 8.0
    sides = ("medial", "lateral") if mirrored else ("lateral", "medial")
    words = [
        tag("text", word, x=f"{at:.2f}", y="-2.5", text_anchor=anchor, font_size="4", fill=QUIET)
        for word, at, anchor in (
            (sides[0], 0.0, "start"),
            ("proximal ↑", width / 2, "middle"),
            (sides[1], width, "end"),
        )
    ]
    box = (-margin, -margin, width + 2 * margin, length + 2 * margin)
    return tag(
        "svg",
        tag(
            "rect", x=0, y=0, width=f"{width:g}", height=f"{length:g}", fill="#f4efe6",
            stroke=QUIET, stroke_width="0.3",
        ),
        tag("path", d=path, fill="none", stroke="#b3001b", stroke_width="0.35"),
        *words,
        xmlns="http://www.w3.org/2000/svg",
        viewBox=" ".join(f"{value:g}" for value in box),
        width=f"{PX_PER_MM * box[2]:.0f}",
        height=f"{PX_PER_MM * box[3]:.0f}",
        role="img",
        aria_label=f"{len(cuts)} cuts on {width:g} x {length:g} mm",
        id=name,
    )  # fmt: skip
