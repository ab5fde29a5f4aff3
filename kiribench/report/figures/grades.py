"""The cell map: letter, colour and overlap of every cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from kiribench.report.figures.cellmap import Sheet
from kiribench.report.html import Html
from kiribench.report.palette import GRADE_FILL, GRADE_INK, GRADE_LETTER, INK, MASKED, QUIET
from kiribench.report.svg import drawing, inline_svg
from kiribench.report.words import overlap_words

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes
    from numpy.typing import NDArray


def grade_map(
    grades: Sequence[Sequence[str | None]],
    overlap: NDArray[np.float64],
    regions: Sequence[Sequence[str]],
    contested: NDArray[np.bool_],
    *,
    mirrored: bool,
    name: str = "grades",
    alt: str,
) -> Html:
    """The map of grades, with letters as well as colours.

    Args:
        grades: R x C of ``good``, ``fair``, ``poor`` or None (not scored).
        overlap: (R, C) overlap in the definition that grades; NaN where not scored.
        regions: R x C region labels; their borders are drawn.
        contested: (R, C) whether another definition gives another grade.
        mirrored: lateral at the right (a left leg seen from the front).
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    rows, columns = overlap.shape
    with drawing():
        sheet = Sheet(rows, columns, cell_px=48.0, mirrored=mirrored, extra_bottom=44.0)
        figure, axes = sheet.open()
        for row in range(rows):
            for column in range(columns):
                _cell(sheet, axes, row, column, grades[row][column], float(overlap[row, column]))
                if contested[row, column]:
                    _corner(sheet, axes, row, column, grades[row][column])
        sheet.borders(axes, regions, width=1.8)
        _key(sheet, axes)
        return inline_svg(figure, name, alt)


def _cell(
    sheet: Sheet, axes: Axes, row: int, column: int, grade: str | None, overlap: float
) -> None:
    if grade is None:
        sheet.box(axes, row, column, facecolor=MASKED, hatch="////", edgecolor="#b6c0c8")
        sheet.write(axes, row, column, "n/a", color=QUIET, fontsize=10)
        return
    ink = GRADE_INK[grade]
    sheet.box(axes, row, column, facecolor=GRADE_FILL[grade])
    sheet.write(
        axes, row, column, GRADE_LETTER[grade], dy_px=-7, color=ink, fontsize=15, weight="bold"
    )
    sheet.write(axes, row, column, overlap_words(overlap), dy_px=11, color=ink, fontsize=10.5)


def _corner(sheet: Sheet, axes: Axes, row: int, column: int, grade: str | None) -> None:
    from matplotlib.patches import Polygon

    side = 0.26
    right = sheet.x(column) + 1
    corner = [(right - side, row), (right, row), (right, row + side)]
    colour = GRADE_INK[grade] if grade else INK
    axes.add_patch(Polygon(corner, closed=True, facecolor=colour, linewidth=0, clip_on=False))


def _key(sheet: Sheet, axes: Axes) -> None:
    from matplotlib.patches import Polygon, Rectangle

    unit = 1 / sheet.cell_px
    y = sheet.rows + 34 * unit
    step = sheet.columns / 3
    for index, grade in enumerate(("good", "fair", "poor")):
        x = index * step
        axes.add_patch(
            Rectangle(
                (x, y - 9 * unit), 18 * unit, 18 * unit, clip_on=False, linewidth=0,
                facecolor=GRADE_FILL[grade],
            )
        )  # fmt: skip
        axes.text(
            x + 9 * unit, y, GRADE_LETTER[grade], color=GRADE_INK[grade], ha="center",
            va="center", fontsize=11, weight="bold",
        )  # fmt: skip
        axes.text(x + 25 * unit, y, grade, ha="left", va="center", fontsize=11)
    y += 22 * unit
    triangle = [(6 * unit, y - 6 * unit), (18 * unit, y - 6 * unit), (18 * unit, y + 6 * unit)]
    axes.add_patch(Polygon(triangle, closed=True, facecolor=INK, linewidth=0, clip_on=False))
    axes.text(25 * unit, y, "grade depends on the definition", ha="left", va="center", fontsize=11)
