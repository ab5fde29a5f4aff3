"""Deformed sheets with their cuts open: a row of pictures, and a moving one."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from kiribench.fem.shapes import SheetShape
from kiribench.report.html import Html
from kiribench.report.palette import INK, QUIET
from kiribench.report.svg import canvas, drawing, inline_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RUBBER = "#d9a06b"


def sheets_figure(
    shapes: tuple[SheetShape, ...], title: str, *, name: str, height_px: float = 340.0
) -> Html:
    """One sheet at several displacements, side by side and to one scale.

    Args:
        shapes: at least one, of one sheet.
        title: what sheet it is.
        name: unique on the page.
        height_px: of the longest sheet.
    """
    extents = [_extent(shape) for shape in shapes]
    scale = height_px / max(length for _, length in extents)
    gap, top, bottom = 22.0, 30.0, 24.0
    widths = [max(60.0, 2 * half * scale) for half, _ in extents]
    width = sum(widths) + gap * (len(shapes) + 1)
    height = height_px + top + bottom
    with drawing():
        figure = canvas(width, height)
        figure.text(gap / width, 1 - 8 / height, title, fontsize=11, color=INK, ha="left", va="top")
        left = gap
        for shape, (half, length), wide in zip(shapes, extents, widths, strict=True):
            axes = figure.add_axes(
                (left / width, bottom / height, wide / width, length * scale / height)
            )
            axes.set_xlim(-max(half, 30 / scale), max(half, 30 / scale))
            axes.set_ylim(0, length)
            axes.set_axis_off()
            _draw(axes, shape, 0.25)
            figure.text(
                (left + wide / 2) / width, 8 / height, f"U = {shape.displacement_mm:g} mm",
                fontsize=9.5, color=QUIET, ha="center", va="bottom",
            )  # fmt: skip
            left += wide + gap
        steps = ", ".join(f"{shape.displacement_mm:g}" for shape in shapes)
        return inline_svg(figure, name, f"{title} pulled by {steps} mm, cuts open")


def sheet_animation(shapes: tuple[SheetShape, ...], title: str, *, width_px: int = 180) -> bytes:
    """An animated GIF of a sheet that is pulled and let go.

    Args:
        shapes: the frames on the way out; the way back is the same in reverse.
        title: written above.
        width_px: of the picture.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    extents = [_extent(shape) for shape in shapes]
    half = 1.06 * max(wide for wide, _ in extents)
    length = max(long for _, long in extents)
    head = 44
    tall = round(width_px * length / (2 * half))
    frames = []
    with drawing():
        for shape in shapes:
            figure = Figure(
                figsize=(width_px / 72, (tall + head) / 72), dpi=72, facecolor="#ffffff"
            )
            agg = FigureCanvasAgg(figure)
            axes = figure.add_axes((0, 0, 1, tall / (tall + head)))
            axes.set_xlim(-half, half)
            axes.set_ylim(0, length)
            axes.set_axis_off()
            _draw(axes, shape, 0.6)
            figure.text(0.03, 1 - 6 / (tall + head), title, fontsize=11, color=INK, va="top")
            figure.text(
                0.03, 1 - 24 / (tall + head), f"U = {shape.displacement_mm:.0f} mm", fontsize=11,
                color=QUIET, va="top",
            )  # fmt: skip
            agg.draw()
            pixels = np.asarray(agg.buffer_rgba())
            shade = Image.fromarray(pixels).convert("RGB")
            frames.append(shade.quantize(8, dither=Image.Dither.NONE))
    there_and_back = [*frames, *frames[-2:0:-1]]
    buffer = io.BytesIO()
    there_and_back[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=there_and_back[1:],
        duration=80,
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def _extent(shape: SheetShape) -> tuple[float, float]:
    """Largest distance from the axis, and length, mm."""
    points = np.concatenate(shape.outlines_mm)
    return float(np.abs(points[:, 0]).max()), float(points[:, 1].max())


def _draw(axes: Axes, shape: SheetShape, line: float) -> None:
    from matplotlib.collections import PolyCollection

    # The line closes the hairline between facets that share a ligament.
    axes.add_collection(
        PolyCollection(
            [outline.round(3) for outline in shape.outlines_mm],
            facecolors=RUBBER,
            edgecolors=RUBBER,
            linewidths=line,
            rasterized=True,
        )
    )
