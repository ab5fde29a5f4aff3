"""Stated against found coverage of central intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kiribench.report.figures.cv_style import Marks, plain
from kiribench.report.html import Html
from kiribench.report.palette import INK
from kiribench.report.svg import canvas, drawing, inline_svg

WIDTH, HEIGHT = 560.0, 340.0


def calibration_figure(
    curves: Mapping[str, Sequence[tuple[float, float]]], *, marks: Marks, name: str, alt: str
) -> Html:
    """One line a model; below the diagonal a model is too sure of itself.

    Args:
        curves: (stated, found) coverage by model.
        marks: of the models.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    with drawing():
        figure = canvas(WIDTH, HEIGHT)
        axes = figure.add_axes((54 / WIDTH, 44 / HEIGHT, 280 / WIDTH, 280 / HEIGHT))
        plain(axes)
        axes.plot((0, 1), (0, 1), color=INK, linewidth=0.8)
        for model, curve in curves.items():
            colour, shape = marks[model]
            stated, found = zip(*curve, strict=True)
            axes.plot(
                stated,
                found,
                color=colour,
                marker=shape,
                markersize=3.5,
                linewidth=1.2,
                label=model,
            )
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1)
        axes.set_xlabel("stated probability of the interval")
        axes.set_ylabel("share of test rows inside")
        axes.legend(loc="upper left", bbox_to_anchor=(1.03, 1.0), frameon=False, fontsize=9)
        return inline_svg(figure, name, alt)
