"""The patch for the machine: slits, hoops, label, UP marks and registration marks.

The drawing shows the outer face: the one that looks away from the skin. On a right leg lateral
is on the viewer's left, on a left leg on his right; the label reads from outside in both cases.
A design without a side is drawn with lateral on the left and says LAT and MED.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kiribench.errors import Fault
from kiribench.fabrication import hoops as hoop_shapes
from kiribench.fabrication.drawing import Drawing, page
from kiribench.fabrication.hoops import Hoops
from kiribench.fabrication.lettering import drawable, fitting_height, text, text_width
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.slits import Slits, beam_paths
from kiribench.fabrication.strokes import FloatArray, Stroke, polyline
from kiribench.lattice import CutMap
from kiribench.schema.patch_design import PatchDesign

LETTER_MM, SMALLEST_LETTER_MM = 2.5, 1.2
TICK_MM = 2.0
"""Length of the registration ticks on the hoops' necks."""
CROSS = 0.4
"""Size of a registration cross / edge of a facet."""


@dataclass(frozen=True)
class PatchOptions:
    """How a patch is drawn.

    Attributes:
        kerf_mm: width that the beam burns away, mm.
        hoops: measures of the strap hoops, None for a patch without.
        fiducials: whether registration marks are drawn.
    """

    kerf_mm: float = 0.0
    hoops: Hoops | None = field(default_factory=Hoops)
    fiducials: bool = True


@dataclass(frozen=True, eq=False)
class PatchPlan:
    """The patch as it will be cut.

    Attributes:
        design: what is cut.
        cut_map: its cuts.
        slits: the beam's paths in patch coordinates (x from the lateral, y from the proximal
            edge, mm).
        part: all strokes of the patch as seen on the outer face (x right, y down, mm), origin in
            the page-left corner of the proximal end.
        fiducials_mm: (n, 2) centres of the registration crosses in patch coordinates.
        mirrored: whether lateral lies on the right of the page.
        options: as asked for.
        warnings: what was left out.
    """

    design: PatchDesign
    cut_map: CutMap
    slits: Slits
    part: tuple[Stroke, ...]
    fiducials_mm: FloatArray
    mirrored: bool
    options: PatchOptions
    warnings: tuple[Fault, ...]


def plan_patch(design: PatchDesign, options: PatchOptions) -> PatchPlan:
    """All strokes of a patch.

    Raises:
        UsageError: the hoops do not fit (see :func:`hoops.place_hoops`).
    """
    cut_map = CutMap(design.a, design.b, design.cell_mm)
    slits = beam_paths(cut_map, options.kerf_mm)
    width, _ = cut_map.size_mm
    mirrored = design.side.lower() == "left"
    bare = slits.strokes()
    if options.hoops is not None:
        bare += hoop_shapes.windows(cut_map.columns, cut_map.rows, cut_map.cell_mm, options.hoops)
    fiducials = fiducial_centres(cut_map) if options.fiducials else np.zeros((0, 2))
    bare += crosses(fiducials, cut_map.cell_mm)
    if options.fiducials and options.hoops is not None:
        bare += _ticks(cut_map, options.hoops)
    bare.append(hoop_shapes.outline(cut_map.columns, cut_map.rows, cut_map.cell_mm, options.hoops))
    mirror = width if mirrored else None
    part = [stroke.moved((0.0, 0.0), mirror_x_mm=mirror) for stroke in bare]
    label, warnings = _label(design, cut_map, options.hoops, mirrored)
    return PatchPlan(
        design,
        cut_map,
        slits,
        (*part, *label),
        fiducials,
        mirrored,
        options,
        (*_slit_warnings(slits, options.kerf_mm, design), *warnings),
    )


def draw_patch(plan: PatchPlan, name: str, profile: Profile) -> Drawing:
    """The page of the patch."""
    return page(name, f"Kirigami patch {name}", plan.part, info_lines(plan), profile)


def info_lines(plan: PatchPlan) -> list[str]:
    """What is marked beside the patch."""
    design = plan.design
    rows, columns = design.shape
    who = f"sub-{design.participant}" if design.participant else "no subject"
    side = f"{design.side} side" if design.side else "side not stated"
    return [
        f"{who}, {side}, {design.method}",
        f"{rows} × {columns} cells of {design.cell_mm:g} mm, {len(plan.slits)} slits",
        f"kerf {plan.options.kerf_mm:g} mm",
        f"outer face up, lateral on the {'right' if plan.mirrored else 'left'}",
    ]


def fiducial_centres(cut_map: CutMap) -> FloatArray:
    """(n, 2) centres of the facets that carry a cross, patch coordinates, mm.

    The facets next to the four corner facets on the diagonal, and one half-way down the lateral
    side, so that the marks fit in one way only.
    """
    rows, columns = 2 * cut_map.rows, 2 * cut_map.columns
    near_row, near_column = int(rows >= 4), int(columns >= 4)
    facets = {
        (near_row, near_column),
        (near_row, columns - 1 - near_column),
        (rows - 1 - near_row, near_column),
        (rows - 1 - near_row, columns - 1 - near_column),
        (rows // 2, near_column),
    }
    return cut_map.cell_mm / 2 * np.array([(j + 0.5, i + 0.5) for i, j in sorted(facets)])


def crosses(centres: FloatArray, cell_mm: float) -> list[Stroke]:
    """A cross in each of the facets with the given centres."""
    arm = CROSS * cell_mm / 4
    strokes = []
    for x, y in centres:
        strokes.append(polyline("fiducial", [(x - arm, y), (x + arm, y)]))
        strokes.append(polyline("fiducial", [(x, y - arm), (x, y + arm)]))
    return strokes


def _ticks(cut_map: CutMap, hoops: Hoops) -> list[Stroke]:
    """A tick on every hoop's neck that ends in the cell corner at the patch's end."""
    _, long = cut_map.size_mm
    strokes = []
    for hoop in hoop_shapes.place_hoops(cut_map.columns, cut_map.cell_mm, hoops):
        strokes.append(polyline("fiducial", [(hoop.x_mm, 0.0), (hoop.x_mm, -TICK_MM)]))
        strokes.append(polyline("fiducial", [(hoop.x_mm, long), (hoop.x_mm, long + TICK_MM)]))
    return strokes


@dataclass(frozen=True)
class _Box:
    """A place for a word: its middle and base line in patch coordinates, and its width."""

    x_mm: float
    base_mm: float
    width_mm: float


def _label(
    design: PatchDesign, cut_map: CutMap, hoops: Hoops | None, mirrored: bool
) -> tuple[list[Stroke], list[Fault]]:
    """Words and UP marks on the patch itself, in the frame of the outer face."""
    width = cut_map.size_mm[0]
    words = [word for word in ("UP", "LAT", "MED", design.participant, design.side) if word]
    proximal, distal = _boxes(cut_map, hoops)
    places = _places(words, proximal, distal)
    strokes: list[Stroke] = []
    faults = []
    for word in words:
        drawn = _word(word, places[word], width, mirrored) if word in places else None
        if drawn is None:
            faults.append(_no_room(word))
        else:
            strokes += drawn
    if len(distal) >= 3:
        strokes += _word("UP", distal[len(distal) // 2], width, mirrored) or []
    return strokes, faults


def _places(words: list[str], proximal: list[_Box], distal: list[_Box]) -> dict[str, _Box]:
    """Where the words go: LAT and MED to the edges that they name, UP to the middle."""
    count = len(proximal)
    if count < 3:
        ends = {"LAT": proximal[0], "MED": proximal[1]} if count == 2 else {}
        free = [*(proximal if count == 1 else ()), *distal]
    else:
        ends = {"LAT": proximal[0], "MED": proximal[-1], "UP": proximal[count // 2]}
        inner = [box for k, box in enumerate(proximal) if k not in (0, count // 2, count - 1)]
        free = [*inner, *(box for k, box in enumerate(distal) if k != count // 2)]
    others = [word for word in words if word not in ends]
    if count < 2:
        others = [word for word in others if word not in ("LAT", "MED")]
    return ends | dict(zip(others, free, strict=False))


def _boxes(cut_map: CutMap, hoops: Hoops | None) -> tuple[list[_Box], list[_Box]]:
    """Places for words at both ends: the hoops' necks, else facets without a cross."""
    _, long = cut_map.size_mm
    if hoops is not None:
        placed = hoop_shapes.place_hoops(cut_map.columns, cut_map.cell_mm, hoops)
        near, far = -TICK_MM - 0.8, long + TICK_MM + 0.8 + LETTER_MM
        return (
            [_Box(h.x_mm, near, h.neck_width_mm - 1.6) for h in placed],
            [_Box(h.x_mm, far, h.neck_width_mm - 1.6) for h in placed],
        )
    facet = cut_map.cell_mm / 2
    room = facet - 1.6
    taken = {tuple(np.floor(centre / facet).astype(int)) for centre in fiducial_centres(cut_map)}
    ends = []
    for row in (0, 2 * cut_map.rows - 1):
        base = (row + 0.5) * facet + min(LETTER_MM, room) / 2
        columns = [j for j in range(2 * cut_map.columns) if (j, row) not in taken]
        ends.append([_Box((j + 0.5) * facet, base, room) for j in columns])
    return ends[0], ends[1]


def _word(word: str, box: _Box, width: float, mirrored: bool) -> list[Stroke] | None:
    x = width - box.x_mm if mirrored else box.x_mm
    arrow = word == "UP"
    # The arrow is as wide as one letter.
    height = fitting_height(f"{word}  " if arrow else word, box.width_mm, LETTER_MM, 1.0)
    if height is None or height < SMALLEST_LETTER_MM:
        return None
    if not arrow:
        return text("label", word, (x, box.base_mm), height, anchor=0.5)
    left = x - text_width("UP  ", height) / 2
    strokes = text("label", word, (left, box.base_mm), height)
    tip, foot = box.base_mm - height, box.base_mm
    shaft = left + text_width("UP ", height) + height / 3
    barb = height / 3
    strokes.append(polyline("label", [(shaft, foot), (shaft, tip)]))
    strokes.append(
        polyline("label", [(shaft - barb, tip + barb), (shaft, tip), (shaft + barb, tip + barb)])
    )
    return strokes


def _no_room(word: str) -> Fault:
    return Fault(
        "label-no-room",
        f"There is no room on the patch for the mark '{drawable(word)}'.",
        "It stands in the text beside the patch; write it on the patch by hand.",
        severity="warning",
    )


def _slit_warnings(slits: Slits, kerf_mm: float, design: PatchDesign) -> list[Fault]:
    faults = []
    longest = 100 * float(max(design.a.max(), design.b.max()))
    if 0 < longest <= 1:
        faults.append(
            Fault(
                "cuts-below-percent",
                f"No cut is longer than {longest:g} % of the cell edge.",
                "a_percent and b_percent are percent: 60, not 0.6.",
                severity="warning",
                got=f"at most {longest:g}",
            )
        )
    if len(slits.left_out):
        p, q = (int(n) for n in slits.left_out[0])
        faults.append(
            Fault(
                "slit-below-kerf",
                f"{len(slits.left_out)} cuts of the design are hardly longer than the kerf and "
                f"are left out; the first is at x = {p * design.cell_mm / 2:g} mm, "
                f"y = {q * design.cell_mm / 2:g} mm.",
                "A beam of this width makes them a hole; nothing need be done.",
                severity="warning",
                got=f"kerf {kerf_mm:g} mm",
            )
        )
    if design.side.lower() not in ("left", "right"):
        faults.append(
            Fault(
                "side-not-stated",
                "The design does not say left or right: the patch is drawn with its lateral "
                "edge on the left, which is the outer face of a right one.",
                'Put "Side": "left" or "right" into the sidecar of the design.',
                severity="warning",
                got=design.side or None,
            )
        )
    return faults
