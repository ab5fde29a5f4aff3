"""The flexed skin from the front with the patch cells on it: the 3-D view without scripts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kiribench.report.html import Html
from kiribench.report.palette import GRADE_FILL, GRADE_INK, GRADE_LETTER, QUIET, SKIN
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

WIDTH = 460.0
HEADROOM = 18.0
LIGHT = np.array([-0.35, 0.5, 0.8]) / np.linalg.norm([-0.35, 0.5, 0.8])


def surface_view(
    vertices_mm: NDArray[np.float64],
    faces: NDArray[np.int32],
    skin_mm: NDArray[np.float64],
    patch_mm: NDArray[np.float64],
    grades: NDArray[np.str_],
    *,
    name: str = "surface",
    alt: str,
) -> Html:
    """Shaded skin, skin cells as thin lines, patch cells filled by grade with their letter.

    Args:
        vertices_mm, faces: decimated skin in the front view's frame (right, up, viewer).
        skin_mm, patch_mm: (R, C, n, 3) outlines in the same frame; NaN where not scored.
        grades: (R, C) grade, or empty.
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    span = vertices_mm[:, :2].max(axis=0) - vertices_mm[:, :2].min(axis=0)
    middle = 0.5 * (vertices_mm[:, :2].max(axis=0) + vertices_mm[:, :2].min(axis=0))
    height = float(np.clip(WIDTH * span[1] / span[0], 200, 640))
    scale = max(span[0] / WIDTH, span[1] / height) * 1.02
    with drawing():
        figure = canvas(WIDTH, height + HEADROOM)
        axes = figure.add_axes((0, 0, 1, height / (height + HEADROOM)))
        axes.set_axis_off()
        axes.set_xlim(middle[0] - scale * WIDTH / 2, middle[0] + scale * WIDTH / 2)
        axes.set_ylim(middle[1] - scale * height / 2, middle[1] + scale * height / 2)
        _skin(axes, vertices_mm, faces)
        for row, column in np.ndindex(*grades.shape):
            if grades[row, column]:
                _cell(axes, skin_mm[row, column], patch_mm[row, column], str(grades[row, column]))
        axes.text(
            0.5, 1.005, "proximal ↑", transform=axes.transAxes, ha="center", va="bottom",
            fontsize=10, color=QUIET,
        )  # fmt: skip
        return inline_svg(figure, name, alt)


def _skin(axes: Axes, vertices_mm: NDArray[np.float64], faces: NDArray[np.int32]) -> None:
    from matplotlib.collections import PolyCollection

    corners = vertices_mm[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    keep = length > 0
    corners, normal = corners[keep], normal[keep] / length[keep, None]
    order = np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")
    shade = 0.42 + 0.58 * np.clip(np.abs(normal @ LIGHT), 0, 1)
    colour = shade[order, None] * np.array([0.93, 0.90, 0.87])
    axes.add_collection(
        PolyCollection(
            corners[order][:, :, :2], facecolors=colour, edgecolors=colour, linewidths=0.6,
            rasterized=True,
        )
    )  # fmt: skip


def _cell(axes: Axes, skin: NDArray[np.float64], patch: NDArray[np.float64], grade: str) -> None:
    from matplotlib.patches import Polygon

    if _turned_away(patch):
        return
    axes.add_patch(
        Polygon(
            patch[:, :2], closed=True, facecolor=GRADE_FILL[grade], alpha=0.82, edgecolor="#ffffff",
            linewidth=1.2,
        )
    )  # fmt: skip
    axes.add_patch(Polygon(skin[:, :2], closed=True, fill=False, edgecolor=SKIN, linewidth=0.8))
    x, y = patch[:, :2].mean(axis=0)
    axes.text(
        x, y, GRADE_LETTER[grade], ha="center", va="center", fontsize=10, weight="bold",
        color=GRADE_INK[grade],
    )  # fmt: skip


def _turned_away(outline: NDArray[np.float64]) -> bool:
    """Whether a cell is seen so flat that its drawing would mislead (below 10 degrees)."""
    centred = outline - outline.mean(axis=0)
    area = 0.5 * np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    return bool(abs(area[2]) < np.sin(np.radians(10)) * np.linalg.norm(area))
