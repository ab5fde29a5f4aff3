"""SVG as other programs write it, by hand: nothing of the product's writers is used here.

Each writer takes strokes (points mm, bulge, closed) on a page and gives the text of a file that
draws exactly these lines at exactly this size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.strokes import Stroke

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
PX = 96 / 25.4
INK = 'fill="none" stroke-width="0.1" stroke="#ff0000"'


def n(value: float, digits: int = 6) -> str:
    return f"{value:.{digits}f}"


def absolute(stroke: Stroke, scale: float = 1.0, digits: int = 6) -> str:
    """M, L, A and Z with commas."""
    starts, ends, bulges = stroke.pieces
    words = [f"M {n(starts[0][0] * scale, digits)},{n(starts[0][1] * scale, digits)}"]
    for a, b, bulge in zip(starts, ends, bulges, strict=True):
        to = f"{n(b[0] * scale, digits)},{n(b[1] * scale, digits)}"
        if bulge == 0:
            words.append(f"L {to}")
        else:
            radius = math.dist(a, b) / 2 / math.sin(2 * math.atan(abs(bulge))) * scale
            words.append(f"A {n(radius)} {n(radius)} 0 {int(abs(bulge) > 1)} {int(bulge > 0)} {to}")
    return " ".join(words) + (" Z" if stroke.closed else "")


def relative(stroke: Stroke) -> str:
    """As Inkscape: m with implied l, h and v where they will do, arcs as a."""
    starts, ends, bulges = stroke.pieces
    at = np.round(starts[0], 7)
    words = [f"m {at[0]:.7f},{at[1]:.7f}"]
    for a, b, bulge in zip(starts, ends, bulges, strict=True):
        step = np.round(b - at, 7)
        if bulge:
            radius = math.dist(a, b) / 2 / math.sin(2 * math.atan(abs(bulge)))
            words.append(
                f"a {radius:.6f} {radius:.6f} 0 0 {int(bulge > 0)} {step[0]:.7f},{step[1]:.7f}"
            )
        elif step[1] == 0:
            words.append(f"h {step[0]:.7f}")
        elif step[0] == 0:
            words.append(f"v {step[1]:.7f}")
        else:
            words.append(f"l {step[0]:.7e},{step[1]:.7e}")
        at = at + step
    return " ".join(words) + (" z" if stroke.closed else "")


def bezier(stroke: Stroke, scale: float = 1.0) -> str:
    """Arcs as cubic curves, as Illustrator turns everything into them."""
    starts, ends, bulges = stroke.pieces
    words = [f"M{n(starts[0][0] * scale)},{n(starts[0][1] * scale)}"]
    for a, b, bulge in zip(starts, ends, bulges, strict=True):
        if bulge == 0:
            words.append(f"L{n(b[0] * scale)},{n(b[1] * scale)}")
            continue
        angle = 4 * math.atan(bulge)
        chord = b - a
        reach = math.dist(a, b) / 2 / math.sin(abs(angle) / 2) * 4 / 3 * math.tan(abs(angle) / 4)
        along = chord / np.linalg.norm(chord)

        def turned(v: np.ndarray, by: float) -> np.ndarray:
            c, s = math.cos(by), math.sin(by)
            return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])

        one = (a + reach * turned(along, -angle / 2)) * scale
        two = (b - reach * turned(along, angle / 2)) * scale
        words.append(
            f"C{n(one[0])},{n(one[1])},{n(two[0])},{n(two[1])},{n(b[0] * scale)},{n(b[1] * scale)}"
        )
    return "".join(words) + ("z" if stroke.closed else "")


def sheet(size: tuple[float, float], box: tuple[float, ...], body: str, unit: str = "mm") -> str:
    """The file: width and height with their unit, and the viewBox."""
    (w, h), view = size, " ".join(n(x) for x in box)
    return f'{HEAD} width="{n(w)}{unit}" height="{n(h)}{unit}" viewBox="{view}">{body}</svg>'


def page(drawing: Drawing, body: str, *, unit: str = "mm", per_mm: float = 1.0) -> str:
    """A page of the drawing's size with user units of 1 / per_mm of a millimetre."""
    size = (drawing.width_mm * per_mm, drawing.height_mm * per_mm)
    return sheet(size, (0, 0, *size), body, unit)


def inkscape(drawing: Drawing) -> str:
    """mm page, layers moved off and back by nested transforms, styles, relative commands."""
    style = "fill:none;stroke:#ff0000;stroke-width:0.1"
    moved = [s.moved((40.0, -7.5)) for s in drawing.strokes]
    paths = "".join(f'<path style="{style}" d="{relative(s)}"/>' for s in moved)
    inner = (
        f'<g transform="translate(-50,20)"><g transform="matrix(1,0,0,1,10,-12.5)">{paths}</g></g>'
    )
    return page(drawing, inner)


def inkscape_turned(drawing: Drawing) -> str:
    """Drawn lying, turned up by rotate about a point and a scale of one half."""
    # The inverse of rotate(90) scale(.5): (x, y) -> 2 (y, -x).
    lying = [
        Stroke(
            s.role, 2 * np.column_stack([s.points_mm[:, 1], -s.points_mm[:, 0]]), s.bulge, s.closed
        )
        for s in drawing.strokes
    ]
    paths = "".join(f'<path {INK} d="{absolute(s)}"/>' for s in lying)
    return page(drawing, f'<g transform="rotate(90) scale(0.5)">{paths}</g>')


def pixels(drawing: Drawing) -> str:
    """User units of 1/96 inch and a size in px."""
    paths = "".join(f'<path {INK} d="{absolute(s, PX)}"/>' for s in drawing.strokes)
    return page(drawing, paths, unit="px", per_mm=PX)


def pixels_in_mm(drawing: Drawing) -> str:
    """Size in mm, viewBox in pixels: a scale of 3.78."""
    w, h = drawing.width_mm, drawing.height_mm
    paths = "".join(f'<path {INK} d="{absolute(s, PX)}"/>' for s in drawing.strokes)
    return sheet((w, h), (0, 0, w * PX, h * PX), paths)


def illustrator(drawing: Drawing) -> str:
    """Points of 1/72 inch, said so; curves for arcs; classes with a style sheet."""
    pt = 72 / 25.4
    paths = "".join(f'<path class="st0" d="{bezier(s, pt)}"/>' for s in drawing.strokes)
    style = '<style type="text/css">.st0{fill:none;stroke:#FF0000;stroke-width:0.25;}</style>'
    return page(drawing, style + paths, unit="pt", per_mm=pt)


def corel(drawing: Drawing) -> str:
    """Hundredths of a millimetre, lines and polygons instead of paths."""
    w, h = drawing.width_mm, drawing.height_mm
    body = f'<g id="Layer_x0020_1">{_shapes(drawing, 100.0)}</g>'
    return sheet((w, h), (0, 0, 100 * w, 100 * h), body)


def _shapes(drawing: Drawing, scale: float) -> str:
    """line, polyline and polygon where there are no arcs."""
    shapes = []
    for s in drawing.strokes:
        points = s.points_mm * scale
        if s.bulge.any():
            shapes.append(f'<path {INK} d="{absolute(s, scale)}"/>')
        elif s.closed:
            shapes.append(f'<polygon {INK} points="{_points(points)}"/>')
        elif len(points) > 2:
            shapes.append(f'<polyline {INK} points="{_points(points)}"/>')
        else:
            (x1, y1), (x2, y2) = points
            shapes.append(f'<line {INK} x1="{n(x1)}" y1="{n(y1)}" x2="{n(x2)}" y2="{n(y2)}"/>')
    return "".join(shapes)


def _points(points: np.ndarray) -> str:
    return " ".join(f"{n(x)},{n(y)}" for x, y in points)


def upside_down(drawing: Drawing) -> str:
    """A program with y upwards: every coordinate flipped, and a group that flips it back."""
    h = drawing.height_mm
    flipped = [
        Stroke(s.role, s.points_mm * (1, -1) + (0, h), -s.bulge, s.closed) for s in drawing.strokes
    ]
    paths = "".join(f'<path {INK} d="{absolute(s)}"/>' for s in flipped)
    return page(drawing, f'<g transform="matrix(1 0 0 -1 0 {n(h)})">{paths}</g>')


def shifted_box(drawing: Drawing) -> str:
    """A viewBox that does not begin at the origin."""
    w, h = drawing.width_mm, drawing.height_mm
    moved = [s.moved((-31.0, 12.0)) for s in drawing.strokes]
    paths = "".join(f'<path {INK} d="{absolute(s)}"/>' for s in moved)
    return sheet((w, h), (-31, 12, w, h), paths)


def one_path(drawing: Drawing) -> str:
    """All strokes of a role in one compound path, three digits only."""
    roles = list(dict.fromkeys(s.role for s in drawing.strokes))
    paths = [
        f'<path {INK} d="{" ".join(absolute(s, digits=3) for s in drawing.of(role))}"/>'
        for role in roles
    ]
    return page(drawing, "".join(paths))


def clones(drawing: Drawing) -> str:
    """Slits that are alike are drawn once and used again elsewhere; the rest as it is."""
    shapes: dict[tuple[float, ...], str] = {}
    defs, body = [], []
    for s in drawing.strokes:
        if s.role != "slit":
            body.append(f'<path {INK} d="{absolute(s)}"/>')
            continue
        way = np.round(s.points_mm[1] - s.points_mm[0], 6)
        name = shapes.get(tuple(way))
        if name is None:
            name = shapes[tuple(way)] = f"slit{len(shapes)}"
            defs.append(f'<path id="{name}" {INK} d="M0 0L{n(way[0])} {n(way[1])}"/>')
        x, y = s.points_mm[0]
        body.append(f'<use xlink:href="#{name}" x="{n(x)}" y="{n(y)}"/>')
    return page(drawing, f"<defs>{''.join(defs)}</defs>{''.join(body)}")


def letterboxed(drawing: Drawing) -> str:
    """A page wider than its viewBox: the default keeps the ratio and centres the drawing."""
    w, h = drawing.width_mm, drawing.height_mm
    paths = "".join(f'<path {INK} d="{absolute(s)}"/>' for s in drawing.strokes)
    return sheet((w + 60, h), (0, 0, w, h), paths)


def rectangles(drawing: Drawing) -> str:
    """Rectangles as rect, with their rounded corners, where a ring is one."""
    body = []
    for s in drawing.strokes:
        x0, y0 = s.flattened().min(axis=0)
        x1, y1 = s.flattened().max(axis=0)
        if s.role == "slot" and s.closed and len(s.points_mm) == 8:
            radius = float(
                np.min(np.linalg.norm(np.diff(s.points_mm, axis=0), axis=1))
            ) / math.sqrt(2)
            body.append(
                f'<rect {INK} x="{n(x0)}" y="{n(y0)}" width="{n(x1 - x0)}" height="{n(y1 - y0)}" '
                f'rx="{n(radius)}"/>'
            )
        else:
            body.append(f'<path {INK} d="{absolute(s)}"/>')
    return page(drawing, "".join(body))


RIGHT: Sequence[Callable[[Drawing], str]] = (
    inkscape,
    inkscape_turned,
    pixels,
    pixels_in_mm,
    illustrator,
    corel,
    upside_down,
    shifted_box,
    one_path,
    clones,
    rectangles,
)
