"""One cell close up: the skin cell, the patch cell on it, and what each cause alone costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kiribench.report.html import Html
from kiribench.report.palette import INK, LINE, OVERLAP, PATCH, QUIET, SKIN
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

WIDTH = 300.0
OUTLINE_HEIGHT = 250.0
BAR_HEIGHT = 21.0


def outline_card(
    skin_mm: NDArray[np.float64],
    patch_mm: NDArray[np.float64],
    causes: Sequence[tuple[str, float]],
    *,
    half_mm: float,
    cost_limit: float,
    mirrored: bool,
    name: str,
    alt: str,
) -> Html:
    """Outlines of one cell above the bars of its causes.

    Args:
        skin_mm, patch_mm: (n, 2) outlines, (longitudinal distal, lateral medial) from the
            centre of the skin cell.
        causes: label with its amount -> overlap that this part alone would cost.
        half_mm: half the width of the drawing; the same for all cells that are compared.
        cost_limit: end of the bars' scale; the same for all cells that are compared.
        mirrored: medial at the left (a left leg seen from the front).
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    bars = BAR_HEIGHT * len(causes)
    height = OUTLINE_HEIGHT + 40 + bars
    with drawing():
        figure = canvas(WIDTH, height)
        axes = figure.add_axes((0, 1 - OUTLINE_HEIGHT / height, 1, OUTLINE_HEIGHT / height))
        _outlines(axes, skin_mm, patch_mm, half_mm, mirrored)
        lower = figure.add_axes((0, 0, 1, (bars + 36) / height))
        _bars(lower, causes, cost_limit, bars + 36)
        return inline_svg(figure, name, alt)


def _outlines(
    axes: Axes,
    skin_mm: NDArray[np.float64],
    patch_mm: NDArray[np.float64],
    half_mm: float,
    mirrored: bool,
) -> None:
    from matplotlib.patches import Polygon
    from shapely.geometry import Polygon as Outline

    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-half_mm * WIDTH / OUTLINE_HEIGHT, half_mm * WIDTH / OUTLINE_HEIGHT)
    axes.set_ylim(half_mm, -half_mm)

    def page(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack([-points[:, 1] if mirrored else points[:, 1], points[:, 0]])

    skin, patch = page(skin_mm), page(patch_mm)
    common = Outline(skin).buffer(0).intersection(Outline(patch).buffer(0))
    for part in getattr(common, "geoms", [common]):
        if part.geom_type == "Polygon" and not part.is_empty:
            axes.add_patch(
                Polygon(np.asarray(part.exterior.coords), facecolor=OVERLAP, linewidth=0)
            )
    axes.add_patch(Polygon(skin, closed=True, fill=False, edgecolor=SKIN, linewidth=2.2))
    axes.add_patch(
        Polygon(
            patch, closed=True, fill=False, edgecolor=PATCH, linewidth=2.2, linestyle=(0, (5, 2.2))
        )
    )
    centre = patch.mean(axis=0) - skin.mean(axis=0)
    if np.hypot(*centre) > 0.02 * half_mm:
        axes.annotate(
            "", xy=tuple(patch.mean(axis=0)), xytext=tuple(skin.mean(axis=0)),
            arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.2, "shrinkA": 0,
                        "shrinkB": 0, "mutation_scale": 9},
        )  # fmt: skip
    x = -half_mm * WIDTH / OUTLINE_HEIGHT * 0.94
    y = half_mm * 0.93
    bar = 5.0 if half_mm > 5 else 1.0
    axes.plot((x, x + bar), (y, y), color=INK, linewidth=1.6, solid_capstyle="butt")
    axes.text(x, y - 0.045 * half_mm, f"{bar:g} mm", ha="left", va="bottom", fontsize=10)


def _bars(
    axes: Axes, causes: Sequence[tuple[str, float]], cost_limit: float, height: float
) -> None:
    from matplotlib.patches import Rectangle

    axes.set_axis_off()
    axes.set_xlim(0, WIDTH)
    axes.set_ylim(height, 0)
    left, right = 148.0, WIDTH - 34.0
    axes.text(8, 10, "cause, and the overlap it alone costs", fontsize=10, color=QUIET, va="center")
    largest = max((cost for _, cost in causes), default=0.0)
    for index, (label, cost) in enumerate(causes):
        y = 32 + BAR_HEIGHT * index
        strong = cost == largest and cost > 0
        weight = "bold" if strong else "normal"
        axes.text(left - 8, y, label, ha="right", va="center", fontsize=10.5, weight=weight)
        axes.plot((left, left), (y - 9, y + 9), color=LINE, linewidth=1)
        length = (right - left) * min(max(cost, 0.0) / cost_limit, 1.0)
        axes.add_patch(
            Rectangle((left, y - 6), length, 12, facecolor=PATCH if strong else QUIET, linewidth=0)
        )
        axes.text(
            left + length + 5, y, f"{max(cost, 0.0):.2f}", ha="left", va="center", fontsize=10,
            weight=weight,
        )  # fmt: skip
