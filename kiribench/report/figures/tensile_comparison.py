"""A measured and a simulated pull in one drawing: Poisson's ratio, their difference, the force."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiribench.reference.tensile import TensileComparison
from kiribench.report.figures.cv_style import COLOURS, plain
from kiribench.report.html import Html
from kiribench.report.palette import INK, LINE, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

MEASURED, SIMULATED = COLOURS[0], COLOURS[1]


def poisson_figure(found: TensileComparison, *, name: str = "tensile-poisson") -> Html:
    """Poisson's ratio over strain, and below it measured less simulated with its interval."""
    with drawing():
        figure = canvas(700, 470)
        top: Any = figure.add_axes((0.095, 0.42, 0.87, 0.54))
        below: Any = figure.add_axes((0.095, 0.105, 0.87, 0.24))
        plain(top)
        plain(below)
        sd = np.nan_to_num(found.poisson_cells_sd)
        top.fill_between(
            found.strain, found.poisson - sd, found.poisson + sd, color=MEASURED, alpha=0.2,
            linewidth=0, label="sd over cells",
        )  # fmt: skip
        top.plot(
            found.strain, found.poisson, color=MEASURED, marker="o", markersize=3.5,
            linewidth=1.6, label="measured",
        )  # fmt: skip
        shown = found.curve_strain <= found.strain.max() * 1.03
        top.plot(
            found.curve_strain[shown], found.curve_poisson[shown], color=SIMULATED,
            linestyle=(0, (6, 2)), linewidth=1.6, label="simulated",
        )  # fmt: skip
        top.set_ylabel("Poisson's ratio")
        top.legend(frameon=False, fontsize=9)
        limits = (0.0, float(found.strain.max()) * 1.03)
        top.set_xlim(*limits)
        below.axhline(0, color=QUIET, linewidth=0.8)
        mesh = np.abs(found.mesh_poisson)
        below.fill_between(
            found.strain, -mesh, mesh, color=LINE, alpha=0.8, linewidth=0, label="mesh"
        )
        half = np.nan_to_num(found.half_width)
        below.errorbar(
            found.strain, found.difference, yerr=half, color=INK, fmt="o", markersize=3.5,
            elinewidth=1, capsize=2,
        )  # fmt: skip
        below.set_xlim(*limits)
        below.set_xlabel(f"longitudinal strain ({found.measure})")
        below.set_ylabel("difference")
        return inline_svg(
            figure,
            name,
            f"Poisson's ratio of {len(found.strain)} frames, measured and simulated; "
            f"{found.distance.value:.4f} rms apart without scatter",
        )


def load_figure(found: TensileComparison, *, name: str = "tensile-load") -> Html | None:
    """Force, and strain over displacement; None where neither is known."""
    panels: list[tuple[Any, Any, Any, str, str]] = []
    travel = found.displacement_mm
    if found.force_n is not None:
        over = found.strain if travel is None else travel
        label = f"strain ({found.measure})" if travel is None else "displacement, mm"
        panels.append((over, found.force_n, found.force_simulated_n, label, "force, N"))
    if travel is not None and found.strain_simulated is not None:
        panels.append(
            (
                travel,
                found.strain,
                found.strain_simulated,
                "displacement, mm",
                f"strain of the cells ({found.measure})",
            )
        )
    if not panels:
        return None
    with drawing():
        figure = canvas(700, 270)
        for k, (over, measured, simulated, across, up) in enumerate(panels):
            axes: Any = figure.add_axes((0.095 + 0.5 * k, 0.18, 0.37, 0.76))
            plain(axes)
            axes.plot(
                over, measured, color=MEASURED, marker="o", markersize=3.5, linewidth=1.4,
                label="measured",
            )  # fmt: skip
            axes.plot(
                over, simulated, color=SIMULATED, linestyle=(0, (6, 2)), linewidth=1.6,
                label="simulated",
            )  # fmt: skip
            axes.set_xlim(0, None)
            axes.set_ylim(0, None)
            axes.set_xlabel(across)
            axes.set_ylabel(up)
            if k == 0:
                axes.legend(frameon=False, fontsize=9)
        return inline_svg(figure, name, "Force and strain over displacement")
