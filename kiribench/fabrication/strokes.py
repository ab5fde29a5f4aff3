"""What the machine follows: strokes of straight lines and circular arcs, in mm.

A stroke is a chain of vertices; to each vertex belongs the bulge of the piece that starts
there, tan(angle / 4) of its arc, 0 for a straight piece, positive where the arc turns from x
towards y (the rule of DXF). Page frame: x mm to the right, y mm down, origin in the page's upper
left corner, as in SVG.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: What a stroke is for, from the first to be worked to the last.
ROLES = ("info", "label", "fiducial", "slit", "tile", "slot", "outline")

#: Roles that go through the material.
CUT_ROLES = frozenset({"slit", "tile", "slot", "outline"})

FLAT_MM = 0.002
"""Largest distance of a chord to its arc, mm, where an arc is flattened: a fifth of what a
drawing is verified to."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """One stroke.

    Attributes:
        role: one of :data:`ROLES`.
        points_mm: (n, 2) vertices, mm; a closed stroke does not repeat the first.
        bulge: (n,) of the piece from each vertex to the next; of an open stroke the last is 0.
        closed: whether the last vertex joins the first.
    """

    role: str
    points_mm: FloatArray
    bulge: FloatArray
    closed: bool = False

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(m, 2) starts, (m, 2) ends and (m,) bulges of the pieces."""
        if self.closed:
            return self.points_mm, np.roll(self.points_mm, -1, axis=0), self.bulge
        return self.points_mm[:-1], self.points_mm[1:], self.bulge[:-1]

    @property
    def length_mm(self) -> float:
        """Exact length, mm: an arc of bulge b on a chord c is c (1 + b^2) atan|b| / |b|."""
        start, end, bulge = self.pieces
        chord = np.linalg.norm(end - start, axis=1)
        size = np.abs(bulge)
        stretch = np.where(
            size > 0, (1 + size**2) * np.arctan(size) / np.where(size > 0, size, 1), 1
        )
        return float(np.sum(chord * stretch))

    def flattened(self, flat_mm: float = FLAT_MM) -> FloatArray:
        """(n, 2) the stroke as a polyline within ``flat_mm``; a closed one repeats its start."""
        start, end, bulge = self.pieces
        points = [start[:1]]
        for p0, p1, b in zip(start, end, bulge, strict=True):
            points.append(_flat_piece(p0, p1, float(b), flat_mm))
        return np.concatenate(points)

    def moved(self, offset_mm: tuple[float, float], *, mirror_x_mm: float | None = None) -> Stroke:
        """The stroke shifted; with ``mirror_x_mm`` first mirrored to x -> mirror_x_mm - x."""
        points, bulge = self.points_mm, self.bulge
        if mirror_x_mm is not None:
            points = np.column_stack([mirror_x_mm - points[:, 0], points[:, 1]])
            bulge = -bulge
        return replace(self, points_mm=points + np.asarray(offset_mm), bulge=bulge)

    def reversed(self) -> Stroke:
        """The same stroke drawn from its other end."""
        if self.closed:
            return replace(
                self, points_mm=self.points_mm[::-1].copy(), bulge=-np.roll(self.bulge[::-1], -1)
            )
        bulge = np.zeros_like(self.bulge)
        bulge[:-1] = -self.bulge[:-1][::-1]
        return replace(self, points_mm=self.points_mm[::-1].copy(), bulge=bulge)

    def started_at(self, vertex: int) -> Stroke:
        """A closed stroke that starts at another of its vertices."""
        return replace(
            self,
            points_mm=np.roll(self.points_mm, -vertex, axis=0),
            bulge=np.roll(self.bulge, -vertex),
        )

    @property
    def ends_mm(self) -> tuple[FloatArray, FloatArray]:
        """(2,) where the beam goes on and (2,) where it goes off."""
        return self.points_mm[0], self.points_mm[0] if self.closed else self.points_mm[-1]


def polyline(
    role: str, points: Sequence[Sequence[float]] | FloatArray, *, closed: bool = False
) -> Stroke:
    """A stroke of straight pieces through ``points`` ((n, 2) mm)."""
    array = np.array(points, dtype=np.float64).reshape(-1, 2)
    return Stroke(role, array, np.zeros(len(array)), closed)


def circle(role: str, centre: Sequence[float], radius_mm: float) -> Stroke:
    """A circle as four quarter arcs."""
    x, y = centre
    points = np.array(
        [[x + radius_mm, y], [x, y + radius_mm], [x - radius_mm, y], [x, y - radius_mm]]
    )
    return Stroke(role, points, np.full(4, np.tan(np.pi / 8)), True)


def rounded(
    role: str, corners: Sequence[Sequence[float]] | FloatArray, radius_mm: Sequence[float] | float
) -> Stroke:
    """The closed polygon through ``corners`` ((n, 2) mm) with rounded corners.

    Args:
        role: of the stroke.
        corners: in order; no three in a line.
        radius_mm: one radius, or one a corner; made smaller where two would not fit on a side.
    """
    at = np.array(corners, dtype=np.float64)
    wanted = np.broadcast_to(np.asarray(radius_mm, dtype=np.float64), (len(at),))
    before, after = np.roll(at, 1, axis=0) - at, np.roll(at, -1, axis=0) - at
    side_before = np.linalg.norm(before, axis=1)
    side_after = np.linalg.norm(after, axis=1)
    before, after = before / side_before[:, None], after / side_after[:, None]
    turn = np.pi - np.arccos(np.clip(np.sum(before * after, axis=1), -1, 1))
    room = 0.5 * np.minimum(side_before, side_after)
    trim = np.minimum(wanted * np.tan(turn / 2), room)
    sense = np.sign(-before[:, 0] * after[:, 1] + before[:, 1] * after[:, 0])
    points, bulge = [], []
    for i in range(len(at)):
        if trim[i] <= 0:
            points.append(at[i])
            bulge.append(0.0)
            continue
        points += [at[i] + trim[i] * before[i], at[i] + trim[i] * after[i]]
        bulge += [float(sense[i] * np.tan(turn[i] / 4)), 0.0]
    return _without_repeats(Stroke(role, np.array(points), np.array(bulge), True))


def _without_repeats(stroke: Stroke) -> Stroke:
    """A closed stroke less its pieces of no length (two roundings that meet)."""
    start, end, bulge = stroke.pieces
    keep = (np.linalg.norm(end - start, axis=1) > 1e-9) | (bulge != 0)
    return replace(stroke, points_mm=stroke.points_mm[keep], bulge=stroke.bulge[keep])


def _flat_piece(start: FloatArray, end: FloatArray, bulge: float, flat_mm: float) -> FloatArray:
    """(n, 2) points after ``start`` up to ``end`` along a piece."""
    if bulge == 0:
        return end[None, :]
    chord = end - start
    angle = 4 * np.arctan(bulge)
    length = float(np.hypot(*chord))
    radius = length / (2 * abs(np.sin(angle / 2)))
    step = 2 * np.arccos(max(1 - flat_mm / radius, 0.0))
    count = max(2, int(np.ceil(abs(angle) / step)))
    normal = np.array([-chord[1], chord[0]]) / length
    centre = (start + end) / 2 + normal * (length / 2) / np.tan(angle / 2)
    spoke = start - centre
    turned = angle * np.arange(1, count + 1) / count
    cos, sin = np.cos(turned), np.sin(turned)
    points = centre + np.column_stack(
        [cos * spoke[0] - sin * spoke[1], sin * spoke[0] + cos * spoke[1]]
    )
    points[-1] = end
    return np.asarray(points)
