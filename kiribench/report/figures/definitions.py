"""A small map of letters for one definition of overlap."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from kiribench.report.figures.cellmap import Sheet
from kiribench.report.html import Html
from kiribench.report.palette import GRADE_FILL, GRADE_INK, GRADE_LETTER, MASKED, QUIET
from kiribench.report.svg import drawing, inline_svg

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def definition_map(
    grades: Sequence[Sequence[str | None]],
    contested: NDArray[np.bool_],
    *,
    mirrored: bool,
    name: str,
    alt: str,
) -> Html:
    """Letters and colours only; cells that other definitions grade otherwise are framed.

    Args:
        grades: R x C of ``good``, ``fair``, ``poor`` or None (not scored).
        contested: (R, C) whether the definitions disagree.
        mirrored: lateral at the right (a left leg seen from the front).
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    rows, columns = contested.shape
    with drawing():
        sheet = Sheet(rows, columns, cell_px=28.0, mirrored=mirrored)
        figure, axes = sheet.open()
        for row in range(rows):
            for column in range(columns):
                grade = grades[row][column]
                if grade is None:
                    sheet.box(axes, row, column, facecolor=MASKED)
                    sheet.write(axes, row, column, "–", color=QUIET)
                    continue
                sheet.box(axes, row, column, facecolor=GRADE_FILL[grade])
                sheet.write(
                    axes, row, column, GRADE_LETTER[grade], color=GRADE_INK[grade], fontsize=12,
                    weight="bold" if contested[row, column] else "normal",
                )  # fmt: skip
        for row in range(rows):
            for column in range(columns):
                if contested[row, column]:
                    sheet.frame(axes, row, column, 1, 1, linewidth=1.8)
        return inline_svg(figure, name, alt)
