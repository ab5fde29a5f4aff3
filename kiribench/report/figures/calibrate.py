"""A tension test and its fits: the curve, the errors, and a modulus by range."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiribench.calibration.laws import bar_stress
from kiribench.calibration.study import Study
from kiribench.report.figures.cv_style import mark_of, plain
from kiribench.report.html import Html
from kiribench.report.palette import INK, LINE, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

_STYLES = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1.5, 2)), (0, (1, 1)))


def curve_figure(found: Study, *, name: str = "tension") -> Html:
    """Nominal stress over engineering strain, left up to the fit's end, right all of the test."""
    curve, high = found.curve, found.fits[0].range.high
    with drawing():
        figure = canvas(700, 310)
        for k, end in enumerate((min(high * 1.15, curve.strain[-1]), curve.strain[-1])):
            axes: Any = figure.add_axes((0.075 + 0.485 * k, 0.16, 0.405, 0.72))
            plain(axes)
            seen = curve.strain <= end
            axes.axvspan(found.fits[0].range.low, high, color=LINE, alpha=0.35, linewidth=0)
            axes.plot(
                curve.strain[seen], curve.stress_mpa[seen], "o", color=INK, markersize=2.4,
                markeredgewidth=0, label="test", zorder=3,
            )  # fmt: skip
            strain = np.linspace(1e-3, end, 300)
            for j, fit in enumerate(found.fits):
                axes.plot(
                    strain, bar_stress(fit.law, 1 + strain), linestyle=_STYLES[j % 5],
                    color=mark_of(j)[0], linewidth=1.6, label=fit.name,
                )  # fmt: skip
            axes.set_xlim(0, end)
            top = float(curve.stress_mpa[seen].max())
            axes.set_ylim(0, top * 1.12)
            axes.set_xlabel("engineering strain")
            axes.set_ylabel("nominal stress, MPa")
            axes.set_title(
                "where it was fitted" if k == 0 else "whole test", fontsize=10.5, color=INK, pad=6
            )
            if k == 0:
                axes.legend(frameon=False, fontsize=9, loc="upper left")
        return inline_svg(
            figure,
            name,
            f"Tension test of {len(curve.stretch)} rows and {len(found.fits)} fitted laws",
        )


def error_figure(found: Study, *, name: str = "tension-errors") -> Html:
    """Relative error of the stress, law by law, and of the modulus that was given."""
    curve = found.curve
    end = min(2 * found.fits[0].range.high, float(curve.strain[-1]))
    seen = curve.strain <= end
    with drawing():
        figure = canvas(700, 280)
        axes: Any = figure.add_axes((0.085, 0.17, 0.62, 0.76))
        plain(axes)
        axes.axvspan(
            found.fits[0].range.low, found.fits[0].range.high, color=LINE, alpha=0.35, linewidth=0
        )
        axes.axhline(0, color=QUIET, linewidth=0.8)
        for j, fit in enumerate(found.fits):
            error = bar_stress(fit.law, curve.stretch[seen]) / curve.stress_mpa[seen] - 1
            axes.plot(
                curve.strain[seen], 100 * error, linestyle=_STYLES[j % 5], color=mark_of(j)[0],
                linewidth=1.6, label=fit.name,
            )  # fmt: skip
        from kiribench.fem.material import NeoHookean

        given = bar_stress(NeoHookean(found.given.mu_mpa), curve.stretch[seen])
        axes.plot(
            curve.strain[seen], 100 * (given / curve.stress_mpa[seen] - 1), color=INK,
            linewidth=1.1, label=f"neo-Hookean, {found.given.mu_mpa:g} MPa (given)",
        )  # fmt: skip
        axes.set_xlim(0, end)
        axes.set_ylim(-50, 110)
        axes.set_xlabel("engineering strain")
        axes.set_ylabel("error of the stress, %")
        axes.legend(
            frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=(1.01, 1.0),
            borderaxespad=0,
        )  # fmt: skip
        return inline_svg(figure, name, "Relative error of the stress over the strain, by law")


def choice_figure(found: Study, *, name: str = "choice") -> Html:
    """Force, tip stress and Poisson's ratio of cut cells with each law, over the stretch."""
    with drawing():
        height = 56 + 170 * len(found.pulls)
        figure = canvas(700, height)
        for row, pulls in enumerate(found.pulls):
            for column, (what, label) in enumerate(
                (
                    ("stress_mpa", "nominal stress, MPa"),
                    ("tip_stress_mpa", "tip stress, MPa"),
                    ("poisson", "Poisson's ratio (log)"),
                )
            ):
                axes: Any = figure.add_axes(
                    (
                        0.085 + 0.325 * column,
                        1 - (24 + 170 * (row + 1) - 44) / height,
                        0.235,
                        118 / height,
                    )
                )
                plain(axes)
                for j, pull in enumerate(pulls):
                    colour, shape = (INK, "o") if j == 0 else mark_of(j - 1)
                    axes.plot(
                        pull.stretch, getattr(pull, what), color=colour, marker=shape,
                        markersize=4, linewidth=1.3, label=law_label(pull.material),
                    )  # fmt: skip
                axes.set_ylabel(label)
                axes.set_title(
                    f"a = {100 * pulls[0].a:g} %, b = {100 * pulls[0].b:g} %", fontsize=9.5,
                    color=QUIET, pad=4,
                )  # fmt: skip
                if row == len(found.pulls) - 1:
                    axes.set_xlabel("stretch")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="lower center", ncols=len(labels), frameon=False, fontsize=9
        )
        return inline_svg(
            figure, name, "Force, tip stress and Poisson's ratio of cut cells with each law"
        )


def law_label(law: Any) -> str:
    """A law in the legend."""
    from kiribench.calibration.study import law_words

    return law_words(law)
