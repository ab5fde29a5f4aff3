"""The straps' hoops at both ends of the patch, and the outline with them.

The paper's patch has "several additional hoops ... at the two ends" for Velcro straps and gives
no drawing; this form is ours. Each hoop is a tongue with a window, centred on a line of the
drawn grid (a column of cell corners) and standing on a neck that fits between two notches of the
patch's end, so that no notch is bridged and every cut stays what the design says. The strap is
woven over one rim and under the next. In cells too small for a window the hoop is wider than its
neck and stands on every second, third, ... grid line.

Frame: patch coordinates, x mm from the lateral edge, y mm from the proximal edge; the proximal
hoops lie at negative y.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kiribench.errors import UsageError
from kiribench.fabrication.strokes import Stroke, rounded

NARROWEST_WINDOW_MM = 4.0
"""A window must let the doubled edge of a strap through."""


@dataclass(frozen=True)
class Hoops:
    """Measures of the hoops, mm; all of them our choice, none is the paper's.

    Attributes:
        strap_mm: width of the strap.
        play_mm: by how much the window is longer than the strap is wide.
        neck_mm: from the patch's end to the window; label and registration tick are on it.
        rim_mm: material on both sides of the window.
        end_mm: material beyond the window.
        gap_mm: between neighbouring hoops; the notch of the patch opens in its middle.
        corner_mm: radius of outer corners and of the windows' corners.
    """

    strap_mm: float = 20.0
    play_mm: float = 2.0
    neck_mm: float = 7.0
    rim_mm: float = 3.0
    end_mm: float = 4.0
    gap_mm: float = 2.0
    corner_mm: float = 1.5

    @property
    def reach_mm(self) -> float:
        """How far the hoops stand out from the patch's end, mm."""
        return self.neck_mm + self.strap_mm + self.play_mm + self.end_mm


@dataclass(frozen=True)
class Hoop:
    """One hoop.

    Attributes:
        column: of cell corners that it is centred on.
        x_mm: of its middle.
        width_mm, neck_width_mm: of its body and of its neck.
    """

    column: int
    x_mm: float
    width_mm: float
    neck_width_mm: float


def place_hoops(columns: int, cell_mm: float, hoops: Hoops) -> tuple[Hoop, ...]:
    """The hoops of one end of a patch of ``columns`` cells.

    Raises:
        UsageError: no neck fits between two notches.
    """
    neck = cell_mm - hoops.gap_mm
    if neck <= 2 * hoops.corner_mm:
        raise UsageError(
            "hoops-do-not-fit",
            "The cells are too small for strap hoops between the notches.",
            remedy="Export with --no-hoops and fix the patch in another way.",
            got=f"cells of {cell_mm:g} mm",
        )
    every = max(1, math.ceil((NARROWEST_WINDOW_MM + 2 * hoops.rim_mm + hoops.gap_mm) / cell_mm))
    count = columns // every + 1
    first = (columns - (count - 1) * every) // 2
    width = every * cell_mm - hoops.gap_mm
    return tuple(
        Hoop(column, column * cell_mm, width, neck)
        for column in (first + every * k for k in range(count))
    )


def windows(columns: int, rows: int, cell_mm: float, hoops: Hoops) -> list[Stroke]:
    """The windows of the hoops of both ends, as closed strokes of the role ``slot``."""
    strokes = []
    long = rows * cell_mm
    for hoop in place_hoops(columns, cell_mm, hoops):
        half = hoop.width_mm / 2 - hoops.rim_mm
        near, far = hoops.neck_mm, hoops.neck_mm + hoops.strap_mm + hoops.play_mm
        for y0, y1 in ((-far, -near), (long + near, long + far)):
            corners = [
                (hoop.x_mm - half, y0),
                (hoop.x_mm + half, y0),
                (hoop.x_mm + half, y1),
                (hoop.x_mm - half, y1),
            ]
            strokes.append(rounded("slot", corners, hoops.corner_mm))
    return strokes


def outline(columns: int, rows: int, cell_mm: float, hoops: Hoops | None) -> Stroke:
    """The outline of the patch, with hoops at both ends unless ``hoops`` is None."""
    wide, long = columns * cell_mm, rows * cell_mm
    if hoops is None:
        return rounded("outline", [(0, 0), (wide, 0), (wide, long), (0, long)], 0.0)
    end = _end_profile(columns, cell_mm, hoops)
    proximal = [(x, -y) for x, y in end]
    distal = [(x, long + y) for x, y in reversed(end)]
    corners = np.array(proximal + distal)
    return rounded("outline", corners, _radii(corners, long, hoops))


def _end_profile(columns: int, cell_mm: float, hoops: Hoops) -> list[tuple[float, float]]:
    """Corners of one end from the lateral to the medial edge, y outwards from the end."""
    wide = columns * cell_mm
    placed = place_hoops(columns, cell_mm, hoops)
    body_from = hoops.neck_mm / 2  # where a body wider than its neck begins
    profile: list[tuple[float, float]] = []
    if placed[0].x_mm - placed[0].neck_width_mm / 2 > 0:
        profile.append((0.0, 0.0))
    for hoop in placed:
        neck, half = hoop.neck_width_mm / 2, hoop.width_mm / 2
        left = [(hoop.x_mm - neck, 0.0)]
        if half > neck + 1e-9:
            left += [(hoop.x_mm - neck, body_from), (hoop.x_mm - half, body_from)]
        left.append((hoop.x_mm - half, hoops.reach_mm))
        right = [(2 * hoop.x_mm - x, y) for x, y in reversed(left)]
        if hoop.column == 0:
            left.insert(0, (0.0, 0.0))
        if hoop.column == columns:
            right.append((wide, 0.0))
        profile += left + right
    if placed[-1].x_mm + placed[-1].neck_width_mm / 2 < wide:
        profile.append((wide, 0.0))
    return profile


def _radii(corners: np.ndarray, long: float, hoops: Hoops) -> list[float]:
    """Radius of each corner: on the patch's ends small enough to leave the notches' mouths."""
    small = min(hoops.corner_mm, 0.4 * hoops.gap_mm)
    on_end = np.isclose(corners[:, 1], 0) | np.isclose(corners[:, 1], long)
    return [small if end else hoops.corner_mm for end in on_end]
