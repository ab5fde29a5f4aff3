"""Marks of the models in the figures of a cross-validation: colour and shape together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kiribench.report.palette import LINE, QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#1f5f8b", "#c4500b", "#3b7a3b", "#7a4a9e", "#a33a20", "#008080", "#8a6d00", "#444f58")
SHAPES = ("o", "s", "^", "D", "v", "P", "X")


def mark_of(index: int) -> tuple[str, str]:
    """Colour and shape of the model with this place in the list; no two of 56 are alike."""
    return COLOURS[index % len(COLOURS)], SHAPES[index % len(SHAPES)]


def plain(axes: Axes) -> None:
    """Light axes: two spines, a faint grid behind the data."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(LINE)
    axes.tick_params(colors=QUIET, labelsize=9)
    axes.grid(True, color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)
