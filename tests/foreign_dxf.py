"""DXF as other programs write it, with entities and versions that ours does not use."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import ezdxf
import numpy as np
from ezdxf.math import bulge_to_arc

from kiribench.fabrication.drawing import Drawing


def _text(document: Any) -> str:
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def _points(stroke: Any, height: float, scale: float) -> list[tuple[float, float, float]]:
    return [
        (x * scale, (height - y) * scale, -bulge)
        for (x, y), bulge in zip(stroke.points_mm.tolist(), stroke.bulge.tolist(), strict=True)
    ]


def _pieces(drawing: Drawing, scale: float = 1.0) -> Any:
    """(start, end, bulge) of every piece, y upwards."""
    for stroke in drawing.strokes:
        for a, b, bulge in zip(*stroke.pieces, strict=True):
            up = [(float(x) * scale, (drawing.height_mm - float(y)) * scale) for x, y in (a, b)]
            yield up[0], up[1], -float(bulge)


def r12_lines_and_arcs(drawing: Drawing) -> str:
    """R12, everything exploded to LINE and ARC; R12 has no unit."""
    document = ezdxf.new("R12")
    space = document.modelspace()
    for a, b, bulge in _pieces(drawing):
        if bulge == 0:
            space.add_line(a, b)
        else:
            centre, start, end, radius = bulge_to_arc(a, b, bulge)
            space.add_arc(centre, radius, math.degrees(start), math.degrees(end))
    return _text(document)


def r12_polylines(drawing: Drawing) -> str:
    """R12 with POLYLINE and VERTEX, bulges kept; a closed one repeats its first point."""
    document = ezdxf.new("R12")
    space = document.modelspace()
    for stroke in drawing.strokes:
        points = _points(stroke, drawing.height_mm, 1.0)
        if stroke.closed:
            points.append((*points[0][:2], 0.0))
        space.add_polyline2d(points, format="xyb")
    return _text(document)


def inches(drawing: Drawing) -> str:
    """R2010, numbers in inches and said so."""
    document = ezdxf.new("R2010", units=1)
    space = document.modelspace()
    for stroke in drawing.strokes:
        points = _points(stroke, drawing.height_mm, 1 / 25.4)
        space.add_lwpolyline(points, format="xyb", close=stroke.closed)
    return _text(document)


def blocks(drawing: Drawing) -> str:
    """The patch in a block of half its size, mirrored and turned, inserted so that it is right."""
    document = ezdxf.new("R2000", units=4)
    inner, outer = document.blocks.new("INNER"), document.blocks.new("OUTER")
    for stroke in drawing.strokes:
        # (x, y) -> (-y, -x) / 2 is a mirroring; the insert (scale -2, 2, turned by 90) undoes it.
        points = _points(stroke, drawing.height_mm, 0.5)
        inner.add_lwpolyline(
            [(-y, -x, -bulge) for x, y, bulge in points], format="xyb", close=stroke.closed
        )
    outer.add_blockref("INNER", (10.0, 5.0), dxfattribs={"xscale": -2, "yscale": 2, "rotation": 90})
    document.modelspace().add_blockref("OUTER", (-33.0, 44.0))
    return _text(document)


def splines(drawing: Drawing) -> str:
    """Arcs as cubic splines, slits as polylines with a needless middle vertex."""
    document = ezdxf.new("R2004", units=4)
    space = document.modelspace()
    for a, b, bulge in _pieces(drawing):
        if bulge == 0:
            middle = tuple((np.array(a) + b) / 2)
            space.add_lwpolyline([a, middle, b])
            continue
        centre, start, end, radius = bulge_to_arc(a, b, bulge)
        sweep = (end - start) % (2 * math.pi)
        reach = radius * 4 / 3 * math.tan(sweep / 4)
        p = [
            np.array(centre) + radius * np.array([math.cos(t), math.sin(t)])
            for t in (start, start + sweep)
        ]
        t = [np.array([-math.sin(t), math.cos(t)]) for t in (start, start + sweep)]
        control = [p[0], p[0] + reach * t[0], p[1] - reach * t[1], p[1]]
        space.add_open_spline([(*c, 0.0) for c in control], degree=3)
    return _text(document)


def seen_from_below(drawing: Drawing) -> str:
    """Extrusion (0, 0, -1): the numbers are mirrored, the drawing is not."""
    document = ezdxf.new("R2000", units=4)
    space = document.modelspace()
    for stroke in drawing.strokes:
        points = [(-x, y, -bulge) for x, y, bulge in _points(stroke, drawing.height_mm, 1.0)]
        space.add_lwpolyline(
            points, format="xyb", close=stroke.closed, dxfattribs={"extrusion": (0, 0, -1)}
        )
    return _text(document)


RIGHT: Sequence[Callable[[Drawing], str]] = (
    r12_lines_and_arcs,
    r12_polylines,
    inches,
    blocks,
    splines,
    seen_from_below,
)
