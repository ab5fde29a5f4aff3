"""Drawings as SVG: millimetres, a 1:1 viewBox, one group a layer, one path a stroke."""

from __future__ import annotations

import math
from xml.sax.saxutils import escape, quoteattr

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.profile import Layer, Profile
from kiribench.fabrication.strokes import Stroke

DECIMALS = 6
"""Of a coordinate in mm: 300 paths rounded so err by less than .001 mm in total length."""


def number(value: float) -> str:
    """A coordinate as the shortest decimal text, never in exponents."""
    text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def path_data(stroke: Stroke) -> str:
    """The stroke as the ``d`` of a path; arcs stay arcs."""
    starts, ends, bulges = stroke.pieces
    words = [f"M{number(starts[0][0])} {number(starts[0][1])}"]
    for start, end, bulge in zip(starts, ends, bulges, strict=True):
        x, y = number(end[0]), number(end[1])
        if bulge == 0:
            words.append(f"L{x} {y}")
            continue
        half = 2 * math.atan(abs(bulge))  # half of the arc's angle
        radius = number(math.dist(start, end) / (2 * math.sin(half)))
        words.append(f"A{radius} {radius} 0 {int(half > math.pi / 2)} {int(bulge > 0)} {x} {y}")
    return "".join(words) + ("Z" if stroke.closed else "")


def write_svg(drawing: Drawing, profile: Profile) -> str:
    """The text of the SVG file; the same drawing gives the same text."""
    width, height = number(drawing.width_mm), number(drawing.height_mm)
    groups = "".join(_group(layer, drawing, profile) for layer in profile.layers)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<svg xmlns="http://www.w3.org/2000/svg" '
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}">\n'
        f"<title>{escape(drawing.title)}</title>\n{groups}</svg>\n"
    )


def _group(layer: Layer, drawing: Drawing, profile: Profile) -> str:
    strokes = drawing.of(*layer.roles)
    if not strokes:
        return ""
    name = quoteattr(layer.name)
    paths = "".join(
        f'<path class="{stroke.role}" d="{path_data(stroke)}"/>\n' for stroke in strokes
    )
    return (
        f'<g id={name} inkscape:groupmode="layer" inkscape:label={name} fill="none" '
        f'stroke="{layer.colour}" stroke-width="{number(profile.stroke_mm)}">\n{paths}</g>\n'
    )
