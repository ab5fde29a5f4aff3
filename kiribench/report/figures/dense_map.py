"""Maps of patches of so many cells that no number fits into one: colours alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kiribench.report.html import Html
from kiribench.report.palette import LINE, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

SIDE_PX = 360.0
BAR_PX = 70.0


def dense_map(
    values: NDArray[np.float64],
    *,
    low: float,
    high: float,
    colours: Sequence[str],
    label: str,
    mirrored: bool,
    name: str,
    alt: str,
) -> Html:
    """One picture element a cell, in the directions of all other maps.

    Args:
        values: (R, C); NaN where there is none, left white.
        low, high: ends of the scale.
        colours: of the scale, from low to high.
        label: of the scale, with its unit.
        mirrored: lateral at the right.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    from matplotlib.colors import LinearSegmentedColormap

    rows, columns = values.shape
    pixel = SIDE_PX / max(rows, columns)
    width, height = columns * pixel + 50 + BAR_PX, rows * pixel + 50
    with drawing():
        figure = canvas(width, height)
        axes = figure.add_axes(
            (40 / width, 20 / height, columns * pixel / width, rows * pixel / height)
        )
        image = axes.imshow(
            values[:, ::-1] if mirrored else values,
            cmap=LinearSegmentedColormap.from_list("dense", list(colours)),
            vmin=low, vmax=high, aspect="auto", interpolation="nearest",
        )  # fmt: skip
        axes.set_xticks([])
        axes.set_ylabel("row", color=QUIET)
        axes.tick_params(labelsize=9, colors=QUIET)
        axes.spines[:].set_color(LINE)
        bar = figure.add_axes(
            ((50 + columns * pixel) / width, 20 / height, 12 / width, rows * pixel / height)
        )
        figure.colorbar(image, cax=bar).set_label(label)
        sides = ("medial", "lateral") if mirrored else ("lateral", "medial")
        for at, word, way in ((0.0, sides[0], "left"), (1.0, sides[1], "right")):
            axes.text(
                at, -4 / height, word, transform=axes.transAxes, ha=way, va="top", fontsize=9,
                color=QUIET,
            )  # fmt: skip
        axes.set_title("proximal ↑", fontsize=9, color=QUIET)
        return inline_svg(figure, name, alt)
