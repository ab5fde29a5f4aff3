"""Drawings as DXF R2000: $INSUNITS 4 (millimetres), one layer a kind of work, y upwards."""

from __future__ import annotations

import io

from ezdxf import options, units  # type: ignore[attr-defined]
from ezdxf.filemanagement import new

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.strokes import Stroke


def write_dxf(drawing: Drawing, profile: Profile) -> str:
    """The text of the DXF file; the same drawing gives the same text.

    Straight strokes of two points are LINE, all others LWPOLYLINE with bulges; colours are set
    on every entity too, for programs that do not look at the layer's.
    """
    # No time stamps and no random identifiers: the same drawing is the same file.
    fixed = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        document = new("R2000", units=units.MM)
        document.header["$MEASUREMENT"] = 1
        document.header["$EXTMIN"] = (0.0, 0.0, 0.0)
        document.header["$EXTMAX"] = (drawing.width_mm, drawing.height_mm, 0.0)
        document.header["$LIMMAX"] = (drawing.width_mm, drawing.height_mm)
        space = document.modelspace()
        for layer in profile.layers:
            strokes = drawing.of(*layer.roles)
            if not strokes:
                continue
            document.layers.add(layer.name, color=layer.aci)
            marks = {"layer": layer.name, "color": layer.aci}
            for stroke in strokes:
                points = _upwards(stroke, drawing.height_mm)
                if len(points) == 2 and not stroke.closed and points[0][2] == 0:
                    space.add_line(points[0][:2], points[1][:2], dxfattribs=marks)
                else:
                    space.add_lwpolyline(
                        points, format="xyb", close=stroke.closed, dxfattribs=marks
                    )
        text = io.StringIO()
        document.write(text)
    finally:
        options.write_fixed_meta_data_for_testing = fixed
    return text.getvalue()


def _upwards(stroke: Stroke, height_mm: float) -> list[tuple[float, float, float]]:
    """(x, y, bulge) of every vertex with y pointing up; arcs turn the other way then."""
    return [
        (float(x), float(height_mm - y), float(-bulge) if bulge else 0.0)
        for (x, y), bulge in zip(stroke.points_mm, stroke.bulge, strict=True)
    ]
