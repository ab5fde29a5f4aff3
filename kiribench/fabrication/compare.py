"""A drawing that came back, laid over the drawing that it should be.

Layers and colours may have changed, the origin too, and a program may have joined, split or
dropped lines. So the comparison is by place alone: the outline gives the scale, the vertices give
the pose among the eight turns and mirrorings of the plane, and then every stroke that was
expected looks for its like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
from scipy.spatial import cKDTree
from shapely import LineString, Polygon

from kiribench.errors import Fault
from kiribench.fabrication.drawing import Drawing, extent_mm
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.match import match_slits, slit_faults
from kiribench.fabrication.parts import Parts, same_ring, take_apart
from kiribench.fabrication.reading import ReadStroke
from kiribench.fabrication.sheet import CleanSlits, clean_slits
from kiribench.fabrication.strokes import FloatArray

BoolArray = npt.NDArray[np.bool_]

_MARK_MM = 0.05
"""A line within this of an expected mark is that mark."""
_SCALE_STEP = 1e-4
"""A relative difference of sizes above this is a wrong scale, not rounding."""
_KNOWN_SCALES = {
    "scale-inches": (25.4, "inches and millimetres were mistaken for each other"),
    "scale-pixels-96": (96 / 25.4, "pixels of 1/96 inch were taken for millimetres"),
    "scale-pixels-90": (90 / 25.4, "pixels of 1/90 inch were taken for millimetres"),
    "scale-points-72": (72 / 25.4, "points of 1/72 inch were taken for millimetres"),
    "scale-dpi-96-72": (96 / 72, "one program counts 96 pixels an inch, the other 72"),
    "scale-dpi-96-90": (96 / 90, "one program counts 96 pixels an inch, the other 90"),
    "scale-centimetres": (10.0, "centimetres and millimetres were mistaken for each other"),
    "scale-metres": (1000.0, "metres and millimetres were mistaken for each other"),
}
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
class Comparison:
    """What the comparison found.

    Attributes:
        faults: named differences.
        scale: size of the drawing / expected size.
        pose: in words.
        slits: the slits found, doubles dropped, in the pose of the expected drawing.
        outline, windows: rings found, in the same pose.
        matched: number of expected slits that were found.
        largest_error_mm: of the ends of the matched slits.
    """

    faults: tuple[Fault, ...]
    scale: float
    pose: str
    slits: CleanSlits
    outline: Polygon | None
    windows: tuple[Polygon, ...]
    matched: int
    largest_error_mm: float


def compare(
    strokes: Sequence[ReadStroke], expected: Drawing, *, tolerance_mm: float, file: str
) -> Comparison:
    """Lay a drawing over the expected one.

    Faults: ``outline-missing``, ``outline-twice``, ``outline-changed``, ``scale-*``,
    ``drawing-stretched``, ``drawing-mirrored``, ``drawing-turned`` (warning), ``slit-missing``,
    ``slit-extra``, ``slit-length``, ``slit-duplicate``, ``slit-overlap``, ``slit-split``
    (warning), ``gap-closed``, ``slot-missing``, ``slot-extra``, ``marks-missing`` (warning),
    ``outline-not-last``.
    """
    found = Findings(file)

    parts = take_apart(strokes)
    rim = Polygon(expected.of("outline")[0].flattened())
    everything = np.concatenate([stroke.points_mm for stroke in strokes])
    if not parts.has_outline:
        found.error(
            "outline-missing",
            "The drawing has no closed outline.",
            "Draw it as one closed path, on the last layer.",
        )
    fit = max(_fits(parts, everything, expected, rim), key=lambda one: one.share)
    scale = _scale(
        fit.seen[2:] - fit.seen[:2], fit.wanted[2:] - fit.wanted[:2], found, tolerance_mm
    )
    pose, turn = fit.pose, fit.turn
    centre, goal = (fit.seen[:2] + fit.seen[2:]) / 2, (fit.wanted[:2] + fit.wanted[2:]) / 2

    def placed(points: FloatArray) -> FloatArray:
        return np.asarray((points - centre) / scale @ turn.T + goal)

    if pose.startswith("mirrored"):
        found.error(
            "drawing-mirrored",
            f"The drawing is {pose}: it is the patch of the other side of the body.",
            "Mirror it back.",
        )
    elif pose != "as drawn":
        found.warning(
            "drawing-turned",
            f"The drawing is {pose}.",
            "Nothing, if meant so.",
        )
    rings = [Polygon(placed(np.array(ring.exterior.coords))) for ring in parts.rings]
    outline, windows = _rings(rings, parts, expected, rim, tolerance_mm, found)
    segments = placed(parts.segments_mm.reshape(-1, 2)).reshape(-1, 2, 2)
    loose, owner = _without_marks(segments, parts.segment_stroke, expected, found)
    slits = clean_slits(loose)
    slit_faults(slits, found)
    matched, worst = match_slits(slits, expected, tolerance_mm, found)
    if outline is not None and len(loose):
        last_cut = int(owner.max())
        members = [m for index in parts.ring_strokes[1:] for m in index]
        last_inner = max([last_cut, *members])
        if max(parts.ring_strokes[0]) < last_inner:
            found.error(
                "outline-not-last",
                "The outline is cut before the last inner cut: the patch is loose by then.",
                "Put the outline last in the file, or on a layer that is worked last.",
                f"place {max(parts.ring_strokes[0]) + 1} of {len(strokes)}",
            )
    return Comparison(tuple(found.faults), scale, pose, slits, outline, windows, matched, worst)


@dataclass(frozen=True, eq=False)
class _Fit:
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


def _fits(parts: Parts, everything: FloatArray, expected: Drawing, rim: Polygon) -> list[_Fit]:
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
        ratio = _ratio(size, goal)
        scale = float(np.sqrt(ratio[0] * ratio[1]))
        scale = 1.0 if abs(scale - 1) < _SCALE_STEP else scale
        pose, turn, share = _pose(everything, (seen[:2] + seen[2:]) / 2, scale, expected, wanted)
        fits.append(_Fit(seen, wanted, pose, turn, share))
        if share > 0.999:
            break
    return fits or [_Fit(whole, whole, *_TURNS[0], 0.0)]


def _ratio(size: FloatArray, wanted: FloatArray) -> FloatArray:
    """(2,) sizes of a drawing / expected sizes, turned by a quarter where that fits better."""
    straight, turned = size / wanted, size[::-1] / wanted
    return min((straight, turned), key=lambda r: abs(float(np.log(r[0] / r[1]))))


def _scale(size: FloatArray, wanted: FloatArray, found: Findings, tolerance_mm: float) -> float:
    """Size of the drawing / expected size, turned by a quarter or not; faults if not 1."""
    ratio = _ratio(size, wanted)
    scale = float(np.sqrt(ratio[0] * ratio[1]))
    if abs(ratio[0] / ratio[1] - 1) > _SCALE_STEP and (
        np.max(np.abs(ratio / scale - 1) * wanted) > tolerance_mm
    ):
        found.error(
            "drawing-stretched",
            "Width and height of the drawing have different scales.",
            "Scale both by the same factor.",
            f"{ratio[0]:.5g} and {ratio[1]:.5g}",
            "1 and 1",
        )
    if float(np.max(np.abs(ratio - 1) * wanted)) <= 2 * tolerance_mm or abs(scale - 1) < 1e-9:
        return 1.0
    if abs(scale - 1) <= _SCALE_STEP:
        return 1.0  # a changed outline, not a scale
    code, why = "scale-factor", "the drawing was scaled"
    for name, (factor, words) in _KNOWN_SCALES.items():
        if min(abs(scale / factor - 1), abs(scale * factor - 1)) < 1e-3:
            code, why = name, words
    found.error(
        code,
        f"The drawing has the wrong size: {why}.",
        "Import it in millimetres, and measure the scale bar after the import.",
        f"{size[0]:.3f} x {size[1]:.3f} mm, {scale:.5g} times too large"
        if scale > 1
        else f"{size[0]:.3f} x {size[1]:.3f} mm, {1 / scale:.5g} times too small",
        f"{wanted[0]:.3f} x {wanted[1]:.3f} mm",
    )
    return scale


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
        distance, _ = tree.query(vertices, distance_upper_bound=_MARK_MM)
        share = float(np.mean(np.isfinite(distance)))
        if share > best[0] + 1e-9:
            best = (share, (name, turn))
    return (*best[1], best[0])


def _rings(
    rings: list[Polygon],
    parts: Parts,
    expected: Drawing,
    rim: Polygon,
    tolerance_mm: float,
    found: Findings,
) -> tuple[Polygon | None, tuple[Polygon, ...]]:
    """The outline and the windows among the rings."""
    if parts.ring_twice:
        found.error(
            "outline-twice",
            f"{parts.ring_twice} closed shapes are there twice: the beam would pass twice.",
            "Delete the doubles.",
        )
    outline = rings[0] if parts.has_outline else None
    if outline is not None and not same_ring(outline, rim, tolerance_mm + 0.004):
        found.error(
            "outline-changed",
            "The outline is not the one of the design.",
            "Check size, corners and hoops; corners may have been rounded or flattened.",
            f"{outline.hausdorff_distance(rim):.3f} mm off",
            f"within {tolerance_mm:g} mm",
        )
    elif outline is not None and not _same_size(outline, rim, tolerance_mm):
        found.error(
            "outline-changed",
            "The outline has another width or length than the design's.",
            "Check the scale: export it again in millimetres, with six digits.",
            _size_words(outline),
            _size_words(rim),
        )
    slots = [Polygon(s.flattened()) for s in expected.of("slot")]
    marks = [Polygon(s.flattened()) for s in expected.of("label", "info") if s.closed]
    inner = list(range(int(outline is not None), len(rings)))
    free = list(inner)
    for wanted, name in [*[(m, "") for m in marks], *[(s, "slot") for s in slots]]:
        place = wanted.centroid
        near = [k for k in free if rings[k].centroid.distance(place) < 0.5]
        match = next((k for k in near if same_ring(rings[k], wanted, tolerance_mm + 0.004)), None)
        if match is not None:
            free.remove(match)
        elif name:
            found.error(
                "slot-missing",
                "A strap window of the design is missing or has changed.",
                "Draw it as one closed path.",
                None,
                f"around ({place.x:.2f}, {place.y:.2f}) mm",
            )
    windows = tuple(
        rings[k] for k in inner if any(same_ring(rings[k], slot, 0.5) for slot in slots)
    )
    area = rim if outline is None else outline
    inside = [k for k in free if area.covers(rings[k]) and rings[k] not in windows]
    if inside:
        place = rings[inside[0]].centroid
        found.error(
            "slot-extra",
            f"{len(inside)} closed shapes inside of the patch are not in the design.",
            "Delete them, or turn outlined strokes back into single lines.",
            f"({place.x:.2f}, {place.y:.2f}) mm",
        )
    return outline, windows


def _same_size(one: Polygon, two: Polygon, tolerance_mm: float) -> bool:
    """Whether width and length agree: rings about one centre may lie near and yet do not."""
    size, wanted = (np.array(ring.bounds[2:]) - ring.bounds[:2] for ring in (one, two))
    # svgelements counts 25.39999 mm an inch: one part in a million.
    return bool(np.all(np.abs(size - wanted) <= tolerance_mm + 1e-6 * wanted))


def _size_words(ring: Polygon) -> str:
    x0, y0, x1, y1 = ring.bounds
    return f"{x1 - x0:.4f} x {y1 - y0:.4f} mm"


def _without_marks(
    segments: FloatArray, owner: npt.NDArray[np.int64], expected: Drawing, found: Findings
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """The segments that are no expected mark."""
    marks = [LineString(s.flattened()) for s in expected.of("label", "fiducial", "info")]
    if not marks or not len(segments):
        return segments, owner
    roomy = [mark.buffer(_MARK_MM) for mark in marks]
    lines = [LineString(pair) for pair in segments]
    inside, mark = shapely.STRtree(roomy).query(lines, predicate="covered_by")
    is_mark = np.zeros(len(segments), bool)
    is_mark[inside] = True
    own = [s for s in expected.of("label", "fiducial") if not s.closed]
    wanted = {i for i, s in enumerate(expected.of("label", "fiducial", "info")) if s in own}
    missing = wanted - set(mark.tolist())
    if missing:
        found.warning(
            "marks-missing",
            f"{len(missing)} of {len(wanted)} strokes of label and registration marks are "
            "missing or have changed.",
            "Keep them: they say which way is up and which leg it is for.",
        )
    return segments[~is_mark], owner[~is_mark]
