"""A picture of a drawing for people: the sheet filled, lines wide enough to be seen."""

from __future__ import annotations

from xml.sax.saxutils import escape

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.strokes import CUT_ROLES
from kiribench.fabrication.svg import number, path_data

_INK = {
    "info": ("#666666", 0.2),
    "label": ("#0b3d91", 0.3),
    "fiducial": ("#0b3d91", 0.3),
    "slit": ("#b3001b", 0.45),
    "tile": ("#b3001b", 0.3),
    "slot": ("#333333", 0.3),
    "outline": ("#333333", 0.3),
}


def draw_preview(drawing: Drawing, *, travel: bool = False, standalone: bool = True) -> str:
    """The picture as SVG text.

    Args:
        drawing: what to show.
        travel: whether the head's way with the beam off is drawn, dotted.
        standalone: as a file of its own, else to be put into a page.
    """
    width, height = number(drawing.width_mm), number(drawing.height_mm)
    body = [f'<rect width="{width}" height="{height}" fill="#ffffff"/>']
    rings = "".join(path_data(stroke) for stroke in drawing.of("outline", "slot"))
    body.append(f'<path d="{rings}" fill="#f1e7d3" fill-rule="evenodd"/>')
    if travel:
        body.append(
            f'<path d="{_travel(drawing)}" fill="none" stroke="#2a7f62" stroke-width="0.25" '
            'stroke-dasharray="0.6 0.6"/>'
        )
    for role, (colour, wide) in _INK.items():
        lines = "".join(path_data(stroke) for stroke in drawing.of(role))
        if lines:
            body.append(
                f'<path d="{lines}" fill="none" stroke="{colour}" stroke-width="{wide}" '
                'stroke-linecap="round"/>'
            )
    head = '<?xml version="1.0" encoding="UTF-8"?>\n' if standalone else ""
    label = f"{drawing.title}: picture for people, not for the machine"
    return (
        f'{head}<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}" role="img">\n<title>{escape(label)}</title>\n'
        + "\n".join(body)
        + "\n</svg>\n"
    )


def _travel(drawing: Drawing) -> str:
    """The way with the beam off between the cuts."""
    words = []
    at = None
    for stroke in drawing.of(*CUT_ROLES):
        first, last = stroke.ends_mm
        if at is not None:
            words.append(f"M{number(at[0])} {number(at[1])}L{number(first[0])} {number(first[1])}")
        at = last
    return "".join(words)
