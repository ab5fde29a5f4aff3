"""Where a model errs: residuals over (a, b) and over strain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.cv_style import plain, plain_numbers
from kiribench.report.html import Html
from kiribench.report.palette import ACCENT, QUIET, SEQUENTIAL
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
SPARSE = 4  # more places of the lattice than that for each design: no lattice
WIDTH, HEIGHT = 780.0, 320.0


def residual_figure(
    X: FloatArray, residual: FloatArray, *, unit: float | None, name: str, alt: str
) -> Html:
    """RMS residual of each design as a map over (a, b), and all residuals over strain.

    Args:
        X: (q, 3) a_percent, b_percent, strain of test rows.
        residual: (q,) predicted minus simulated.
        unit: the table's mesh error, drawn as a band, if there is one.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    cuts, which = np.unique(X[:, :2], axis=0, return_inverse=True)
    which = which.ravel()
    rms = np.sqrt(np.bincount(which, residual**2) / np.bincount(which))
    low = max(float(np.quantile(rms, 0.02)), 1e-9)
    high = max(float(rms.max()), low * 1.01)
    scale = LinearSegmentedColormap.from_list("errors", (*SEQUENTIAL, "#0d2740"), N=256)
    with drawing():
        figure = canvas(WIDTH, HEIGHT)
        left = figure.add_axes((50 / WIDTH, 46 / HEIGHT, 250 / WIDTH, 250 / HEIGHT))
        plain(left)
        drawn = _map(left, cuts, rms, cmap=scale, norm=LogNorm(low, high))
        left.set_xlabel("a, %")
        left.set_ylabel("b, %")
        left.set_title("rms residual of each design", fontsize=10, loc="left", pad=5)
        bar = figure.add_axes((312 / WIDTH, 46 / HEIGHT, 10 / WIDTH, 250 / HEIGHT))
        beside = figure.colorbar(drawn, cax=bar).ax
        beside.tick_params(labelsize=8, colors=QUIET)
        plain_numbers(beside.yaxis, each=(1.0, 2.0, 5.0))
        right = figure.add_axes((430 / WIDTH, 46 / HEIGHT, 330 / WIDTH, 250 / HEIGHT))
        plain(right)
        if unit is not None:
            right.axhspan(-unit, unit, color="#f3c9a5", alpha=0.5, linewidth=0)
        right.scatter(
            X[:, 2], residual, s=3, color=ACCENT, alpha=0.35, linewidths=0, rasterized=True
        )
        right.set_xlabel("longitudinal strain")
        right.set_title("predicted minus simulated", fontsize=10, loc="left", pad=5)
        return inline_svg(figure, name, alt)


def _map(axes: Axes, cuts: FloatArray, rms: FloatArray, **colours: Any) -> Any:
    """A tile a design, bounded half-way to the next levels; dots where designs are no lattice."""
    (a, in_a), (b, in_b) = (np.unique(cuts[:, c], return_inverse=True) for c in (0, 1))
    if len(a) * len(b) > SPARSE * len(cuts):
        return axes.scatter(cuts[:, 0], cuts[:, 1], c=rms, s=12, linewidths=0, **colours)
    tiles = np.full((len(b), len(a)), np.nan)
    tiles[in_b.ravel(), in_a.ravel()] = rms
    return axes.pcolormesh(_bounds(a), _bounds(b), tiles, **colours)


def _bounds(levels: FloatArray) -> FloatArray:
    if len(levels) == 1:
        return np.array([levels[0] - 1.0, levels[0] + 1.0])
    half = 0.5 * np.diff(levels)
    return np.concatenate([[levels[0] - half[0]], levels[:-1] + half, [levels[-1] + half[-1]]])
