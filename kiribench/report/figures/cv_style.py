"""Marks of the models in the figures of a cross-validation: colour and shape together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from kiribench.report.palette import LINE, QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

COLOURS = ("#1f5f8b", "#c4500b", "#3b7a3b", "#7a4a9e", "#a33a20", "#008080", "#8a6d00", "#444f58")
Marks = Mapping[str, tuple[str, str]]
SHAPES = ("o", "s", "^", "D", "v", "P", "X")


def mark_of(index: int) -> tuple[str, str]:
    """Colour and shape of the model with this place in the list; no two of 56 are alike."""
    return COLOURS[index % len(COLOURS)], SHAPES[index % len(SHAPES)]


def marks_of(models: Sequence[str]) -> Marks:
    """The mark of each model, the same in every figure that is given the same list."""
    return {model: mark_of(index) for index, model in enumerate(models)}


def plain(axes: Axes) -> None:
    """Light axes: two spines, a faint grid behind the data."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(LINE)
    axes.tick_params(colors=QUIET, labelsize=9)
    axes.grid(True, color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)


def plain_numbers(axis: Axis, *, each: tuple[float, ...] = (1.0,)) -> None:
    """Numbers on a logarithmic axis as a person writes them, no powers.

    Texts of the figures are never read as formulas (a design may be called ``$a$``), and the
    usual labels of a logarithmic axis are formulas.

    Args:
        axis: logarithmic.
        each: which multiples of a power of ten get a number.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(10.0, subs=each))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
