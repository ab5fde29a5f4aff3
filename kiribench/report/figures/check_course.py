"""The course of a worn design: how far the corners are from their nodes, step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kiribench.report.html import Html
from kiribench.report.palette import ACCENT, INK, LINE, PATCH, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

WIDTH, HEIGHT = 560.0, 300.0
TICKS = tuple(digit * 10.0**power for power in range(-6, 3) for digit in (1, 2, 5))


def course_figure(iterations: Sequence[Mapping[str, Any]], *, name: str, method: str) -> Html:
    """rms and largest distance over the steps, on a logarithmic scale.

    Args:
        iterations: with ``Elements``, ``RmsMm``, ``WorstMm`` of each state.
        name, method: see :func:`kiribench.report.svg.inline_svg`.
    """
    last = iterations[-1]
    with drawing():
        figure = canvas(WIDTH, HEIGHT)
        axes = figure.add_axes((0.1, 0.16, 0.72, 0.76))
        axes.set_yscale("log")
        levels: list[list[int]] = []
        for index, one in enumerate(iterations):
            if not levels or one["Elements"] != iterations[levels[-1][-1]]["Elements"]:
                levels.append([])
            levels[-1].append(index)
        for level in levels:
            for key, colour in (("WorstMm", PATCH), ("RmsMm", ACCENT)):
                values = [max(float(iterations[i][key]), 1e-6) for i in level]
                axes.plot(level, values, color=colour, marker="o", markersize=4, linewidth=1.6)
            if level[0]:
                axes.axvline(level[0] - 0.5, color=LINE, linewidth=1)
            axes.text(
                level[0], 1.01, f"{iterations[level[0]]['Elements']} elements",
                transform=axes.get_xaxis_transform(), fontsize=9, color=QUIET, ha="left",
                va="bottom",
            )  # fmt: skip
        for key, words, colour in (("WorstMm", "largest", PATCH), ("RmsMm", "rms", ACCENT)):
            axes.annotate(
                words, (len(iterations) - 1, max(float(last[key]), 1e-6)), xytext=(8, 0),
                textcoords="offset points", color=colour, va="center", fontsize=10,
            )  # fmt: skip
        axes.set_xlabel("state")
        axes.set_ylabel("distance, mm")
        axes.set_xticks(range(len(iterations)))
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        axes.tick_params(colors=INK, labelsize=9)
        axes.minorticks_off()
        low, high = axes.get_ylim()
        shown = [tick for tick in TICKS if low <= tick <= high]
        axes.set_yticks(shown, [f"{tick:g}" for tick in shown])
        return inline_svg(
            figure,
            name,
            f"Course of {method}: rms distance from {iterations[0]['RmsMm']:.2f} mm to "
            f"{last['RmsMm']:.2f} mm in {len(iterations)} states.",
        )
