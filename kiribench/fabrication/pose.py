"""Where a drawing lies: the pose in which it fits the expected one best, box on box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from shapely import Polygon

from kiribench.fabrication.drawing import Drawing, extent_mm
from kiribench.fabrication.parts import Parts, take_apart
from kiribench.fabrication.reading import ReadStroke
from kiribench.fabrication.strokes import FloatArray

NEAR_MM = 0.05
"""A line within this of an expected one may be that one."""
SCALE_STEP = 1e-4
"""A relative difference of sizes above this is a wrong scale, not rounding."""
_TURNS = (
    ("as drawn", np.array([[1.0, 0.0], [0.0, 1.0]])),
    ("turned by 180 degrees", np.array([[-1.0, 0.0], [0.0, -1.0]])),
    ("turned by 90 degrees", np.array([[0.0, -1.0], [1.0, 0.0]])),
    ("turned by 270 degrees", np.array([[0.0, 1.0], [-1.0, 0.0]])),
    ("mirrored left to right", np.array([[-1.0, 0.0], [0.0, 1.0]])),
    ("mirrored top to bottom", np.array([[1.0, 0.0], [0.0, -1.0]])),
    ("mirrored on a diagonal", np.array([[0.0, 1.0], [1.0, 0.0]])),
    ("mirrored on the other diagonal", np.array([[0.0, -1.0], [-1.0, 0.0]])),
)


@dataclass(frozen=True, eq=False)
class Fit:
    """One way to lay the drawing over the expected one: box on box, in a pose.

    Attributes:
        seen, wanted: (4,) the boxes.
        pose, turn: name and matrix of the pose.
        share: of the expected vertices that are there then.
    """

    seen: FloatArray
    wanted: FloatArray
    pose: str
    turn: FloatArray
    share: float


def fits(parts: Parts, everything: FloatArray, expected: Drawing, rim: Polygon) -> list[Fit]:
    """The best pose by the outline, by all open lines and by everything: one may have changed."""
    boxes = []
    if parts.has_outline:
        boxes.append((np.array(parts.rings[0].bounds), np.array(rim.bounds)))
    lines = [s for s in expected.strokes if not s.closed]
    if len(parts.segments_mm) and lines:
        points = parts.segments_mm.reshape(-1, 2)
        box = np.concatenate([points.min(axis=0), points.max(axis=0)])
        boxes.append((box, np.array(extent_mm(lines))))
    whole = np.concatenate([everything.min(axis=0), everything.max(axis=0)])
    boxes.append((whole, np.array(extent_mm(expected.strokes))))
    fits = []
    for seen, wanted in boxes:
        size, goal = seen[2:] - seen[:2], wanted[2:] - wanted[:2]
        if np.min(size) <= 0 or np.min(goal) <= 0:
            continue
        ratio = ratio_of(size, goal)
        scale = float(np.sqrt(ratio[0] * ratio[1]))
        scale = 1.0 if abs(scale - 1) < SCALE_STEP else scale
        pose, turn, share = _pose(everything, (seen[:2] + seen[2:]) / 2, scale, expected, wanted)
        fits.append(Fit(seen, wanted, pose, turn, share))
        if share > 0.999:
            break
    return fits or [Fit(whole, whole, *_TURNS[0], 0.0)]


def ratio_of(size: FloatArray, wanted: FloatArray) -> FloatArray:
    """(2,) sizes of a drawing / expected sizes, turned by a quarter where that fits better."""
    straight, turned = size / wanted, size[::-1] / wanted
    return min((straight, turned), key=lambda r: abs(float(np.log(r[0] / r[1]))))


def _pose(
    points: FloatArray, centre: FloatArray, scale: float, expected: Drawing, box: FloatArray
) -> tuple[str, FloatArray, float]:
    """The turn or mirroring under which most of the expected vertices are there."""
    goal = (box[:2] + box[2:]) / 2
    part = [s for s in expected.strokes if s.role not in ("info",)]
    vertices = np.concatenate([stroke.points_mm for stroke in part])
    best = (-1.0, _TURNS[0])
    for name, turn in _TURNS:
        tree = cKDTree((points - centre) / scale @ turn.T + goal)
        distance, _ = tree.query(vertices, distance_upper_bound=NEAR_MM)
        share = float(np.mean(np.isfinite(distance)))
        if share > best[0] + 1e-9:
            best = (share, (name, turn))
    return (*best[1], best[0])


def upright(
    strokes: Sequence[ReadStroke], parts: Parts, found: list[Fit], expected: Drawing, rim: Polygon
) -> tuple[Sequence[ReadStroke], Parts, list[Fit], float]:
    """A drawing that was turned by an odd angle, turned back.

    Args:
        strokes, parts, found: the drawing and how it fits as it is.
        expected, rim: what it should be, and its outline.

    Returns:
        Strokes, parts and fits, turned where they fit better then, and the angle in degrees
        (from x towards y, -45 to 45; 0 where nothing was turned).
    """
    before = max(fit.share for fit in found)
    lines = [parts.segments_mm, *(_sides(ring) for ring in parts.rings[:1])]
    lines = [line for line in lines if len(line)]
    if before > 0.5 or not lines:
        return strokes, parts, found, 0.0
    way = np.concatenate([line[:, 1] - line[:, 0] for line in lines])
    longest = way[int(np.argmax(np.hypot(*way.T)))]
    angle = float(np.arctan2(longest[1], longest[0]))
    angle = (angle + np.pi / 4) % (np.pi / 2) - np.pi / 4
    if abs(angle) < 1e-5:
        return strokes, parts, found, 0.0
    cos, sin = np.cos(angle), np.sin(angle)
    back = np.array([[cos, -sin], [sin, cos]])  # of row vectors: by -angle
    turned = [replace(stroke, points_mm=stroke.points_mm @ back) for stroke in strokes]
    apart = take_apart(turned)
    everything = np.concatenate([stroke.points_mm for stroke in turned])
    fitted = fits(apart, everything, expected, rim)
    if max(fit.share for fit in fitted) < before + 0.3:
        return strokes, parts, found, 0.0
    return turned, apart, fitted, float(np.degrees(angle))


def _sides(ring: Polygon) -> FloatArray:
    """(n, 2, 2) the sides of a ring."""
    points = np.array(ring.exterior.coords)
    return np.stack([points[:-1], points[1:]], axis=1)
