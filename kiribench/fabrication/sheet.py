"""What is left of a sheet when the beam has passed: pieces, ligaments, crossings, doubles.

Everything here is plane geometry on the beam's paths (shapely): slits as segments, the outline
and the windows as rings. A beam of width k burns away all within k/2 of a path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, Point, Polygon, STRtree

from kiribench.errors import Fault
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.strokes import FloatArray

SAME_MM = 0.01
"""Ends nearer than this are one point."""

_THINNEST_BEAM_MM = 1e-3
"""Without a kerf the pieces are counted with a beam of this width."""

_SPECK_MM2 = 1e-6


@dataclass(frozen=True, eq=False)
class CleanSlits:
    """Slits with doubles dropped and pieces of one line joined.

    Attributes:
        ends_mm: (m, 2, 2) ends of the slits.
        twice: (d, 2) middle of every double, mm.
        overlapping: (o, 2) middle of slits in one line that cover each other in part.
        split: number of slits that came in several pieces.
        order: (m,) place of the first piece among the segments given.
    """

    ends_mm: FloatArray
    twice: FloatArray
    overlapping: FloatArray
    split: int
    order: npt.NDArray[np.int64]


def clean_slits(ends_mm: FloatArray) -> CleanSlits:
    """Drop double segments and join those that continue each other in one line.

    Args:
        ends_mm: (n, 2, 2) straight segments.
    """
    ends = np.asarray(ends_mm, np.float64).reshape(-1, 2, 2)
    lines = _lines(ends) if len(ends) else []
    runs: list[FloatArray] = []
    order: list[int] = []
    twice: list[FloatArray] = []
    overlapping: list[FloatArray] = []
    split = 0
    for members in lines:
        origin, along = _axis(ends[members])
        span = np.sort((ends[members] - origin) @ along, axis=1)
        sequence = np.lexsort((span[:, 1], span[:, 0]))
        low, high = span[sequence[0]]
        pieces, first = 1, int(members[sequence[0]])
        for place in sequence[1:]:
            a, b = span[place]
            middle = ends[members[place]].mean(axis=0)
            if a >= high - SAME_MM:  # begins where the last one ends, or later
                if a <= high + SAME_MM:
                    pieces += 1
                    first = min(first, int(members[place]))
                else:
                    runs.append(origin + np.array([[low], [high]]) * along)
                    order.append(first)
                    split += pieces > 1
                    low, pieces, first = a, 1, int(members[place])
                high = max(high, b)
                continue
            whole = abs(a - low) < SAME_MM and abs(b - high) < SAME_MM
            (twice if whole or (pieces > 1 and b <= high + SAME_MM) else overlapping).append(middle)
            high = max(high, b)
        runs.append(origin + np.array([[low], [high]]) * along)
        order.append(first)
        split += pieces > 1
    return CleanSlits(
        np.array(runs).reshape(-1, 2, 2),
        np.array(twice).reshape(-1, 2),
        np.array(overlapping).reshape(-1, 2),
        split,
        np.array(order, np.int64),
    )


def _axis(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A point and the unit direction of the line that the longest of the segments lies on."""
    longest = ends[int(np.argmax(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))]
    way = longest[1] - longest[0]
    return longest[0], way / np.linalg.norm(way)


def _lines(ends: FloatArray) -> list[npt.NDArray[np.int64]]:
    """Groups of segments that lie on one line and touch or cover each other."""
    count = len(ends)
    parent = np.arange(count)

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = int(parent[i])
        return i

    tree = STRtree([LineString(pair) for pair in ends])
    near = tree.query([LineString(pair) for pair in ends], predicate="dwithin", distance=SAME_MM)
    for i, j in near.T:
        if i < j and _in_line(ends[i], ends[j]):
            parent[root(int(j))] = root(int(i))
    groups: dict[int, list[int]] = {}
    for i in range(count):
        groups.setdefault(root(i), []).append(i)
    return [np.array(members, np.int64) for members in groups.values()]


def _in_line(one: FloatArray, two: FloatArray) -> bool:
    """Whether the shorter segment lies within SAME_MM of the line of the longer one."""
    if np.linalg.norm(two[1] - two[0]) > np.linalg.norm(one[1] - one[0]):
        one, two = two, one
    way = one[1] - one[0]
    length = float(np.linalg.norm(way))
    if length < SAME_MM:
        return False
    offset = two - one[0]
    distance = np.abs(offset[:, 0] * way[1] - offset[:, 1] * way[0]) / length
    return bool(np.all(distance < SAME_MM))


@dataclass(frozen=True, eq=False)
class Sheet:
    """The sheet after cutting.

    Attributes:
        pieces: number of pieces that the patch falls into.
        area_mm2: of the largest.
        ligament_mm: narrowest bridge between two cuts, mm, kerf taken off; inf without cuts.
        faults: what is wrong.
    """

    pieces: int
    area_mm2: float
    ligament_mm: float
    faults: tuple[Fault, ...]


def judge_sheet(
    slits_mm: FloatArray,
    outline: Polygon,
    windows: Sequence[Polygon],
    *,
    kerf_mm: float,
    ligament_mm: float,
    file: str | None = None,
) -> Sheet:
    """Cut the sheet in thought and look at what is left.

    Args:
        slits_mm: (m, 2, 2) the beam's paths, doubles dropped.
        outline, windows: rings of the beam's path, mm.
        kerf_mm: width of the beam.
        ligament_mm: narrowest bridge that is allowed.
        file: for the faults.

    Returns:
        Faults ``slits-cross``, ``slit-leaves-patch``, ``ligament-thin``, ``patch-in-pieces``.
    """
    lines = [LineString(pair) for pair in slits_mm]
    found = Findings(file)
    crossing, outside = _crossings(lines), _leaving(lines, outline, windows)
    if crossing:
        found.error(
            "slits-cross",
            f"{len(crossing)} pairs of slits cross or touch each other.",
            "Shorten one of each pair; facets fall out where slits meet.",
            _places(crossing),
        )
    if outside:
        found.error(
            "slit-leaves-patch",
            f"{len(outside)} slits run over the outline or into a window.",
            "Move them back onto the patch.",
            _places(outside),
        )
    narrow = _ligaments(lines, outline, windows, kerf_mm, ligament_mm)
    thinnest = min((width for width, _ in narrow), default=np.inf)
    thin = [(w, place) for w, place in narrow if w < ligament_mm - 1e-6 * max(1.0, ligament_mm)]
    if thin:
        worst = min(thin, key=lambda item: item[0])
        found.error(
            "ligament-thin",
            f"{len(thin)} ligaments are narrower than allowed once the beam has passed.",
            "Shorten the slits, lower --ligament-mm, or design with a lower longest cut.",
            f"{worst[0]:.3f} mm at {_places([worst[1]])}",
            f"at least {ligament_mm:g} mm",
        )
    left = _after_cutting(lines, outline, windows, kerf_mm)
    parts = [part.area for part in shapely.get_parts(left) if part.area > _SPECK_MM2]
    if len(parts) != 1:
        found.error(
            "patch-in-pieces",
            f"The cuts leave {len(parts)} pieces instead of one.",
            "Find where slits meet, or reach the outline or a window.",
            f"areas {', '.join(f'{a:.2f}' for a in sorted(parts)[:5])} mm²",
        )
    return Sheet(len(parts), max(parts, default=0.0), float(thinnest), tuple(found.faults))


def _after_cutting(
    lines: list[LineString], outline: Polygon, windows: Sequence[Polygon], kerf_mm: float
) -> shapely.Geometry:
    half = max(kerf_mm, _THINNEST_BEAM_MM) / 2
    gone = shapely.union_all(
        [
            *[line.buffer(half, quad_segs=8) for line in lines],
            outline.exterior.buffer(half, quad_segs=4),
            *[window.buffer(half, quad_segs=4) for window in windows],
        ]
    )
    return outline.difference(gone)


def _crossings(lines: list[LineString]) -> list[tuple[float, float]]:
    if not lines:
        return []
    pairs = STRtree(lines).query(lines, predicate="dwithin", distance=1e-6)
    places = []
    for i, j in pairs.T:
        if i < j:
            place = shapely.shortest_line(lines[i], lines[j]).centroid
            places.append((place.x, place.y))
    return places


def _leaving(
    lines: list[LineString], outline: Polygon, windows: Sequence[Polygon]
) -> list[tuple[float, float]]:
    places = []
    roomy = outline.buffer(SAME_MM)
    shapely.prepare(roomy)
    for line in lines:
        hit = next((window for window in windows if window.distance(line) < SAME_MM), None)
        if hit is not None or not roomy.covers(line):
            place = line.centroid
            places.append((place.x, place.y))
    return places


def _ligaments(
    lines: list[LineString],
    outline: Polygon,
    windows: Sequence[Polygon],
    kerf_mm: float,
    ligament_mm: float,
) -> list[tuple[float, tuple[float, float]]]:
    """(width, place) of every bridge that is not far wider than allowed."""
    found = []
    reach = kerf_mm + 3 * ligament_mm + 1.0
    edges = [outline.exterior, *[window.exterior for window in windows]]
    for k, edge in enumerate(edges):
        for other in edges[:k]:
            if edge.distance(other) < reach:
                bridge = shapely.shortest_line(edge, other)
                place = bridge.centroid
                found.append((bridge.length - kerf_mm, (place.x, place.y)))
    if not lines:
        return found
    pairs = STRtree(lines).query(lines, predicate="dwithin", distance=reach)
    for i, j in pairs.T:
        if i < j:
            bridge = shapely.shortest_line(lines[i], lines[j])
            if bridge.length > 1e-6:
                place = bridge.centroid
                found.append((bridge.length - kerf_mm, (place.x, place.y)))
    near = 1.02 * reach  # so that the rim of what is left out is out of reach
    tree = STRtree(lines)
    for ring in edges:
        for i in tree.query(ring, predicate="dwithin", distance=reach):
            line, edge = lines[i], ring
            mouths = [Point(p) for p in line.coords if ring.distance(Point(p)) < SAME_MM]
            if mouths:  # a notch: what surrounds its own mouth is no bridge's other end
                edge = ring.difference(shapely.union_all([m.buffer(near) for m in mouths]))
            if edge.is_empty:
                continue
            bridge = shapely.shortest_line(line, edge)
            if 1e-6 < bridge.length < reach:
                place = bridge.centroid
                found.append((bridge.length - kerf_mm, (place.x, place.y)))
    return found


def _places(points: Sequence[tuple[float, float]]) -> str:
    shown = ", ".join(f"({x:.2f}, {y:.2f})" for x, y in points[:3])
    return f"{shown}{', ...' if len(points) > 3 else ''} mm"
