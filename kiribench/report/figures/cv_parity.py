"""Predicted against simulated, one panel a model, each row of a test fold a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.cv_style import plain
from kiribench.report.html import Html
from kiribench.report.palette import ACCENT, INK
from kiribench.report.svg import canvas, drawing, inline_svg

FloatArray = NDArray[np.float64]
PANEL = 190.0
ACROSS = 4
LEFT = 62  # points: tick numbers and the label of the upward axis


@dataclass(frozen=True, eq=False)
class ParityPanel:
    """One model: (q,) targets and predictions of test rows, and a title."""

    title: str
    truth: FloatArray
    mean: FloatArray


def parity_figure(panels: Sequence[ParityPanel], *, label: str, name: str, alt: str) -> Html:
    """A grid of parity plots on common axes.

    Args:
        panels: one a model, at least one.
        label: the target's name.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    low = min(float(panel.truth.min()) for panel in panels)
    high = max(float(panel.truth.max()) for panel in panels)
    room = 0.12 * (high - low or 1.0)
    ends = (low - room, high + room)
    across = min(ACROSS, len(panels))
    down = -(-len(panels) // across)
    width, height = across * PANEL + LEFT, down * (PANEL + 14) + 40
    with drawing():
        figure = canvas(width, height)
        for index, panel in enumerate(panels):
            row, column = divmod(index, across)
            axes = figure.add_axes(
                (
                    (LEFT + column * PANEL) / width,
                    1 - (20 + row * (PANEL + 14) + PANEL - 26) / height,
                    (PANEL - 18) / width,
                    (PANEL - 26) / height,
                )
            )
            plain(axes)
            axes.plot(ends, ends, color=INK, linewidth=0.8)
            axes.scatter(
                panel.truth, np.clip(panel.mean, *ends), s=3, color=ACCENT, alpha=0.35,
                linewidths=0, rasterized=True,
            )  # fmt: skip
            axes.set_xlim(ends)
            axes.set_ylim(ends)
            axes.set_title(panel.title, fontsize=10, loc="left", pad=4)
            if column:
                axes.set_yticklabels([])
            if row < down - 1 and index + across < len(panels):
                axes.set_xticklabels([])
        figure.text(0.5, 6 / height, f"{label}, simulated", ha="center", fontsize=10)
        figure.text(
            10 / width,
            0.5,
            f"{label}, predicted",
            va="center",
            ha="center",
            rotation=90,
            fontsize=10,
        )
        return inline_svg(figure, name, alt)
