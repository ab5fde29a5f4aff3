"""A drawing that came back, laid over the drawing that it should be.

Layers and colours may have changed, the origin too, and a program may have joined, split or
dropped lines. So the comparison is by place alone: the outline gives the scale, the vertices give
the pose among the eight turns and mirrorings of the plane, and then every stroke that was
expected looks for its like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, Polygon

from kiribench.errors import Fault
from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.match import match_slits, slit_faults
from kiribench.fabrication.parts import Parts, same_ring, take_apart
from kiribench.fabrication.pose import NEAR_MM, SCALE_STEP, fits, ratio_of, upright
from kiribench.fabrication.reading import ReadStroke
from kiribench.fabrication.sheet import CleanSlits, clean_slits
from kiribench.fabrication.strokes import FloatArray

BoolArray = npt.NDArray[np.bool_]

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
    ``drawing-stretched``, ``frame-extra``, ``drawing-mirrored``, ``drawing-turned`` (warning),
    ``slit-missing``, ``slit-extra``, ``slit-length``, ``slit-duplicate``, ``slit-overlap``,
    ``slit-split`` (warning), ``gap-closed``, ``slot-missing``, ``slot-extra``, ``marks-missing``
    (warning), ``outline-not-last``.
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
    possible = fits(parts, everything, expected, rim)
    strokes, parts, possible, angle = upright(strokes, parts, possible, expected, rim)
    fit = max(possible, key=lambda one: one.share)
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
    elif pose != "as drawn" or angle:
        pose += f", and by {angle:.3g} degrees" if angle else ""
        found.warning(
            "drawing-turned",
            f"The drawing is {pose}.",
            "Nothing, if meant so.",
        )
    rings = [Polygon(placed(np.array(ring.exterior.coords))) for ring in parts.rings]
    rings, parts = _without_frames(rings, parts, rim, tolerance_mm, found)
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


def _scale(size: FloatArray, wanted: FloatArray, found: Findings, tolerance_mm: float) -> float:
    """Size of the drawing / expected size, turned by a quarter or not; faults if not 1."""
    ratio = ratio_of(size, wanted)
    scale = float(np.sqrt(ratio[0] * ratio[1]))
    if abs(ratio[0] / ratio[1] - 1) > SCALE_STEP and (
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
    if abs(scale - 1) <= SCALE_STEP:
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


def _without_frames(
    rings: list[Polygon], parts: Parts, rim: Polygon, tolerance_mm: float, found: Findings
) -> tuple[list[Polygon], Parts]:
    """Rings and parts without what encloses the outline: a page's frame or background."""
    place = next((k for k, ring in enumerate(rings) if same_ring(ring, rim, tolerance_mm)), 0)
    frames = [k for k in range(place) if rings[k].contains(rim)]
    if not frames:
        return rings, parts
    found.error(
        "frame-extra",
        f"{len(frames)} closed shapes enclose the patch (a page's frame or background): the "
        "machine may cut or engrave them.",
        "Delete them.",
    )
    kept = [place, *(k for k in range(len(rings)) if k != place and k not in frames)]
    return [rings[k] for k in kept], replace(
        parts,
        rings=tuple(parts.rings[k] for k in kept),
        ring_strokes=tuple(parts.ring_strokes[k] for k in kept),
        has_outline=True,
    )


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
    roomy = [mark.buffer(NEAR_MM) for mark in marks]
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
