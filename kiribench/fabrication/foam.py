"""The other files of a patch: foam tiles, the template for the skin, and the kerf coupon."""

from __future__ import annotations

import numpy as np

from kiribench.fabrication.drawing import Drawing, page
from kiribench.fabrication.lettering import fitting_height, text
from kiribench.fabrication.patch import PatchPlan, crosses
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.strokes import Stroke, circle, polyline, rounded

TICK_MM = 3.0


def draw_foam(plan: PatchPlan, name: str, profile: Profile) -> Drawing:
    """The foam: one tile a facet (half a cell), cut through, seen as it lies on the patch.

    Neighbouring tiles share one cut, so that each tile is a kerf smaller than the facet. Crosses
    on the tiles over the patch's crosses, and ticks in line with the cell corners beside the
    foam, for the film that carries the tiles.
    """
    cut_map = plan.cut_map
    width, long = cut_map.size_mm
    facet = cut_map.cell_mm / 2
    part: list[Stroke] = []
    for j in range(1, 2 * cut_map.columns):
        part.append(polyline("tile", [(j * facet, 0.0), (j * facet, long)]))
    for i in range(1, 2 * cut_map.rows):
        part.append(polyline("tile", [(0.0, i * facet), (width, i * facet)]))
    part += crosses(plan.fiducials_mm, cut_map.cell_mm)
    part += _edge_ticks(plan, inside=False)
    part.append(rounded("outline", [(0, 0), (width, 0), (width, long), (0, long)], 0.0))
    tiles = 4 * cut_map.rows * cut_map.columns
    lines = [
        f"foam {_who(plan)}, {tiles} tiles of {facet:g} mm",
        f"up as drawn, outer face up, lateral on the {'right' if plan.mirrored else 'left'}",
    ]
    return page(name, f"Foam tiles {name}", _seen(plan, part), lines, profile)


def draw_template(plan: PatchPlan, name: str, profile: Profile, *, hole_mm: float = 2.0) -> Drawing:
    """A card to mark the skin through: a hole at every cross, ticks at every grid line."""
    cut_map = plan.cut_map
    width, long = cut_map.size_mm
    part = [circle("slot", centre, hole_mm / 2) for centre in plan.fiducials_mm]
    part += _edge_ticks(plan, inside=True)
    part.append(rounded("outline", [(0, 0), (width, 0), (width, long), (0, long)], 0.0))
    seen = _seen(plan, part)
    words = ("up", *_who(plan).split(), f"lateral {'right' if plan.mirrored else 'left'}")
    height = min(fitting_height(word, 0.6 * width, 0.08 * width, 0.5) or 0.5 for word in words)
    for k, word in enumerate(words):
        y = long / 2 + (k - len(words) / 2) * 1.8 * height
        seen += text("label", word, (width / 2, y), height, anchor=0.5)
    lines = [
        f"skin template {_who(plan)}, up as drawn",
        "lay the edge ticks on the drawn grid, straight pose. mark through the holes",
    ]
    return page(name, f"Skin template {name}", seen, lines, profile)


def draw_coupon(name: str, profile: Profile, *, step_mm: float = 0.05, rows: int = 12) -> Drawing:
    """The kerf coupon: facing slits with growing gaps, and slits of known length.

    Left: row k has two slits in one line whose paths end k steps apart. The beam burns half a
    kerf beyond both ends, so that the bridge is cut through wherever the gap is not wider than
    the kerf: the kerf lies between the last row that is open and the first that holds. Right:
    slits whose paths are 5, 10 and 20 mm long, three of each: the kerf is the mean of measured
    length less path. Nothing here is compensated for the kerf.
    """
    pitch, top = 3.0, 7.0
    part: list[Stroke] = [
        *text("label", "gap mm", (3.0, top - 2.5), 2.0),
        *text("label", "length mm", (40.0, top - 2.5), 2.0),
    ]
    for row in range(rows):
        gap = step_mm * (row + 1)
        y = top + pitch * row
        part += text("label", f"{gap:.2f}", (3.0, y + 0.9), 1.8)
        part.append(polyline("slit", [(14.0, y), (22.0, y)]))
        part.append(polyline("slit", [(22.0 + gap, y), (30.0 + gap, y)]))
    for row, length in enumerate(np.repeat([5.0, 10.0, 20.0], 3)):
        y = top + 4.0 * row
        part += text("label", f"{length:g}", (40.0, y + 0.9), 1.8)
        part.append(polyline("slit", [(46.0, y), (46.0 + length, y)]))
    high = top + pitch * (rows - 1) + 5.0
    part.append(rounded("outline", [(0, 0), (70.0, 0), (70.0, high), (0, high)], 2.0))
    lines = ["kerf coupon, not compensated", "kerf: between the last open and the first held gap"]
    return page(name, "Kerf coupon", part, lines, profile)


def _who(plan: PatchPlan) -> str:
    design = plan.design
    return " ".join(filter(None, [design.participant, design.side])) or "no subject"


def _seen(plan: PatchPlan, part: list[Stroke]) -> list[Stroke]:
    """Strokes in patch coordinates as seen on the outer face."""
    mirror = plan.cut_map.size_mm[0] if plan.mirrored else None
    return [stroke.moved((0.0, 0.0), mirror_x_mm=mirror) for stroke in part]


def _edge_ticks(plan: PatchPlan, *, inside: bool) -> list[Stroke]:
    """Ticks at every cell corner of the four edges, inwards or outwards."""
    cut_map = plan.cut_map
    width, long = cut_map.size_mm
    role, way = ("label", 1.0) if inside else ("info", -1.0)
    near = 0.0 if inside else -1.0
    strokes = []
    for column in range(cut_map.columns + 1):
        x = column * cut_map.cell_mm
        if inside and column in (0, cut_map.columns):
            continue  # the card's own edge
        strokes.append(polyline(role, [(x, near), (x, near + way * TICK_MM)]))
        strokes.append(polyline(role, [(x, long - near), (x, long - near - way * TICK_MM)]))
    for row in range(cut_map.rows + 1):
        y = row * cut_map.cell_mm
        if inside and row in (0, cut_map.rows):
            continue
        strokes.append(polyline(role, [(near, y), (near + way * TICK_MM, y)]))
        strokes.append(polyline(role, [(width - near, y), (width - near - way * TICK_MM, y)]))
    return strokes
