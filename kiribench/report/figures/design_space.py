"""The design space drawn: every simulated state, and slices at one displacement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kiribench.report.html import Html
from kiribench.report.palette import DIVERGING, INK, LINE, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

NU_LIMIT = 1.0
"""The colours are symmetric about nu = 0 and end at this or at the largest value drawn: rotating
squares have nu = -1, slender facets of a cell reach -1.3. No colour stands for two values."""


def nu_limit(nu: FloatArray) -> float:
    """Where the colours end for these values of Poisson's ratio: at 1, or at the next tenth."""
    largest = float(np.max(np.abs(nu), initial=0.0))
    return max(NU_LIMIT, float(np.ceil(10 * largest - 1e-9)) / 10)


def colours() -> Colormap:
    """Blue: widens when pulled (auxetic). Brown: narrows."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("poisson", list(DIVERGING))


def scatter_figure(
    strain: FloatArray, a: FloatArray, b: FloatArray, nu: FloatArray, *, name: str = "design-space"
) -> Html:
    """All states as the paper draws them: strain, a and b in space, Poisson's ratio as colour.

    Args:
        strain: (n,) longitudinal strain, log.
        a, b: (n,) cut lengths, percent.
        nu: (n,) Poisson's ratio, log.
        name: unique on the page.
    """
    with drawing():
        figure = canvas(640, 500)
        axes: Any = figure.add_axes((0.0, 0.02, 0.84, 0.98), projection="3d")
        order = np.argsort(strain)  # the nearer ones last
        limit = nu_limit(nu)
        axes.scatter(
            strain[order], a[order], b[order], c=nu[order], cmap=colours(), vmin=-limit,
            vmax=limit, s=7, linewidths=0, alpha=0.9, depthshade=False, rasterized=True,
        )  # fmt: skip
        axes.set_xlabel("longitudinal strain (log)", labelpad=6)
        axes.set_ylabel("a, %", labelpad=4)
        axes.set_zlabel("b, %", labelpad=0)
        axes.set_xlim(0, float(strain.max()) * 1.02)
        axes.set_ylim(0, 100)
        axes.set_zlim(0, 100)
        axes.view_init(elev=20, azim=-128)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.pane.set_facecolor("#f7f8f9")
            axis.pane.set_edgecolor(LINE)
            axis._axinfo["grid"].update(color=LINE, linewidth=0.5)
        axes.tick_params(labelsize=9, colors=QUIET)
        _key(figure, (0.88, 0.2, 0.024, 0.6), limit, nu)
        return inline_svg(
            figure,
            name,
            f"{len(nu)} simulated states in the space of strain, a and b; Poisson's ratio from "
            f"{nu.min():.2f} to {nu.max():.2f}",
        )


def slices_figure(
    slices: list[tuple[str, FloatArray, FloatArray, FloatArray]], *, name: str = "slices"
) -> Html:
    """Maps of Poisson's ratio over (a, b), one a load, side by side.

    Args:
        slices: title, a (n,) and b (n,) in percent, nu (n,) in log strain.
        name: unique on the page.
    """
    side, gap, left, top, bottom = 178.0, 18.0, 44.0, 26.0, 46.0
    width = left + len(slices) * (side + gap) + 62
    height = top + side + bottom
    every = np.concatenate([nu for *_, nu in slices])
    limit = nu_limit(every)
    with drawing():
        figure = canvas(width, height)
        for k, (title, a, b, nu) in enumerate(slices):
            axes = figure.add_axes(
                (
                    (left + k * (side + gap)) / width,
                    bottom / height,
                    side / width,
                    side / height,
                )
            )
            _slice(axes, a, b, nu, limit)
            axes.set_title(title, fontsize=10.5, color=INK, pad=6)
            axes.set_xlabel("a, %", labelpad=2)
            if k == 0:
                axes.set_ylabel("b, %", labelpad=2)
            else:
                axes.set_yticklabels([])
        _key(
            figure, ((width - 50) / width, bottom / height, 12 / width, side / height), limit, every
        )
        return inline_svg(
            figure,
            name,
            "Poisson's ratio over a and b; "
            + "; ".join(f"{title}: {nu.min():.2f} to {nu.max():.2f}" for title, _, _, nu in slices),
        )


def _slice(axes: Axes, a: FloatArray, b: FloatArray, nu: FloatArray, limit: float) -> None:
    """One tile a design; its edges lie half-way to the neighbouring levels."""
    across, along = np.unique(a), np.unique(b)
    grid = np.full((len(along), len(across)), np.nan)
    grid[np.searchsorted(along, b), np.searchsorted(across, a)] = nu
    # Near nu = 0 the colours are nearly white: what is not there is hatched.
    axes.patch.set(facecolor="#ffffff", edgecolor=QUIET, hatch="//////")
    axes.pcolormesh(
        _edges(across), _edges(along), grid, cmap=colours(), vmin=-limit, vmax=limit,
        rasterized=True, linewidth=0.15, edgecolors="face",
    )  # fmt: skip
    if min(grid.shape) > 2 and nu.min() < 0 < nu.max():
        known = np.ma.masked_invalid(grid)
        axes.contour(across, along, known, levels=[0.0], colors=[INK], linewidths=1.1)
    axes.tick_params(labelsize=8.5, length=3, colors=QUIET)
    if len(across) > 5:
        axes.set_xticks([0, 25, 50, 75, 100])
        axes.set_yticks([0, 25, 50, 75, 100])
    else:
        axes.set_xticks(across)
        axes.set_yticks(along)


def _edges(levels: FloatArray) -> FloatArray:
    if len(levels) == 1:
        return np.array([levels[0] - 5, levels[0] + 5])
    middle = 0.5 * (levels[:-1] + levels[1:])
    return np.concatenate(
        [[max(0.0, 2 * levels[0] - middle[0])], middle, [min(100.0, 2 * levels[-1] - middle[-1])]]
    )


def _key(
    figure: Figure, place: tuple[float, float, float, float], limit: float, nu: FloatArray
) -> None:
    """The colours, as far as the values go."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    axes = figure.add_axes(place)
    bar = figure.colorbar(ScalarMappable(Normalize(-limit, limit), colours()), cax=axes)
    bar.outline.set_linewidth(0)
    low = min(-0.1, float(np.floor(10 * nu.min() + 1e-9)) / 10)
    high = max(0.1, float(np.ceil(10 * nu.max() - 1e-9)) / 10)
    bar.set_ticks([tick for tick in (-1.5, -1.0, -0.5, 0.0, 0.5, 1.0) if low <= tick <= high])
    axes.set_ylim(low, high)
    axes.tick_params(labelsize=9, length=3, colors=QUIET)
    axes.set_title("ν", fontsize=11, color=INK, pad=6)


def curves_figure(
    curves: list[tuple[str, FloatArray, FloatArray]], *, name: str = "curves"
) -> Html:
    """Poisson's ratio against strain, one line a design, named at its end.

    Args:
        curves: name, strain (n,) and nu (n,), both log.
        name: unique on the page.
    """
    with drawing():
        figure = canvas(560, 340)
        axes = figure.add_axes((0.11, 0.15, 0.74, 0.8))
        axes.set_facecolor("#ffffff")
        axes.axhline(0, color=LINE, linewidth=1)
        shades, limit = colours(), nu_limit(np.concatenate([nu for *_, nu in curves]))
        for _label, strain, nu in curves:
            colour = shades(0.5 + 0.5 * float(nu[0] / limit))
            plain = INK if abs(float(nu[0])) < 0.25 else colour
            axes.plot(strain, nu, color=plain, linewidth=1.8)
        axes.set_xlim(left=0)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high)
        ends = np.array([nu[-1] for *_, nu in curves])
        places = _apart(ends, 0.045 * (high - low))
        for (label, strain, _nu), place in zip(curves, places, strict=True):
            axes.text(
                float(strain[-1]) + 0.012 * axes.get_xlim()[1], float(place), label,
                va="center", fontsize=9.5, color=INK,
            )  # fmt: skip
        axes.set_xlabel("longitudinal strain (log)")
        axes.set_ylabel("ν (log)")
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        axes.tick_params(labelsize=9, colors=QUIET)
        return inline_svg(
            figure,
            name,
            "; ".join(f"{label}: nu {nu[0]:.2f} to {nu[-1]:.2f}" for label, _, nu in curves),
        )


def _apart(values: FloatArray, gap: float) -> FloatArray:
    """(n,) places for labels, near the values and at least ``gap`` apart."""
    order = np.argsort(values)
    places = values[order]
    for _ in range(len(places)):
        for k in range(1, len(places)):
            lack = gap - (places[k] - places[k - 1])
            if lack > 1e-12:
                places[k - 1] -= 0.5 * lack
                places[k] += 0.5 * lack
    result = np.empty_like(places)
    result[order] = places
    return result
