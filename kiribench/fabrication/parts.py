"""A drawing taken apart: closed shapes and straight segments, whatever they were drawn as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, MultiLineString, Polygon

from kiribench.fabrication.reading import ReadStroke
from kiribench.fabrication.strokes import FloatArray


@dataclass(frozen=True, eq=False)
class Parts:
    """The strokes of a drawing by what they are.

    Attributes:
        segments_mm: (n, 2, 2) straight pieces of everything that is no ring.
        segment_stroke: (n,) index of the stroke that each comes from.
        rings: closed shapes as polygons, the outline first where there is one, then by size.
        ring_strokes: the strokes that each ring was made of.
        ring_twice: rings that are there more than once.
        has_outline: whether the first ring is the outline of a part.
    """

    segments_mm: FloatArray
    segment_stroke: npt.NDArray[np.int64]
    rings: tuple[Polygon, ...]
    ring_strokes: tuple[tuple[int, ...], ...]
    ring_twice: int
    has_outline: bool


def take_apart(strokes: Sequence[ReadStroke]) -> Parts:
    """Rings and straight segments of a drawing; rings in pieces are put together."""
    rings: list[tuple[Polygon, tuple[int, ...]]] = []
    open_strokes = []
    for index, stroke in enumerate(strokes):
        polygon = _polygon(stroke.points_mm) if stroke.closed else None
        if polygon is not None:
            rings.append((polygon, (index,)))
        else:
            open_strokes.append(index)
    chained, used = _chained(strokes, open_strokes)
    rings += chained
    rings.sort(key=lambda item: -item[0].area)
    kept: list[tuple[Polygon, tuple[int, ...]]] = []
    twice = 0
    for polygon, members in rings:
        if any(same_ring(polygon, other, 0.02) for other, _ in kept):
            twice += 1
        else:
            kept.append((polygon, members))
    segments, owner = [], []
    for index in open_strokes:
        if index in used:
            continue
        for piece in _straight_pieces(strokes[index].points_mm):
            segments.append(piece)
            owner.append(index)
    middles = np.array(segments).reshape(-1, 2, 2).mean(axis=1)
    polygons = [polygon for polygon, _ in kept]
    outer = [k for k in range(len(kept)) if _holds_a_part(k, polygons, middles, strokes)]
    has_outline = bool(outer)
    if has_outline:
        kept.insert(0, kept.pop(outer[0]))
    return Parts(
        np.array(segments).reshape(-1, 2, 2),
        np.array(owner, np.int64),
        tuple(polygon for polygon, _ in kept),
        tuple(members for _, members in kept),
        twice,
        has_outline,
    )


def _holds_a_part(
    index: int, rings: Sequence[Polygon], middles: FloatArray, strokes: Sequence[ReadStroke]
) -> bool:
    """Whether a ring is the outline of something: large on the page, or with much inside."""
    ring = rings[index]
    points = np.concatenate([stroke.points_mm for stroke in strokes])
    if ring.area > 0.3 * float(np.prod(np.ptp(points, axis=0))):
        return True
    inside = int(np.sum(shapely.contains_xy(ring, middles))) if len(middles) else 0
    inside += sum(ring.contains(other) for k, other in enumerate(rings) if k != index)
    return bool(inside >= 3)


def _polygon(points: FloatArray) -> Polygon | None:
    """The ring as a polygon; None for a line that runs back on itself."""
    if len(points) < 4:
        return None
    polygon = Polygon(points)
    polygon = polygon if polygon.is_valid else polygon.buffer(0)
    if not isinstance(polygon, Polygon) or polygon.area < 1e-3 * polygon.length:
        return None
    return polygon


def _chained(
    strokes: Sequence[ReadStroke], indices: list[int]
) -> tuple[list[tuple[Polygon, tuple[int, ...]]], set[int]]:
    """Rings made of open strokes that meet end to end."""
    ends: dict[tuple[float, float], list[int]] = {}
    for index in indices:
        points = strokes[index].points_mm
        for end in (points[0], points[-1]):
            ends.setdefault((round(float(end[0]), 2), round(float(end[1]), 2)), []).append(index)
    joined = [i for i in indices if _has_mates(strokes[i], ends)]
    lines = [LineString(np.round(strokes[i].points_mm, 2)) for i in joined]
    lines = [line for line in lines if line.length > 0]
    if not lines:
        return [], set()
    merged = shapely.line_merge(MultiLineString(lines))
    rings = []
    used: set[int] = set()
    for chain in shapely.get_parts(merged):
        polygon = _polygon(np.array(chain.coords)) if chain.is_ring else None
        if polygon is None:
            continue
        close = chain.buffer(0.03)
        shapely.prepare(close)
        members = tuple(i for i in joined if close.covers(LineString(strokes[i].points_mm)))
        exact = _exact_ring(strokes, members)
        rings.append((exact or polygon, members))
        used |= set(members)
    return rings, used


def _exact_ring(strokes: Sequence[ReadStroke], members: tuple[int, ...]) -> Polygon | None:
    """The ring through the members' own vertices, not the rounded ones."""
    free = list(members)
    if not free:
        return None
    chain = list(strokes[free.pop(0)].points_mm)
    while free:
        best = min(
            (
                (float(np.linalg.norm(strokes[i].points_mm[side] - chain[-1])), i, side)
                for i in free
                for side in (0, -1)
            ),
        )
        if best[0] > 0.05:
            return None
        points = strokes[best[1]].points_mm
        chain += list(points if best[2] == 0 else points[::-1])[1:]
        free.remove(best[1])
    return _polygon(np.array(chain))


def _has_mates(stroke: ReadStroke, ends: dict[tuple[float, float], list[int]]) -> bool:
    """Whether both ends of a stroke touch the end of another one."""
    points = stroke.points_mm
    return all(
        len(ends[(round(float(end[0]), 2), round(float(end[1]), 2))]) > 1
        for end in (points[0], points[-1])
    )


def same_ring(one: Polygon, two: Polygon, within_mm: float) -> bool:
    """Whether two rings lie within a distance of each other."""
    return (
        float(np.max(np.abs(np.array(one.bounds) - two.bounds))) <= within_mm
        and float(one.hausdorff_distance(two)) <= within_mm
    )


def _straight_pieces(points: FloatArray) -> list[FloatArray]:
    """Straight runs of a polyline: vertices on a straight way forward are dropped."""
    pieces = []
    start = 0
    for k in range(1, len(points)):
        if k + 1 < len(points):
            way, on = points[k] - points[start], points[k + 1] - points[k]
            size = float(np.linalg.norm(way) * np.linalg.norm(on))
            cross = abs(float(way[0] * on[1] - way[1] * on[0]))
            if size < 1e-12 or (cross < 1e-4 * size and float(way @ on) > 0):
                continue
        if np.linalg.norm(points[k] - points[start]) > 1e-6:
            pieces.append(points[[start, k]])
        start = k
    return pieces
