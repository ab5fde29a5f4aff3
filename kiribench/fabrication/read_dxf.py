"""DXF drawings as ezdxf sees them."""

from __future__ import annotations

import io
import itertools
import math
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.errors import DataError
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.reading import (
    LIBRARY_ERRORS,
    SHORTEST_MM,
    ReadDrawing,
    ReadStroke,
    unreadable,
)
from kiribench.fabrication.strokes import FloatArray
from kiribench.fabrication.svg_guard import MOST_ELEMENTS

_FLAT_MM = 0.001
_TEXT = frozenset({"TEXT", "MTEXT", "ATTRIB", "ATTDEF", "DIMENSION", "LEADER", "MULTILEADER"})

_DXF_ERRORS = (*LIBRARY_ERRORS, RecursionError, UnicodeError)
_MM_PER_INSUNIT = {
    0: 1.0,
    1: 25.4,
    2: 304.8,
    4: 1.0,
    5: 10.0,
    6: 1000.0,
    8: 25.4e-6,
    9: 0.0254,
    10: 914.4,
    13: 0.001,
    14: 100.0,
}


def with_ezdxf(data: bytes, path: Path) -> ReadDrawing:
    """Model space with its blocks exploded, in the unit of the header turned into mm."""
    from ezdxf.disassemble import recursive_decompose
    from ezdxf.lldxf.const import DXFError

    found = Findings(str(path))

    strokes: list[ReadStroke] = []
    left_out: dict[str, int] = {}
    off: set[str] = set()
    try:
        document = _ezdxf_document(data)
        code = int(document.header.get("$INSUNITS", 0))
        mm = _MM_PER_INSUNIT.get(code)
        if code == 1:
            found.warning(
                "units-inches",
                "The file states inches ($INSUNITS = 1).",
                "Save it in millimetres ($INSUNITS = 4).",
            )
        elif code == 0:
            found.warning(
                "dxf-no-unit",
                "The file states no unit ($INSUNITS = 0 or absent): taken as millimetres.",
                "Save it in millimetres ($INSUNITS = 4).",
            )
        elif code != 4:
            found.warning(
                "units-not-mm",
                "The file does not state millimetres.",
                "Save it in millimetres ($INSUNITS = 4).",
                f"$INSUNITS = {code}",
            )
        entities = list(
            itertools.islice(recursive_decompose(document.modelspace()), MOST_ELEMENTS + 1)
        )
        if len(entities) > MOST_ELEMENTS:
            raise DataError(
                "drawing-too-large",
                "The file holds more entities than any drawing here.",
                remedy="Save it without blocks that repeat each other.",
                file=path,
            )
        for entity in entities:
            name = str(entity.dxf.layer)
            layer = document.layers.get(name) if name in document.layers else None
            if layer is not None and (layer.is_off() or layer.is_frozen()):
                off.add(name)
            made = _dxf_stroke(entity, mm or 1.0, name, _dxf_colour(entity, layer))
            if made is None:
                left_out[entity.dxftype()] = left_out.get(entity.dxftype(), 0) + 1
            else:
                strokes += made
    except DXFError as error:
        raise unreadable(path, "ezdxf", error) from error
    except _DXF_ERRORS as error:
        raise unreadable(path, "ezdxf", error) from error
    texts = sum(count for kind, count in left_out.items() if kind in _TEXT)
    if texts:
        found.error(
            "text-not-lines",
            f"The file holds {texts} text entities, which lasers replace, drop or engrave.",
            "Explode text to single strokes.",
        )
    others = sorted(set(left_out) - _TEXT)
    if others:
        found.warning(
            "entity-not-line",
            "The file holds entities that are no lines; they were not read.",
            "Explode or delete them.",
            ", ".join(f"{left_out[kind]} {kind}" for kind in others),
        )
    if off:
        found.warning(
            "layer-off",
            "Layers are switched off or frozen: the machine's program may leave them out.",
            "Switch them on, or delete them.",
            ", ".join(sorted(off)),
        )
    return ReadDrawing("ezdxf", tuple(strokes), tuple(found.faults))


def _ezdxf_document(data: bytes) -> Any:
    """The document of the bytes of a DXF file, in the encoding that it states."""
    from ezdxf.filemanagement import read
    from ezdxf.lldxf.validator import dxf_info

    if data.startswith(b"AutoCAD Binary DXF"):
        raise ValueError("a binary DXF; save it as text (ASCII)")
    if not data.strip():
        raise ValueError("the file is empty")
    head = dxf_info(io.StringIO(data[:200_000].decode("latin-1")))
    text = data.decode(head.encoding, errors="surrogateescape").replace("\r\n", "\n")
    return read(io.StringIO(text))


def _dxf_colour(entity: Any, layer: Any) -> str:
    from ezdxf import colors

    rgb = entity.rgb
    if rgb is None:
        index = int(entity.dxf.get("color", 256))
        if index in (0, 256) and layer is not None:
            rgb, index = layer.rgb, abs(int(layer.dxf.get("color", 7)))
        if rgb is None:
            if not 1 <= index <= 255:
                return ""
            rgb = (0, 0, 0) if index == 7 else colors.aci2rgb(index)
    return "#{:02x}{:02x}{:02x}".format(*rgb)


def _dxf_stroke(entity: Any, mm: float, layer: str, colour: str) -> list[ReadStroke] | None:
    """Strokes of one entity; None for what is no line."""
    from ezdxf import path as ezdxf_path

    kind = entity.dxftype()
    if kind == "LINE":
        ends = np.array([(p.x, p.y) for p in (entity.dxf.start, entity.dxf.end)]) * (mm, -mm)
        return _if_long(ReadStroke(ends, float(np.hypot(*(ends[1] - ends[0]))), layer, colour))
    if kind not in {"LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"}:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = ezdxf_path.make_path(entity)
    flat = np.array([(p.x, p.y) for p in whole.flattening(_FLAT_MM / mm, segments=8)])
    if len(flat) < 2 or not np.all(np.isfinite(flat)):
        return None if len(flat) >= 2 else []
    length = _dxf_length(entity, flat)
    return _if_long(ReadStroke(flat * (mm, -mm), length * mm, layer, colour))


def _dxf_length(entity: Any, flat: FloatArray) -> float:
    """Length in the file's unit: exact for arcs and polylines, along the chords for the rest."""
    kind = entity.dxftype()
    if kind == "CIRCLE":
        return 2 * math.pi * float(entity.dxf.radius)
    if kind == "ARC":
        angle = math.radians((entity.dxf.end_angle - entity.dxf.start_angle) % 360 or 360)
        return angle * float(entity.dxf.radius)
    if kind == "LWPOLYLINE":
        return sum(_piece_lengths(entity.get_points("xyb"), bool(entity.closed)))
    return float(np.sum(np.linalg.norm(np.diff(flat, axis=0), axis=1)))


def _piece_lengths(points: Sequence[Any], closed: bool) -> Iterable[float]:
    following = [*points[1:], *points[:1]] if closed else points[1:]
    for (x0, y0, bulge), (x1, y1, _) in zip(points, following, strict=False):
        chord = math.hypot(x1 - x0, y1 - y0)
        if bulge == 0 or chord == 0:
            yield chord
        else:
            angle = 4 * math.atan(abs(bulge))
            yield chord / 2 / math.sin(angle / 2) * angle


def _if_long(stroke: ReadStroke) -> list[ReadStroke]:
    if not np.all(np.isfinite(stroke.points_mm)):
        raise ValueError("a line with a coordinate that is no number")
    return [stroke] if stroke.length_mm > SHORTEST_MM else []
