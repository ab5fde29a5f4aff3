"""Time of a fit against error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from kiribench.report.figures.cv_style import Marks, plain, plain_numbers
from kiribench.report.html import Html
from kiribench.report.palette import INK
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axis import Axis

WIDTH, HEIGHT = 640.0, 340.0


def time_figure(
    models: Mapping[str, tuple[float, float]],
    *,
    marks: Marks,
    unit: float | None,
    name: str,
    alt: str,
) -> Html:
    """One mark a model on logarithmic axes; lower left is better.

    Args:
        models: (seconds of a fit, RMSE) by model, both positive.
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
        for model, (seconds, error) in models.items():
            colour, shape = marks[model]
            axes.scatter([seconds], [error], color=colour, marker=shape, s=36, label=model)
        if unit is not None:
            axes.axhline(unit, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), label="mesh error")
        axes.set_xlim(*_numbered(axes.xaxis, [seconds for seconds, _ in models.values()]))
        errors = [error for _, error in models.values()]
        axes.set_ylim(*_numbered(axes.yaxis, [*errors, unit] if unit else errors))
        axes.set_xlabel("seconds to fit and predict one fold")
        axes.set_ylabel("RMSE under the headline protocol")
        axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.02), frameon=False, fontsize=9)
        return inline_svg(figure, name, alt)


def _numbered(axis: Axis, values: list[float]) -> tuple[float, float]:
    """Limits that hold two numbers at least, however close the values are to each other."""
    steps = [m * 10.0**k for k in range(-12, 13) for m in (1.0, 2.0, 5.0)]
    low = max((step for step in steps if step <= min(values)), default=min(values))
    high = min((step for step in steps if step > max(values)), default=max(values))
    plain_numbers(axis, each=(1.0, 2.0, 5.0) if high <= 200.0 * low else (1.0,))
    return low / 1.1, high * 1.1
