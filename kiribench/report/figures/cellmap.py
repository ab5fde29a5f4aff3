"""The sheet of cells that all maps are drawn on, with its directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from kiribench.report.palette import INK, QUIET
from kiribench.report.svg import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN_LEFT = 34.0
MARGIN_RIGHT = 12.0
MARGIN_TOP = 40.0
MARGIN_BOTTOM = 24.0


@dataclass(frozen=True)
class Sheet:
    """A map of ``rows`` x ``columns`` cells, proximal at the top.

    Attributes:
        rows, columns: the number of cells.
        cell_px: natural width and height of a cell.
        mirrored: column 0 (lateral) at the right, as a left leg is seen from the front.
        extra_bottom: room for a scale or a key below the map.
    """

    rows: int
    columns: int
    cell_px: float = 44.0
    mirrored: bool = False
    extra_bottom: float = 0.0
    ticks: bool = True

    @property
    def size_px(self) -> tuple[float, float]:
        """Width and height of the drawing."""
        return (
            MARGIN_LEFT + self.columns * self.cell_px + MARGIN_RIGHT,
            MARGIN_TOP + self.rows * self.cell_px + MARGIN_BOTTOM + self.extra_bottom,
        )

    def x(self, column: float, width: float = 1.0) -> float:
        """Left side of something ``width`` columns wide that starts at ``column``."""
        return self.columns - column - width if self.mirrored else column

    def open(self) -> tuple[Figure, Axes]:
        """The figure and axes in cell units: x from 0 to columns, y from 0 (top) to rows."""
        width, height = self.size_px
        figure = canvas(width, height)
        axes = figure.add_axes(
            (
                MARGIN_LEFT / width,
                (MARGIN_BOTTOM + self.extra_bottom) / height,
                self.columns * self.cell_px / width,
                self.rows * self.cell_px / height,
            )
        )
        axes.set_xlim(0, self.columns)
        axes.set_ylim(self.rows, 0)
        axes.set_axis_off()
        self._directions(axes)
        return figure, axes

    def _directions(self, axes: Axes) -> None:
        unit = 1.0 / self.cell_px
        sides = ("medial", "lateral") if self.mirrored else ("lateral", "medial")
        for x, side, align in ((0, sides[0], "left"), (self.columns, sides[1], "right")):
            axes.text(x, -23 * unit, side, ha=align, va="center", fontsize=10, color=QUIET)
        axes.text(
            self.columns / 2, -23 * unit, "proximal ↑", ha="center", va="center", fontsize=10,
            color=QUIET,
        )  # fmt: skip
        axes.text(
            self.columns / 2, self.rows + 13 * unit, "distal ↓", ha="center", va="center",
            fontsize=10, color=QUIET,
        )  # fmt: skip
        if not self.ticks:
            return
        for column in range(self.columns):
            axes.text(
                self.x(column) + 0.5, -8 * unit, str(column), ha="center", va="center",
                fontsize=8.5, color=QUIET,
            )  # fmt: skip
        for row in range(self.rows):
            axes.text(
                -7 * unit, row + 0.5, str(row), ha="right", va="center", fontsize=8.5, color=QUIET
            )

    def box(self, axes: Axes, row: float, column: float, **style: Any) -> None:
        """A filled cell."""
        from matplotlib.patches import Rectangle

        style = {"facecolor": "none", "edgecolor": "#ffffff", "linewidth": 1.2, **style}
        axes.add_artist(Rectangle((self.x(column), row), 1, 1, clip_on=False, **style))

    def write(
        self, axes: Axes, row: float, column: float, words: str, *, dy_px: float = 0.0, **style: Any
    ) -> None:
        """Words in the middle of a cell, moved down by ``dy_px``."""
        style = {"ha": "center", "va": "center", "fontsize": 10, "color": INK, **style}
        axes.text(
            self.x(column) + 0.5, row + 0.5 + dy_px / self.cell_px, words, clip_on=False, **style
        )

    def borders(
        self, axes: Axes, labels: Sequence[Sequence[str]], *, width: float = 2.0, colour: str = INK
    ) -> None:
        """Lines where the label of two neighbouring cells differs, and around the sheet."""
        for row in range(self.rows):
            for column in range(self.columns + 1):
                left = labels[row][column - 1] if column else None
                right = labels[row][column] if column < self.columns else None
                if left != right:
                    x = self.x(column, 0.0)
                    self._line(axes, (x, x), (row, row + 1), width, colour)
        for column in range(self.columns):
            for row in range(self.rows + 1):
                above = labels[row - 1][column] if row else None
                below = labels[row][column] if row < self.rows else None
                if above != below:
                    x = self.x(column)
                    self._line(axes, (x, x + 1), (row, row), width, colour)

    @staticmethod
    def _line(
        axes: Axes, x: tuple[float, float], y: tuple[float, float], width: float, colour: str
    ) -> None:
        axes.plot(x, y, color=colour, linewidth=width, solid_capstyle="projecting", clip_on=False)

    def frame(
        self, axes: Axes, row: int, column: int, rows: int, columns: int, **style: Any
    ) -> None:
        """An outline around a block of cells."""
        from matplotlib.patches import Rectangle

        style = {"facecolor": "none", "edgecolor": INK, "linewidth": 1.6, **style}
        x = self.x(column, columns)
        axes.add_patch(Rectangle((x, row), columns, rows, clip_on=False, **style))
