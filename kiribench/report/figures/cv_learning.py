"""Error against the number of designs that were learnt from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kiribench.report.figures.cv_style import Marks, plain, plain_numbers
from kiribench.report.html import Html
from kiribench.report.palette import INK
from kiribench.report.svg import canvas, drawing, inline_svg

WIDTH, HEIGHT = 640.0, 340.0


def learning_figure(
    curves: Mapping[str, Sequence[tuple[int, float, float | None]]],
    *,
    marks: Marks,
    groups: str,
    unit: float | None,
    name: str,
    alt: str,
) -> Html:
    """One line a model on logarithmic axes, bars one standard deviation of the draws.

    Args:
        curves: (groups, mean RMSE, its sd) by model.
        groups: what is counted: ``designs``.
        unit: the table's mesh error, a dashed line, if there is one.
        marks: of the models.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    with drawing():
        figure = canvas(WIDTH, HEIGHT)
        axes = figure.add_axes((62 / WIDTH, 44 / HEIGHT, 380 / WIDTH, 280 / HEIGHT))
        plain(axes)
        axes.set_xscale("log")
        axes.set_yscale("log")
        plain_numbers(axes.xaxis, each=(1.0, 2.0, 5.0))
        plain_numbers(axes.yaxis)
        for model, points in curves.items():
            colour, shape = marks[model]
            size = [point[0] for point in points]
            error = [point[1] for point in points]
            # A bar down to zero has no end on a logarithmic axis.
            down = [min(point[2] or 0.0, 0.7 * point[1]) for point in points]
            up = [point[2] or 0.0 for point in points]
            axes.errorbar(
                size, error, yerr=(down, up), color=colour, marker=shape, markersize=4,
                linewidth=1.2, elinewidth=0.7, label=model,
            )  # fmt: skip
        if unit is not None:
            axes.axhline(unit, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), label="mesh error")
        axes.set_xlabel(f"{groups} to learn from")
        axes.set_ylabel(f"RMSE of new {groups}")
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.02), frameon=False, fontsize=9)
        return inline_svg(figure, name, alt)
