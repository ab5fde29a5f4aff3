"""SVG drawings as svgelements and as svgpathtools see them."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.errors import Fault
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.reading import (
    LIBRARY_ERRORS,
    SHORTEST_MM,
    ReadDrawing,
    ReadStroke,
    unreadable,
)
from kiribench.fabrication.svg_guard import MM_PER_UNIT, SvgHead

_TEXT = frozenset({"text", "tspan", "textpath", "flowroot"})


def _svg_faults(head: SvgHead, path: Path) -> tuple[Fault, ...]:
    found = Findings(str(path))

    unit = "" if head.width is None else head.width[1].lower()
    if head.view_box is None:
        found.error(
            "svg-viewbox-missing",
            "The SVG has no viewBox: every program takes its numbers in another unit.",
            'Write width="...mm", height="...mm" and a viewBox of the same numbers.',
        )
    if head.width is None or head.height is None or unit not in MM_PER_UNIT:
        found.error(
            "svg-size-missing",
            "The SVG does not state its width and height as lengths.",
            'Write width="...mm" and height="...mm".',
        )
    elif unit == "in":
        found.warning(
            "units-inches",
            "The file states its size in inches.",
            "Check the size after the import, or save it in millimetres.",
            f"{head.width[0]:g} in",
        )
    elif unit != "mm":
        found.warning(
            "units-not-mm",
            "The file does not state its size in millimetres.",
            "Programs disagree on 72, 90 or 96 pixels an inch: save it in millimetres.",
            f"{head.width[0]:g} {unit or 'pixels'}",
        )
    scale = head.mm_per_unit
    if scale is not None and abs(scale[0] / scale[1] - 1) > 1e-4:
        found.error(
            "drawing-stretched" if not head.keeps_ratio else "svg-two-scales",
            "Width and height of the SVG fit its viewBox with different scales: "
            + (
                "the drawing is stretched."
                if not head.keeps_ratio
                else "some programs keep the ratio and centre the drawing, others stretch it."
            ),
            "Scale both by the same factor: 1 mm a unit.",
            got=f"{scale[0]:.5g} and {scale[1]:.5g} mm a unit",
        )
    if head.styled:
        found.error(
            "svg-styled-transform",
            "Transforms stand in styles, which only browsers follow: programs would see another "
            "drawing than a picture shows.",
            "Save it as plain SVG, with transforms applied.",
        )
    count = sum(head.elements[name] for name in _TEXT)
    if count:
        found.error(
            "text-not-lines",
            f"The file holds {count} text elements, which lasers replace, drop or engrave.",
            "Convert text to paths (single strokes).",
        )
    if head.elements["image"] or head.elements["foreignobject"]:
        found.error(
            "picture-not-lines",
            "The file holds a picture, which a laser cannot cut.",
            "Trace it, or remove it.",
        )
    if head.hidden:
        found.warning(
            "layer-off",
            f"{head.hidden} elements are switched off: the machine's program may leave them out, "
            "or cut them all the same.",
            "Show or delete them.",
        )
    return tuple(found.faults)


def with_svgelements(data: bytes, head: SvgHead, path: Path) -> ReadDrawing:
    """All shapes, with transforms, units and viewBox applied by svgelements."""
    import svgelements

    strokes: list[ReadStroke] = []
    mm = MM_PER_UNIT["px"]
    try:
        if head.elements["symbol"]:
            data = _symbols_as_templates(data)
        drawing = svgelements.SVG.parse(io.BytesIO(data), ppi=96.0, reify=True)
        for shape in drawing.elements():
            if not isinstance(shape, svgelements.Shape):
                continue
            outline = svgelements.Path(shape)
            colour = (
                "" if shape.stroke is None or shape.stroke.value is None else (shape.stroke.hexrgb)
            )
            layer = str(shape.values.get("class") or "")
            for sub in outline.as_subpaths():
                segments = [s for s in sub if not isinstance(s, svgelements.Move)]
                strokes += _from_segments(
                    segments,
                    lambda segment, t: (segment.point(t).x * mm, segment.point(t).y * mm),
                    lambda segment: segment.length(error=1e-6) * mm,
                    lambda segment: isinstance(segment, (svgelements.Line, svgelements.Close)),
                    layer,
                    colour,
                )
    except LIBRARY_ERRORS as error:
        raise unreadable(path, "svgelements", error) from error
    return ReadDrawing("svgelements", tuple(strokes), _svg_faults(head, path))


def _symbols_as_templates(data: bytes) -> bytes:
    """Symbols put into defs: svgelements draws them where they stand, too, and no rule says so."""
    import xml.etree.ElementTree as ElementTree  # the guard let no entities through

    root = ElementTree.fromstring(data)
    for parent in list(root.iter()):
        for place, child in enumerate(list(parent)):
            if isinstance(child.tag, str) and child.tag.rpartition("}")[2] == "symbol":
                holder = ElementTree.Element(child.tag[: -len("symbol")] + "defs")
                parent.remove(child)
                holder.append(child)
                parent.insert(place, holder)
    return ElementTree.tostring(root)


def with_svgpathtools(data: bytes, head: SvgHead, path: Path) -> ReadDrawing:
    """All paths, with the groups' transforms applied by svgpathtools; the scale is ours."""
    import svgpathtools

    (mm, mm_down), (left, top) = head.placed_mm
    x0, y0 = head.view_box[:2] if head.view_box else (0.0, 0.0)
    strokes: list[ReadStroke] = []
    try:
        document = svgpathtools.Document(io.BytesIO(data))
        places = {element: place for place, element in enumerate(document.root.iter())}
        paths = sorted(document.paths(), key=lambda path: places[path.element])
        for whole in paths:
            own = whole.element.attrib
            for sub in whole.continuous_subpaths():
                strokes += _from_segments(
                    list(sub),
                    lambda segment, t: (
                        (segment.point(t).real - x0) * mm + left,
                        (segment.point(t).imag - y0) * mm_down + top,
                    ),
                    lambda segment: segment.length() * mm,
                    lambda segment: isinstance(segment, svgpathtools.Line),
                    own.get("class", ""),
                    "",
                )
    except LIBRARY_ERRORS as error:
        raise unreadable(path, "svgpathtools", error) from error
    return ReadDrawing("svgpathtools", tuple(strokes), ())


def _from_segments(
    segments: Sequence[Any],
    point: Callable[[Any, float], tuple[float, float]],
    length: Callable[[Any], float],
    straight: Callable[[Any], bool],
    layer: str,
    colour: str,
) -> Iterator[ReadStroke]:
    """A stroke from the segments of one subpath; none where it has no length."""
    if not segments:
        return
    points = [point(segments[0], 0.0)]
    total = 0.0
    for segment in segments:
        size = float(length(segment))
        if not math.isfinite(size):
            raise ValueError("a path with a coordinate that is no number")
        total += size
        count = 1 if straight(segment) else max(16, min(2000, math.ceil(size / 0.1)))
        points += [point(segment, k / count) for k in range(1, count + 1)]
    if total > SHORTEST_MM:
        yield ReadStroke(np.array(points, dtype=np.float64), total, layer, colour)
