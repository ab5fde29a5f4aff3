"""A page of strokes in the order of work, and the parts that all pages share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from kiribench.fabrication.lettering import fitting_height, text, text_width
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.route import in_order, travel_mm
from kiribench.fabrication.strokes import CUT_ROLES, FloatArray, Stroke, polyline

MARGIN_MM = 8.0
"""Between the part and the edge of the page."""

_INFO_HEIGHT_MM = 2.5
_SCALE_BARS_MM = (50.0, 20.0, 10.0, 5.0)


@dataclass(frozen=True, eq=False)
class Drawing:
    """One file for the machine.

    Attributes:
        name: stem of the file.
        title: one line, for the file's title.
        width_mm, height_mm: of the page.
        strokes: in the page frame, in the order of work.
    """

    name: str
    title: str
    width_mm: float
    height_mm: float
    strokes: tuple[Stroke, ...]

    def of(self, *roles: str) -> list[Stroke]:
        """The strokes of some roles, in the order of work."""
        return [stroke for stroke in self.strokes if stroke.role in roles]

    def length_mm(self, *roles: str) -> float:
        """Total length of the strokes of some roles, mm."""
        return sum(stroke.length_mm for stroke in self.of(*roles))

    @property
    def cut_mm(self) -> float:
        """Length of everything that goes through the material, mm."""
        return self.length_mm(*CUT_ROLES)

    @property
    def marked_mm(self) -> float:
        """Length of everything that is only marked, mm."""
        return sum(s.length_mm for s in self.strokes if s.role not in CUT_ROLES)

    @property
    def travel_mm(self) -> float:
        """Way of the head with the beam off, from the page's upper left corner, mm."""
        return travel_mm(self.strokes, (0.0, 0.0))


def extent_mm(strokes: Iterable[Stroke]) -> tuple[float, float, float, float]:
    """Bounding box (x0, y0, x1, y1) of strokes, mm."""
    points = np.concatenate([stroke.flattened() for stroke in strokes])
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def page(
    name: str,
    title: str,
    part: Sequence[Stroke],
    lines: Sequence[str],
    profile: Profile,
) -> Drawing:
    """A page with the part, a scale bar and lines of text below it, in the order of work.

    Args:
        name, title: of the drawing.
        part: strokes in a frame of their own (x right, y down); they are moved onto the page.
        lines: words to be marked beside the part.
        profile: its layers give the order.
    """
    x0, y0, x1, y1 = extent_mm(part)
    width = max(x1 - x0, 40.0)
    shift = (MARGIN_MM - x0 + (width - (x1 - x0)) / 2, MARGIN_MM - y0)
    placed = [stroke.moved(shift) for stroke in part]
    info, bottom = _information(lines, MARGIN_MM, MARGIN_MM + y1 - y0 + 4.0, width)
    strokes = ordered([*placed, *info], profile)
    return Drawing(name, title, width + 2 * MARGIN_MM, bottom + MARGIN_MM / 2, tuple(strokes))


def ordered(strokes: Sequence[Stroke], profile: Profile) -> list[Stroke]:
    """The strokes layer by layer, each layer in a short order, the outline last."""
    at: FloatArray = np.zeros(2)
    done: list[Stroke] = []
    for layer in profile.layers:
        for roles in _stages(layer.roles):
            stage = in_order([stroke for stroke in strokes if stroke.role in roles], at)
            if stage:
                done += stage
                at = stage[-1].ends_mm[1]
    return done


def _stages(roles: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The outline of a layer comes after all that shares the layer with it."""
    rest = tuple(role for role in roles if role != "outline")
    return [stage for stage in (rest, ("outline",) if "outline" in roles else ()) if stage]


def _information(
    lines: Sequence[str], left: float, top: float, width: float
) -> tuple[list[Stroke], float]:
    """Scale bar and text below the part, and the lowest y that they reach."""
    bar = next((length for length in _SCALE_BARS_MM if length <= width), _SCALE_BARS_MM[-1])
    y = top + 3.0
    strokes = [
        polyline("info", [(left, y - 1.5), (left, y), (left + bar, y), (left + bar, y - 1.5)])
    ]
    for k in range(1, int(bar // 10)):
        x = left + 10.0 * k
        strokes.append(polyline("info", [(x, y - 1.0), (x, y)]))
    y += 1.5 + _INFO_HEIGHT_MM
    for line in [f"{bar:g} mm", *_wrapped(lines, width)]:
        height = fitting_height(line, width, _INFO_HEIGHT_MM, 0.5) or 0.5
        strokes += text("info", line, (left, y), height)
        y += 1.7 * _INFO_HEIGHT_MM
    return strokes, y - 0.7 * _INFO_HEIGHT_MM


def _wrapped(lines: Sequence[str], width: float) -> list[str]:
    wrapped = []
    for line in lines:
        held = ""
        for word in line.split():
            longer = f"{held} {word}".strip()
            if held and text_width(longer, _INFO_HEIGHT_MM) > width:
                wrapped.append(held)
                longer = word
            held = longer
        wrapped.append(held)
    return [line for line in wrapped if line]
