"""SVG and DXF as written: by the libraries, and by reading the text itself."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from patch_cases import random_design
from shapely import Polygon
from tolerances import FILE_MM

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.dxf import write_dxf
from kiribench.fabrication.patch import PatchOptions, draw_patch, plan_patch
from kiribench.fabrication.profile import PROFILES, read_profile
from kiribench.fabrication.reading import read_drawing
from kiribench.fabrication.strokes import circle, polyline, rounded
from kiribench.fabrication.svg import number, path_data, write_svg


@pytest.fixture(scope="module")
def patch() -> Drawing:
    return draw_patch(plan_patch(random_design(0), PatchOptions(0.15)), "p", read_profile("plain"))


def test_svg_is_in_millimetres_with_a_1_to_1_view_box_and_no_text(patch):
    root = ET.fromstring(write_svg(patch, read_profile("plain")))
    width, height = root.get("width"), root.get("height")
    assert width.endswith("mm")
    assert root.get("viewBox") == f"0 0 {width[:-2]} {height[:-2]}"
    names = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert names == {"svg", "title", "g", "path"}
    groups = [g.get("id") for g in root.iter() if g.tag.endswith("}g")]
    assert groups == ["info", "marks", "slits", "slots", "outline"]
    assert {g.get("fill") for g in root.iter() if g.tag.endswith("}g")} == {"none"}


def test_dxf_read_tag_by_tag_without_any_library(patch):
    """Group codes of the text: unit, layers, and the length of every LINE on the slits' layer."""
    text = write_dxf(patch, read_profile("plain"))
    lines = text.split("\n")
    tags = [(lines[i].strip(), lines[i + 1].strip()) for i in range(0, len(lines) - 1, 2)]
    at = tags.index(("9", "$INSUNITS"))
    assert tags[at + 1] == ("70", "4")
    begin = next(i for i, tag in enumerate(tags) if tag == ("2", "ENTITIES"))
    end = next(i for i in range(begin, len(tags)) if tags[i] == ("0", "ENDSEC"))
    entities: list[dict[str, str]] = []
    for code, value in tags[begin + 1 : end]:
        if code == "0":
            entities.append({"0": value})
        else:
            entities[-1].setdefault(code, value)
    kinds = {entity["0"] for entity in entities}
    assert kinds == {"LINE", "LWPOLYLINE"}
    slits = [e for e in entities if e["8"] == "slits"]
    total = sum(
        math.dist((float(e["10"]), float(e["20"])), (float(e["11"]), float(e["21"]))) for e in slits
    )
    assert len(slits) == 287
    assert total == pytest.approx(patch.length_mm("slit"), abs=FILE_MM)
    assert [e["8"] for e in entities][-1] == "outline"
    assert {e["62"] for e in slits} == {"1"}


@pytest.mark.parametrize("name", PROFILES)
def test_layers_and_colours_are_the_profiles(tmp_path, patch, name):
    profile = read_profile(name)
    drawing = draw_patch(plan_patch(random_design(0), PatchOptions(0.15)), "p", profile)
    path = tmp_path / "p.dxf"
    path.write_text(write_dxf(drawing, profile))
    (read,) = read_drawing(path)
    assert list(dict.fromkeys(s.layer for s in read.strokes)) == [la.name for la in profile.layers]
    path = tmp_path / "p.svg"
    path.write_text(write_svg(drawing, profile))
    colours = list(dict.fromkeys(s.colour for s in read_drawing(path)[0].strokes))
    assert colours == [layer.colour for layer in profile.layers]
    stroke = re.findall(r'stroke-width="([^"]+)"', path.read_text())
    assert set(map(float, stroke)) == {profile.stroke_mm}


def test_every_reader_sees_the_closed_form(tmp_path):
    """A circle, a rounded rectangle and a line, in every reader: count, length, extent, area."""
    profile = read_profile("plain")
    strokes = (
        polyline("slit", [(5, 5), (8, 9)]),
        circle("slot", (20.0, 20.0), 4.0),
        rounded("outline", [(1, 2), (41, 2), (41, 52), (1, 52)], 6.0),
    )
    drawing = Drawing("d", "d", 60.0, 60.0, strokes)
    length = 5 + 8 * math.pi + 180 - 48 + 12 * math.pi
    for suffix, write in ((".svg", write_svg), (".dxf", write_dxf)):
        path = tmp_path / f"d{suffix}"
        path.write_text(write(drawing, profile))
        for read in read_drawing(path):
            assert len(read.strokes) == 3
            assert read.length_mm == pytest.approx(length, abs=FILE_MM)
            x0, y0, x1, y1 = read.extent_mm
            assert (x1 - x0, y1 - y0) == pytest.approx((40, 50), abs=FILE_MM)
            area = Polygon(read.strokes[2].points_mm).area
            assert area == pytest.approx(2000 - (4 - math.pi) * 36, abs=0.1)


def test_the_same_design_gives_the_same_bytes(patch):
    profile = read_profile("plain")
    again = draw_patch(plan_patch(random_design(0), PatchOptions(0.15)), "p", profile)
    assert write_svg(again, profile) == write_svg(patch, profile)
    assert write_dxf(again, profile) == write_dxf(patch, profile)


def test_numbers_are_plain_decimals():
    assert [number(v) for v in (-1e-9, 1e-7, 100.0, -0.25, 1234567.891)] == [
        "0",
        "0",
        "100",
        "-0.25",
        "1234567.891",
    ]
    large = circle("slot", (0.0, 0.0), 1.0)
    assert path_data(large).count("A1 1 0 0 1") == 4
    assert np.isclose(large.length_mm, 2 * math.pi)
