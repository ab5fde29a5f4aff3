"""A tensile test drawn: Poisson's ratio and force over strain, with bands over cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.cv_style import plain
from kiribench.report.html import Html
from kiribench.report.palette import ACCENT, INK, PATCH, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from kiribench.tensile.result import Curve

FloatArray = NDArray[np.float64]


def poisson_figure(
    curve: Curve, cells: FloatArray, strain: FloatArray, *, name: str = "tensile-poisson"
) -> Html:
    """Poisson's ratio over longitudinal strain: mean, one standard deviation, every cell.

    Args:
        curve: means and deviations. cells: (n, k) Poisson's ratio of the cells. strain: (n, k).
        name: unique on the page.
    """
    with drawing():
        figure = canvas(520, 340)
        axes = figure.add_axes((0.14, 0.15, 0.83, 0.81))
        plain(axes)
        axes.axhline(0.0, color=QUIET, linewidth=0.8)
        axes.plot(
            strain.ravel(),
            cells.ravel(),
            ".",
            color=QUIET,
            markersize=3,
            alpha=0.6,
            label="cells",
        )
        good = np.isfinite(curve.poisson_ratio)
        x, mean = curve.longitudinal_strain[good], curve.poisson_ratio[good]
        sd = np.nan_to_num(curve.poisson_sd[good])
        axes.fill_between(x, mean - sd, mean + sd, color=ACCENT, alpha=0.2, linewidth=0)
        axes.plot(x, mean, "-o", color=ACCENT, markersize=4, linewidth=1.6, label="mean, ± 1 sd")
        axes.set_xlabel(f"longitudinal strain ({curve.measure})")
        axes.set_ylabel(f"Poisson's ratio ({curve.measure})")
        axes.legend(frameon=False, fontsize=9)
        return inline_svg(figure, name, "Poisson's ratio of the cells over longitudinal strain")


def force_figure(curve: Curve, force_n: FloatArray, *, name: str = "tensile-force") -> Html:
    """Force over the mean longitudinal strain of the cells."""
    with drawing():
        figure = canvas(520, 300)
        axes = figure.add_axes((0.14, 0.17, 0.83, 0.79))
        plain(axes)
        good = np.isfinite(force_n) & np.isfinite(curve.longitudinal_strain)
        axes.plot(
            curve.longitudinal_strain[good],
            force_n[good],
            "-o",
            color=PATCH,
            markersize=4,
            linewidth=1.6,
        )
        axes.set_xlabel(f"longitudinal strain of the cells ({curve.measure})")
        axes.set_ylabel("force, N")
        return inline_svg(figure, name, "Force over longitudinal strain")


def strain_figure(curve: Curve, *, name: str = "tensile-strain") -> Html:
    """Longitudinal and lateral strain frame by frame."""
    with drawing():
        figure = canvas(520, 300)
        axes = figure.add_axes((0.14, 0.17, 0.83, 0.79))
        plain(axes)
        frames = np.arange(len(curve.longitudinal_strain))
        for values, sd, colour, shape, word in (
            (curve.longitudinal_strain, curve.longitudinal_sd, ACCENT, "o", "longitudinal"),
            (curve.lateral_strain, curve.lateral_sd, PATCH, "s", "lateral"),
        ):
            good = np.isfinite(values)
            low, high = values - np.nan_to_num(sd), values + np.nan_to_num(sd)
            axes.fill_between(frames[good], low[good], high[good], color=colour, alpha=0.2, lw=0)
            axes.plot(
                frames[good],
                values[good],
                "-" + shape,
                color=colour,
                markersize=4,
                linewidth=1.6,
                label=word,
            )
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_xlabel("frame")
        axes.set_ylabel(f"strain ({curve.measure})")
        from matplotlib.ticker import MaxNLocator

        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(frameon=False, fontsize=9)
        return inline_svg(figure, name, "Strains of the cells frame by frame")
