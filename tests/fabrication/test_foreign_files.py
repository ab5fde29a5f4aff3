"""Files of other programs' making: right ones are accepted, wrong ones named."""

from __future__ import annotations

from dataclasses import replace

import foreign_dxf
import foreign_svg
import numpy as np
import pytest
from patch_cases import random_design

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.patch import PatchOptions, draw_patch, plan_patch
from kiribench.fabrication.profile import read_profile
from kiribench.fabrication.strokes import polyline
from kiribench.fabrication.verify import Limits, Verification, verify_foreign

PLAIN = read_profile("plain")
LIMITS = Limits(kerf_mm=0.15, ligament_mm=0.5)
WRITERS = [
    *((writer, ".svg") for writer in foreign_svg.RIGHT),
    *((writer, ".dxf") for writer in foreign_dxf.RIGHT),
]
NAMES = [writer.__name__ for writer, _ in WRITERS]
#: What a right file of that kind is warned of all the same.
KNOWN = {
    "pixels": {"units-not-mm"},
    "illustrator": {"units-not-mm"},
    # svgpathtools does not follow use.
    "clones": {"readers-disagree"},
    "r12_lines_and_arcs": {"dxf-no-unit"},
    "r12_polylines": {"dxf-no-unit"},
    "inches": {"units-inches"},
}


@pytest.fixture(scope="module")
def good() -> Drawing:
    return draw_patch(plan_patch(random_design(0, 3, 2), PatchOptions(0.15)), "p", PLAIN)


def _verify(tmp_path, text: str, expected: Drawing | None, suffix: str = ".svg") -> Verification:
    path = tmp_path / f"foreign{suffix}"
    path.write_text(text)
    return verify_foreign(path, expected, PLAIN, LIMITS)


def _codes(found: Verification, severity: str) -> set[str]:
    return {fault.code for fault in found.faults if fault.severity == severity}


@pytest.mark.parametrize(("writer", "suffix"), WRITERS, ids=NAMES)
def test_a_right_file_is_accepted(tmp_path, good, writer, suffix):
    found = _verify(tmp_path, writer(good), good, suffix)
    assert _codes(found, "error") == set()
    assert _codes(found, "warning") == KNOWN.get(writer.__name__, set())
    assert found.measured["slits_matched"] == len(good.of("slit"))
    assert found.measured["pose"] == "as drawn" and found.measured["pieces"] == 1


def _short(strokes):
    """One slit .05 mm shorter: five times the tolerance."""
    i = next(k for k, s in enumerate(strokes) if s.role == "slit")
    a, b = strokes[i].points_mm
    way = (b - a) / np.linalg.norm(b - a)
    return [*strokes[:i], polyline("slit", [a, b - 0.05 * way]), *strokes[i + 1 :]]


def _twice(strokes):
    i = next(k for k, s in enumerate(strokes) if s.role == "slit")
    return [*strokes[:i], strokes[i].reversed(), *strokes[i:]]


def _gone(strokes):
    i = next(k for k, s in enumerate(strokes) if s.role == "slit")
    return strokes[:i] + strokes[i + 1 :]


def _mirrored(strokes):
    return [s.moved((0.0, 0.0), mirror_x_mm=59.0) for s in strokes]


FAULTS = {
    "slit-length": _short,
    "slit-duplicate": _twice,
    "slit-missing": _gone,
    "drawing-mirrored": _mirrored,
}


@pytest.mark.parametrize("k", range(len(WRITERS)), ids=NAMES)
def test_a_wrong_file_of_the_same_making_is_named(tmp_path, good, k):
    """Each writer gets one of the faults in turn, and nothing else is named."""
    writer, suffix = WRITERS[k]
    name = list(FAULTS)[k % len(FAULTS)]
    wrong = replace(good, strokes=tuple(FAULTS[name](list(good.strokes))))
    assert _codes(_verify(tmp_path, writer(wrong), good, suffix), "error") == {name}


@pytest.mark.parametrize(
    ("text_of", "suffix", "name"),
    [
        # Points taken for pixels; the viewBox of 96 or 90 pixels an inch taken for millimetres.
        (lambda d: foreign_svg.illustrator(d).replace('pt" ', 'px" '), ".svg", "scale-dpi-96-72"),
        (lambda d: foreign_svg.pixels(d).replace('px" ', 'mm" '), ".svg", "scale-pixels-96"),
        (lambda d: foreign_svg.corel(d).replace('mm" ', 'cm" '), ".svg", "scale-centimetres"),
        # An insert of another scale, a page flipped once only, a scale that was not applied.
        (
            lambda d: foreign_svg.inkscape_turned(d).replace("scale(0.5)", "scale(0.505)"),
            ".svg",
            "scale-factor",
        ),
        (
            lambda d: foreign_svg.upside_down(d).replace("matrix(1 0 0 -1", "matrix(1 0 0 1"),
            ".svg",
            "drawing-mirrored",
        ),
        # R12 has no unit: numbers in inches are taken for millimetres.
        (lambda d: foreign_dxf.inches(d).replace("$INSUNITS\n 70\n1\n", "$INSUNITS\n 70\n4\n"),
         ".dxf", "scale-inches"),
        (
            lambda d: foreign_dxf.seen_from_below(d).replace("230\n-1.0\n", "230\n1.0\n"),
            ".dxf",
            "drawing-mirrored",
        ),
        (lambda d: foreign_dxf.blocks(d).replace(" 42\n2.0\n", " 42\n2.02\n"), ".dxf",
         "drawing-stretched"),
    ],
)  # fmt: skip
def test_a_wrong_reading_of_units_and_transforms_is_named(tmp_path, good, text_of, suffix, name):
    found = _verify(tmp_path, text_of(good), good, suffix)
    assert name in _codes(found, "error")


@pytest.mark.parametrize("degrees", [1.0, -37.5, 91.0])
def test_turned_by_any_angle(tmp_path, good, degrees):
    body = "".join(f'<path {foreign_svg.INK} d="{foreign_svg.absolute(s)}"/>' for s in good.strokes)
    text = foreign_svg.page(good, f'<g transform="rotate({degrees} 50 50)">{body}</g>')
    found = _verify(tmp_path, text, good)
    assert (_codes(found, "error"), _codes(found, "warning")) == (set(), {"drawing-turned"})
    assert found.measured["slits_matched"] == len(good.of("slit"))
    wrong = replace(good, strokes=tuple(_short(list(good.strokes))))
    body = "".join(
        f'<path {foreign_svg.INK} d="{foreign_svg.absolute(s)}"/>' for s in wrong.strokes
    )
    text = foreign_svg.page(good, f'<g transform="rotate({degrees} 50 50)">{body}</g>')
    assert _codes(_verify(tmp_path, text, good), "error") == {"slit-length"}


def test_a_page_of_another_ratio_is_centred_by_the_rules_and_stretched_on_request(tmp_path, good):
    text = foreign_svg.letterboxed(good)
    found = _verify(tmp_path, text, good)
    assert (_codes(found, "error"), _codes(found, "warning")) == (set(), {"svg-two-scales"})
    # Without a design nobody knows which size is right.
    assert "svg-two-scales" in _codes(_verify(tmp_path, text, None), "error")
    stretched = text.replace("<svg ", '<svg preserveAspectRatio="none" ', 1)
    assert "drawing-stretched" in _codes(_verify(tmp_path, stretched, good), "error")


def test_templates_are_not_drawn_where_they_stand(tmp_path, good):
    body = "".join(f'<path {foreign_svg.INK} d="{foreign_svg.absolute(s)}"/>' for s in good.strokes)
    clip = '<clipPath id="c"><rect width="90" height="190"/></clipPath>'
    for inside in (
        f'<symbol id="s">{body}</symbol><use xlink:href="#s"/>',
        f'{clip}<g clip-path="url(#c)">{body}</g>',
        f'<svg x="3" y="4" width="{good.width_mm}" height="{good.height_mm}">{body}</svg>',
    ):
        assert _codes(_verify(tmp_path, foreign_svg.page(good, inside), good), "error") == set()


def test_a_frame_around_the_page_is_named(tmp_path, good):
    for paint in ('fill="#fff"', foreign_svg.INK):
        text = foreign_svg.rectangles(good)
        frame = f'<rect width="{good.width_mm}" height="{good.height_mm}" {paint}/>'
        text = text.replace("><path", f">{frame}<path", 1)
        found = _verify(tmp_path, text, good)
        assert _codes(found, "error") == {"frame-extra"}
        assert found.measured["slits_matched"] == len(good.of("slit"))


@pytest.mark.parametrize(
    "styled",
    [
        '<g style="fill:none; transform : scale(2)">{}</g>',
        "<style>.x {{ transform: translate(3px, 4px) }}</style>{}",
    ],
)
def test_a_transform_in_a_style_is_named(tmp_path, good, styled):
    body = "".join(f'<path {foreign_svg.INK} d="{foreign_svg.absolute(s)}"/>' for s in good.strokes)
    found = _verify(tmp_path, foreign_svg.page(good, styled.format(body)), good)
    assert "svg-styled-transform" in _codes(found, "error")


def test_one_colour_for_everything_says_nothing(tmp_path, good):
    """Black is the colour of marks, but a drawing all in black is no drawing of marks."""
    bare = replace(good, strokes=tuple(good.of("slit", "slot", "outline")))
    text = foreign_svg.corel(bare).replace("#ff0000", "#000000")
    for suffix, content in ((".svg", text), (".dxf", foreign_dxf.r12_polylines(bare))):
        found = _verify(tmp_path, content, None, suffix)
        assert _codes(found, "error") == set()
        assert "layer-unknown" in _codes(found, "warning")
        assert found.measured["slits"] == len(good.of("slit"))
        assert found.measured["pieces"] == 1
