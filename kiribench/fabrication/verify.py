"""Every file is read again before it is called good, and so is what comes back from others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from shapely import Polygon

from kiribench.errors import Fault
from kiribench.fabrication.compare import compare
from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.parts import take_apart
from kiribench.fabrication.profile import PROFILES, Profile, read_profile
from kiribench.fabrication.reading import ReadDrawing, ReadStroke, read_drawing
from kiribench.fabrication.sheet import CleanSlits, Sheet, clean_slits, judge_sheet

TOLERANCE_MM = 0.01
"""Of positions, lengths and extents of a file."""

_INCH = 1e-6
"""Relative: svgelements counts 25.39999 mm an inch; allowed on top of the tolerance."""


@dataclass(frozen=True)
class Limits:
    """What a drawing is held against.

    Attributes:
        kerf_mm: width of the beam.
        ligament_mm: narrowest bridge that is allowed after it.
        tolerance_mm: of positions, lengths and extents.
    """

    kerf_mm: float = 0.0
    ligament_mm: float = 0.5
    tolerance_mm: float = TOLERANCE_MM


@dataclass(frozen=True, eq=False)
class Verification:
    """What the readers found in one file.

    Attributes:
        file: the file.
        readers: name of the library -> count, total length (mm) and extent (mm) that it reads.
        measured: further numbers: pieces, narrowest ligament, slits matched, scale, pose.
        faults: errors and warnings.
    """

    file: Path
    readers: dict[str, dict[str, Any]]
    measured: dict[str, Any] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether there is no error."""
        return not any(fault.severity == "error" for fault in self.faults)


def verify_export(
    path: Path, drawing: Drawing, profile: Profile, limits: Limits, *, is_patch: bool
) -> Verification:
    """Read a file of ours again: layer by layer the same count, length, place and order.

    Args:
        path: the file.
        drawing: what was written into it.
        profile: with which layers.
        limits: see :class:`Limits`.
        is_patch: whether it is the patch itself, whose sheet must hold together.
    """
    read = read_drawing(path)
    faults = [fault for one in read for fault in one.faults]
    for one in read:
        faults += _layer_faults(one, drawing, profile, limits, path)
    measured: dict[str, Any] = {}
    compared = compare(read[0].strokes, drawing, tolerance_mm=limits.tolerance_mm, file=str(path))
    faults += compared.faults
    measured["slits"] = len(compared.slits.ends_mm)
    measured["slits_matched"] = compared.matched
    measured["largest_error_mm"] = compared.largest_error_mm
    if is_patch and compared.outline is not None:
        sheet = judge_sheet(
            compared.slits.ends_mm,
            compared.outline,
            compared.windows,
            kerf_mm=limits.kerf_mm,
            ligament_mm=limits.ligament_mm,
            file=str(path),
        )
        faults += sheet.faults
        measured |= _sheet_numbers(sheet)
    return Verification(path, _numbers(read), measured, tuple(faults))


def verify_foreign(
    path: Path, drawing: Drawing | None, profile: Profile, limits: Limits, *, is_patch: bool = True
) -> Verification:
    """Judge a file that came back from another program.

    Args:
        path: the file; its layers, colours, units and origin may be others.
        drawing: what it should be; None where there is no design to compare with, then only
            the file itself is judged: units, doubles, crossings, ligaments, pieces, order.
        profile: whose layers and colours say what is a mark where there is no design.
        limits: see :class:`Limits`.
        is_patch: whether it is the patch itself, whose sheet must hold together.
    """
    read = read_drawing(path)
    faults = [fault for one in read for fault in one.faults]
    faults += _reader_faults(read, limits, path)
    strokes = read[0].strokes
    measured: dict[str, Any] = {}
    if drawing is not None:
        compared = compare(strokes, drawing, tolerance_mm=limits.tolerance_mm, file=str(path))
        faults += compared.faults
        right_size = compared.scale == 1.0 and not any(
            fault.code == "drawing-stretched" for fault in compared.faults
        )
        faults = [_milder(fault) if right_size else fault for fault in faults]
        measured |= {
            "scale": compared.scale,
            "pose": compared.pose,
            "slits": len(compared.slits.ends_mm),
            "slits_matched": compared.matched,
            "largest_error_mm": compared.largest_error_mm,
        }
        slits, outline, windows = compared.slits, compared.outline, compared.windows
    else:
        slits, outline, windows, own = _alone(strokes, profile, str(path))
        faults += own
        measured["slits"] = len(slits.ends_mm)
    if is_patch and outline is not None:
        sheet = judge_sheet(
            slits.ends_mm,
            outline,
            windows,
            kerf_mm=limits.kerf_mm,
            ligament_mm=limits.ligament_mm,
            file=str(path),
        )
        faults += sheet.faults
        measured |= _sheet_numbers(sheet)
    return Verification(path, _numbers(read), measured, tuple(dict.fromkeys(faults)))


def _milder(fault: Fault) -> Fault:
    """A size that is not stated or in doubt does no harm where the drawing has its right one."""
    if fault.code in ("svg-viewbox-missing", "svg-size-missing", "svg-two-scales"):
        return Fault(
            fault.code, fault.what, fault.remedy, file=fault.file, got=fault.got, severity="warning"
        )
    return fault


def _sheet_numbers(sheet: Sheet) -> dict[str, Any]:
    return {
        "pieces": sheet.pieces,
        "narrowest_ligament_mm": sheet.ligament_mm if np.isfinite(sheet.ligament_mm) else None,
        "area_left_mm2": sheet.area_mm2,
    }


def _numbers(read: Sequence[ReadDrawing]) -> dict[str, dict[str, Any]]:
    return {
        one.reader: {
            "strokes": len(one.strokes),
            "length_mm": one.length_mm,
            "extent_mm": list(one.extent_mm),
        }
        for one in read
        if one.strokes
    }


def _layer_faults(
    read: ReadDrawing, drawing: Drawing, profile: Profile, limits: Limits, path: Path
) -> list[Fault]:
    """Differences of count, length and extent, layer by layer, of a file of ours."""
    found = Findings(str(path))

    def differs(what: str, got: object, expected: object) -> None:
        found.error(
            "export-not-as-drawn",
            f"{read.reader} reads another {what} than was drawn.",
            "This is a bug of kiribench, or of the reader: please report it.",
            got,
            expected,
        )

    layers = {role: layer.name for layer in profile.layers for role in layer.roles}
    upwards = read.reader == "ezdxf"
    order = [layers.get(stroke.layer, stroke.layer) for stroke in read.strokes]
    for layer in profile.layers:
        mine = drawing.of(*layer.roles)
        theirs = [s for s, name in zip(read.strokes, order, strict=True) if name == layer.name]
        if len(mine) != len(theirs):
            differs(f"number of strokes on layer {layer.name}", len(theirs), len(mine))
            continue
        if not mine:
            continue
        length, total = sum(s.length_mm for s in theirs), sum(s.length_mm for s in mine)
        if abs(length - total) > limits.tolerance_mm + _INCH * total:
            differs(f"length on layer {layer.name}", f"{length:.4f} mm", f"{total:.4f} mm")
        points = np.concatenate([s.points_mm for s in theirs])
        if upwards:
            points = points + np.array([0.0, drawing.height_mm])
        own = np.concatenate([s.flattened() for s in mine])
        box = np.concatenate([points.min(axis=0), points.max(axis=0)])
        expected = np.concatenate([own.min(axis=0), own.max(axis=0)])
        if np.max(np.abs(box - expected)) > limits.tolerance_mm + _INCH * drawing.height_mm:
            differs(f"extent on layer {layer.name}", np.round(box, 3), np.round(expected, 3))
        if any(s.colour and s.colour != layer.colour for s in theirs) and not upwards:
            differs(f"colour on layer {layer.name}", theirs[0].colour, layer.colour)
    wanted = [layers[stroke.role] for stroke in drawing.strokes]
    if order != wanted and len(order) == len(wanted):
        differs("order of layers", order[-1], wanted[-1])
    return found.faults


def _reader_faults(read: Sequence[ReadDrawing], limits: Limits, path: Path) -> list[Fault]:
    """Readers that see different things: no program can be trusted with such a file."""
    if len(read) < 2 or not all(one.strokes for one in read):
        return []
    one, two = read[:2]
    size = np.abs(np.array(one.extent_mm) - two.extent_mm).max()
    off = abs(one.length_mm - two.length_mm)
    allowed = limits.tolerance_mm + 10 * _INCH * one.length_mm
    if off <= allowed and size <= limits.tolerance_mm + 10 * _INCH * max(one.extent_mm):
        return []
    return [
        Fault(
            "readers-disagree",
            f"{one.reader} and {two.reader} read different drawings.",
            "Save it as plain SVG: paths only, no clones, no clipping, no nested viewports.",
            file=str(path),
            got=f"{one.length_mm:.3f} and {two.length_mm:.3f} mm of lines",
            severity="warning",
        )
    ]


def _alone(
    strokes: Sequence[ReadStroke], profile: Profile, file: str
) -> tuple[CleanSlits, Polygon | None, tuple[Polygon, ...], list[Fault]]:
    """Slits, outline and windows of a drawing without a design, and its own faults."""
    found = Findings(file)

    kinds = [_kind(stroke, profile) for stroke in strokes]
    if all(kind == "mark" for kind in kinds):
        kinds = ["unknown"] * len(kinds)  # one colour for everything says nothing
    unknown = sorted(
        {
            s.layer or s.colour or "no layer, no colour"
            for s, kind in zip(strokes, kinds, strict=True)
            if kind == "unknown"
        }
    )
    if unknown:
        found.warning(
            "layer-unknown",
            "Layers or colours are not of this machine profile: their lines count as cuts.",
            "Give --profile, or --design: then the lines are told apart by their place.",
            ", ".join(unknown[:6]),
        )
    cutting = [i for i, kind in enumerate(kinds) if kind != "mark"]
    parts = take_apart([strokes[i] for i in cutting])
    if not parts.has_outline:
        found.error(
            "outline-missing",
            "The drawing has no closed outline.",
            "Draw it as one closed path, on the last layer.",
        )
    if parts.ring_twice:
        found.error(
            "outline-twice",
            f"{parts.ring_twice} closed shapes are there twice: the beam would pass twice.",
            "Delete the doubles.",
        )
    outline = parts.rings[0] if parts.has_outline else None
    segments, owner = parts.segments_mm, parts.segment_stroke
    if outline is not None and len(segments):
        roomy = outline.buffer(0.5)
        near = np.array([_touches(roomy, pair) for pair in segments], dtype=bool)
        segments, owner = segments[near], owner[near]
    slits = clean_slits(segments)
    for code, places in (("slit-duplicate", slits.twice), ("slit-overlap", slits.overlapping)):
        if len(places):
            found.error(
                code,
                f"{len(places)} slits cover another one: the beam would pass twice.",
                "Delete the doubles.",
                f"around ({places[0][0]:.2f}, {places[0][1]:.2f}) mm",
            )
    if slits.split:
        found.warning(
            "slit-split",
            f"{slits.split} slits are drawn in several pieces: the beam stops within them.",
            "Join the pieces, or accept the stops.",
        )
    if outline is not None and len(owner):
        inner = [int(owner.max()), *[m for ring in parts.ring_strokes[1:] for m in ring]]
        if max(parts.ring_strokes[0]) < max(inner):
            found.error(
                "outline-not-last",
                "The outline is cut before the last inner cut: the patch is loose by then.",
                "Put the outline last in the file, or on a layer that is worked last.",
            )
    windows = tuple(
        ring for ring in parts.rings[1:] if outline is not None and outline.covers(ring)
    )
    return slits, outline, windows, found.faults


def _touches(roomy: Polygon, pair: Any) -> bool:
    from shapely import LineString

    return bool(roomy.intersects(LineString(pair)))


def _kind(stroke: ReadStroke, profile: Profile) -> str:
    """``cut``, ``mark`` or ``unknown``, by layer, class or colour."""
    profiles = [profile, *[read_profile(name) for name in PROFILES if name != profile.name]]
    for one in profiles:
        for layer in one.layers:
            if stroke.layer.lower() == layer.name.lower() or stroke.layer in layer.roles:
                return "mark" if _is_mark(layer.roles) else "cut"
    for layer in profile.layers:
        if stroke.colour == layer.colour:
            return "mark" if _is_mark(layer.roles) else "cut"
    return "unknown"


def _is_mark(roles: tuple[str, ...]) -> bool:
    return not {"slit", "tile", "slot", "outline"} & set(roles)
