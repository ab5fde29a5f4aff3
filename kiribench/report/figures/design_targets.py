"""The targets of a patch among what the cuts can do, and what a search for them does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.design_space import colours, nu_limit
from kiribench.report.html import Html
from kiribench.report.palette import ACCENT, INK, LINE, PATCH, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]


def targets_figure(
    curves: Sequence[tuple[FloatArray, FloatArray]],
    band: tuple[FloatArray, FloatArray, FloatArray],
    strain: FloatArray,
    nu: FloatArray,
    beyond: NDArray[np.bool_],
    measure: str,
    *,
    name: str = "targets",
) -> Html:
    """Targets as stars over the surrogate's curves: the paper's figure.

    Args:
        curves: strain and Poisson's ratio of some cut patterns.
        band: strains, smallest and largest Poisson's ratio of any allowed cuts.
        strain, nu: (n,) the targets.
        beyond: (n,) which of them are out of reach.
        measure: of all strains.
        name: unique on the page.
    """
    with drawing():
        figure = canvas(640, 400)
        axes = figure.add_axes((0.1, 0.13, 0.87, 0.79))
        axes.fill_between(*band, color="#eef3f7", linewidth=0, label="within reach")
        for x, y in curves:
            axes.plot(x, y, color="#9aa9b5", linewidth=0.6)
        axes.scatter(
            strain[~beyond], nu[~beyond], marker="*", s=64, color=PATCH, edgecolors="#ffffff",
            linewidths=0.4, zorder=3, label="target",
        )  # fmt: skip
        if beyond.any():
            axes.scatter(
                strain[beyond], nu[beyond], marker="*", s=90, facecolors="none", edgecolors=INK,
                linewidths=1.1, zorder=4, label="target out of reach",
            )  # fmt: skip
        axes.axhline(0, color=QUIET, linewidth=0.6)
        right = max(1.15 * float(strain.max()), 0.3)
        inside = (band[0] >= 0) & (band[0] <= right)
        low = min(float(nu.min()), float(band[1][inside].min(initial=0.0)))
        high = max(float(nu.max()), float(band[2][inside].max(initial=0.5)))
        axes.set_xlim(0, right)
        axes.set_ylim(low - 0.08, high + 0.08)
        axes.set_xlabel(f"longitudinal strain ({measure})")
        axes.set_ylabel(f"Poisson's ratio ν ({measure})")
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=9, frameon=False
        )  # above the axes: anywhere within it hides a star of some patch
        _plain(axes)
        return inline_svg(
            figure, name, f"{len(nu)} targets over the curves of {len(curves)} cut patterns"
        )


def generations_figure(
    populations: FloatArray,
    best: FloatArray,
    field: tuple[FloatArray, FloatArray],
    target: float,
    high: float,
    title: str,
    *,
    name: str = "generations",
) -> Html:
    """What CMA-ES tried in one cell, and how the objective of all cells fell.

    Args:
        populations: (g, p, 2) a, b of the cell, fractions; NaN after it has stopped.
        best: (g, n) smallest objective so far of every cell.
        field: ticks (A,) and Poisson's ratio (A, A) over a and b.
        target: Poisson's ratio asked for.
        high: longest cut.
        title: of the cell.
        name: unique on the page.
    """
    count = int(np.isfinite(populations[:, 0, 0]).sum())
    shown = sorted({0, *(min(count - 1, g) for g in (4, 9, 25)), count - 1})
    with drawing():
        figure = canvas(700, 320)
        axes = figure.add_axes((0.07, 0.15, 0.37, 0.75))
        _field(axes, field, target, high)
        shades = [INK, "#5b3a8c", ACCENT, PATCH, "#b3001b"]
        for generation, shade in zip(shown, shades[-len(shown) :], strict=True):
            points = 100 * populations[generation]
            axes.scatter(
                points[:, 0], points[:, 1], s=16, color=shade, edgecolors="#ffffff",
                linewidths=0.4, label=f"generation {generation + 1}", zorder=3 + generation / 1000,
            )  # fmt: skip
        axes.legend(fontsize=8, loc="upper left", framealpha=0.9, edgecolor=LINE)
        axes.set_title(title, fontsize=10)
        other = figure.add_axes((0.55, 0.15, 0.43, 0.75))
        steps = np.arange(1, len(best) + 1)
        other.semilogy(steps, best, color="#b8c4cd", linewidth=0.5)
        other.semilogy(steps, np.median(best, axis=1), color=PATCH, linewidth=1.6, label="median")
        other.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        other.yaxis.set_minor_formatter(lambda value, _: "")
        other.set_xlabel("generation")
        other.set_ylabel("objective, best so far")
        other.legend(fontsize=9, frameon=False)
        _plain(other)
        return inline_svg(figure, name, f"CMA-ES over {count} generations; {title}")


def equivalent_figure(
    cells: Sequence[tuple[str, tuple[FloatArray, FloatArray], Sequence[FloatArray], FloatArray]],
    high: float,
    *,
    name: str = "equivalent",
) -> Html:
    """All designs of a cell that have the target's Poisson's ratio, and the one that was chosen.

    Args:
        cells: title, field (ticks, values), curve pieces (k, 2) and chosen (2,), each in
            fractions of the cell edge.
        high: longest cut.
        name: unique on the page.
    """
    side, gap, left = 190.0, 34.0, 46.0
    width, height = left + len(cells) * (side + gap), side + 76.0
    with drawing():
        figure = canvas(width, height)
        for k, (title, field, pieces, chosen) in enumerate(cells):
            axes = figure.add_axes(
                ((left + k * (side + gap)) / width, 44 / height, side / width, side / height)
            )
            _field(axes, field, None, high)
            for piece in pieces:
                axes.plot(100 * piece[:, 0], 100 * piece[:, 1], color=INK, linewidth=1.6)
            radius = 100 * float(np.hypot(*chosen))
            angle = np.linspace(0, np.pi / 2, 60)
            axes.plot(
                radius * np.cos(angle), radius * np.sin(angle), color=QUIET, linewidth=0.8,
                linestyle=(0, (4, 3)),
            )  # fmt: skip
            axes.plot(
                *(100 * chosen), marker="*", markersize=13, color=PATCH, markeredgecolor="#ffffff",
                clip_on=False, zorder=5,
            )  # fmt: skip
            axes.set_title(title, fontsize=9.5)
            if k:
                axes.set_ylabel("")
        return inline_svg(
            figure, name, "Curves of equivalent designs: " + "; ".join(title for title, *_ in cells)
        )


def mixing_figure(
    right: tuple[FloatArray, FloatArray],
    wrong: tuple[FloatArray, FloatArray],
    target: FloatArray,
    error: FloatArray,
    right_error: FloatArray,
    words: str,
    *,
    name: str = "mixing",
) -> Html:
    """What reading the targets in the wrong strain measure does to the cuts and to ν.

    Args:
        right, wrong: (n,) a and b without and with the mistake, fractions.
        target: (n,) Poisson's ratio asked for.
        error, right_error: (n,) true Poisson's ratio minus target with and without it.
        words: which measures are mixed.
        name: unique on the page.
    """
    with drawing():
        figure = canvas(700, 300)
        axes = figure.add_axes((0.08, 0.16, 0.37, 0.74))
        for x0, y0, x1, y1 in zip(*(100 * part for part in (*right, *wrong)), strict=True):
            axes.plot([x0, x1], [y0, y1], color="#b8c4cd", linewidth=0.7, zorder=1)
        axes.scatter(100 * right[0], 100 * right[1], s=14, color=ACCENT, label="right", zorder=2)
        axes.scatter(
            100 * wrong[0], 100 * wrong[1], s=14, color=PATCH, marker="D", label="mixed", zorder=2
        )
        axes.set_xlabel("a, %")
        axes.set_ylabel("b, %")
        axes.legend(fontsize=9, edgecolor=LINE)
        _plain(axes)
        other = figure.add_axes((0.57, 0.16, 0.41, 0.74))
        other.axhline(0, color=QUIET, linewidth=0.6)
        other.scatter(target, right_error, s=14, color=ACCENT, label="right")
        other.scatter(target, error, s=14, color=PATCH, marker="D", label="mixed")
        other.set_xlabel("target ν")
        other.set_ylabel("true minus target ν")
        other.set_title(words, fontsize=9.5)
        _plain(other)
        return inline_svg(figure, name, f"Cuts and errors where strain measures are mixed: {words}")


def _field(
    axes: Axes, field: tuple[FloatArray, FloatArray], target: float | None, high: float
) -> None:
    ticks, values = field
    limit = nu_limit(values)
    axes.contourf(
        100 * ticks, 100 * ticks, values.T, levels=np.linspace(-limit, limit, 25), cmap=colours(),
        alpha=0.75,
    )  # fmt: skip
    if target is not None and values.min() < target < values.max():
        axes.contour(
            100 * ticks, 100 * ticks, values.T, levels=[target], colors=[INK],
            linewidths=1.2, linestyles="solid",
        )  # fmt: skip
    axes.set_xlim(0, 100 * high)
    axes.set_ylim(0, 100 * high)
    axes.set_aspect("equal")
    axes.set_xlabel("a, %")
    axes.set_ylabel("b, %")
    axes.tick_params(labelsize=9, colors=QUIET)


def _plain(axes: Axes) -> None:
    axes.grid(color=LINE, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9, colors=QUIET)
