"""Faults put into good files: each is caught by its name, in SVG and in DXF."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from patch_cases import random_design, uniform_design
from shapely import LineString, union_all

from kiribench.errors import DataError
from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.dxf import write_dxf
from kiribench.fabrication.patch import PatchOptions, draw_patch, plan_patch
from kiribench.fabrication.profile import read_profile
from kiribench.fabrication.strokes import Stroke, polyline
from kiribench.fabrication.svg import write_svg
from kiribench.fabrication.verify import Limits, Verification, verify_export, verify_foreign

PLAIN = read_profile("plain")
LIMITS = Limits(kerf_mm=0.15, ligament_mm=0.5)
WRITERS = {".svg": write_svg, ".dxf": write_dxf}


@pytest.fixture(scope="module")
def good() -> Drawing:
    return draw_patch(plan_patch(random_design(0, 4, 3), PatchOptions(0.15)), "p", PLAIN)


def _with(drawing: Drawing, change) -> Drawing:
    return replace(drawing, strokes=tuple(change(list(drawing.strokes))))


def _slit_at(strokes: list[Stroke]) -> int:
    """The longest slit: none that opens in the outline."""
    slits = [i for i, stroke in enumerate(strokes) if stroke.role == "slit"]
    return max(slits, key=lambda i: strokes[i].length_mm)


def _in_given_order(suffix: str, drawing: Drawing) -> str:
    """The file in the drawing's own order of layers, the outline first where it is."""
    roles = list(dict.fromkeys(s.role for s in drawing.strokes))
    if roles[0] != "outline":
        return WRITERS[suffix](drawing, PLAIN)
    layers = tuple(replace(PLAIN.layer_of(role), roles=(role,), name=role) for role in roles)
    return WRITERS[suffix](drawing, replace(PLAIN, layers=layers))


def _verify(tmp_path, drawing, expected, suffix=".svg", text=None, limits=LIMITS) -> Verification:
    path = tmp_path / f"seeded{suffix}"
    path.write_text(text if text is not None else _in_given_order(suffix, drawing))
    return verify_foreign(path, expected, PLAIN, limits)


def _errors(found: Verification) -> set[str]:
    return {fault.code for fault in found.faults if fault.severity == "error"}


def _warnings(found: Verification) -> set[str]:
    return {fault.code for fault in found.faults if fault.severity == "warning"}


@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
@pytest.mark.parametrize("compared", [True, False])
def test_a_good_file_has_no_fault(tmp_path, good, suffix, compared):
    found = _verify(tmp_path, good, good if compared else None, suffix)
    assert found.faults == ()
    assert found.passed
    assert found.measured["pieces"] == 1
    if compared:
        assert found.measured["slits_matched"] == len(good.of("slit"))
        assert found.measured["largest_error_mm"] < 1e-3


def duplicate(strokes):
    i = _slit_at(strokes)
    return [*strokes[:i], strokes[i].reversed(), *strokes[i:]]


def missing(strokes):
    i = _slit_at(strokes)
    return strokes[:i] + strokes[i + 1 :]


def crossing(strokes):
    i = _slit_at(strokes)
    middle = strokes[i].points_mm.mean(axis=0)
    way = strokes[i].points_mm[1] - strokes[i].points_mm[0]
    across = np.array([-way[1], way[0]]) / np.linalg.norm(way)
    return [
        *strokes[:i],
        polyline("slit", [middle - 0.5 * across, middle + 0.5 * across]),
        *strokes[i:],
    ]


def thin(strokes):
    """A slit grows until it nearly touches another one: the first that can."""
    slits = [i for i, s in enumerate(strokes) if s.role == "slit"]
    for i in slits:
        a, b = strokes[i].points_mm
        way = (b - a) / np.linalg.norm(b - a)
        rest = union_all([LineString(strokes[k].points_mm) for k in slits if k != i])
        for grow in np.arange(0.0, 6.0, 0.1):
            if 0.1 < LineString([a, b + grow * way]).distance(rest) < 0.4:
                longer = polyline("slit", [a, b + grow * way])
                return [*strokes[:i], longer, *strokes[i + 1 :]]
    raise AssertionError("no slit that can grow")


def outline_first(strokes):
    return [strokes[-1], *strokes[:-1]]


def shifted(strokes):
    i = _slit_at(strokes)
    return [*strokes[:i], strokes[i].moved((0.05, 0.0)), *strokes[i + 1 :]]


def shortened(strokes):
    i = _slit_at(strokes)
    a, b = strokes[i].points_mm
    return [*strokes[:i], polyline("slit", [a, a + 0.97 * (b - a)]), *strokes[i + 1 :]]


def extra(strokes):
    x, y = strokes[_slit_at(strokes)].points_mm.mean(axis=0) + np.array([1.9, 1.9])
    return [polyline("slit", [(x - 0.5, y), (x + 0.5, y)]), *strokes]


def overlapping(strokes):
    i = _slit_at(strokes)
    a, b = strokes[i].points_mm
    half = polyline("slit", [(a + b) / 2, b + 0.02 * (b - a)])
    return [*strokes[:i], half, *strokes[i:]]


def no_outline(strokes):
    return [s for s in strokes if s.role != "outline"]


def two_outlines(strokes):
    return [*strokes, strokes[-1]]


def no_window(strokes):
    i = next(i for i, s in enumerate(strokes) if s.role == "slot")
    return strokes[:i] + strokes[i + 1 :]


def hoop_cut_off(strokes):
    """Two of the four mm beyond the windows: what is left is a rim that holds."""
    points = strokes[-1].points_mm.copy()
    points[points[:, 1] < points[:, 1].min() + 2, 1] += 2.0
    return [*strokes[:-1], replace(strokes[-1], points_mm=points)]


def gaps_closed(strokes):
    """Two slits in one line are joined to one, as a geometry optimiser does."""
    slits = [i for i, s in enumerate(strokes) if s.role == "slit"]
    for i in slits:
        for j in slits:
            one, two = strokes[i].points_mm, strokes[j].points_mm
            if i < j and np.ptp(np.concatenate([one, two])[:, 1]) < 1e-9:
                xs = np.concatenate([one, two])[:, 0]
                if np.ptp(xs) < 28:
                    joined = polyline("slit", [(xs.min(), one[0, 1]), (xs.max(), one[0, 1])])
                    return [joined if k == i else s for k, s in enumerate(strokes) if k != j]
    raise AssertionError("no two slits in one line")


FAULTS = {
    "slit-duplicate": duplicate,
    "slit-missing": missing,
    "slits-cross": crossing,
    "ligament-thin": thin,
    "outline-not-last": outline_first,
    "slit-length": shortened,
    "slit-extra": extra,
    "slit-overlap": overlapping,
    "outline-missing": no_outline,
    "outline-twice": two_outlines,
    "slot-missing": no_window,
    "outline-changed": hoop_cut_off,
    "gap-closed": gaps_closed,
}


@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
@pytest.mark.parametrize("name", FAULTS)
def test_seeded_fault_is_caught_by_name(tmp_path, good, name, suffix):
    found = _verify(tmp_path, _with(good, FAULTS[name]), good, suffix)
    assert name in _errors(found)
    assert not found.passed


def test_a_shifted_slit_is_named(tmp_path, good):
    assert "slit-length" in _errors(_verify(tmp_path, _with(good, shifted), good))


@pytest.mark.parametrize(
    "name",
    [
        "slit-duplicate",
        "slits-cross",
        "ligament-thin",
        "outline-not-last",
        "outline-missing",
        "slit-overlap",
        "outline-twice",
    ],
)
@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
def test_caught_without_the_design_too(tmp_path, good, name, suffix):
    assert name in _errors(_verify(tmp_path, _with(good, FAULTS[name]), None, suffix))


@pytest.mark.parametrize(
    "name", [name for name in FAULTS if name not in ("ligament-thin", "slits-cross", "gap-closed")]
)
def test_only_the_seeded_fault_is_reported(tmp_path, good, name):
    """No fault drags unrelated ones along (a missing outline hides the order and the sheet)."""
    found = _verify(tmp_path, _with(good, FAULTS[name]), good)
    also = {
        "slit-overlap": {"slit-length"},
        "outline-twice": {"outline-not-last"},
    }
    assert _errors(found) <= {name} | also.get(name, set())


def _scaled(text: str, factor: float) -> str:
    """The SVG with another physical size of the same viewBox."""

    def grow(match):
        return f'{match[1]}="{float(match[2]) * factor:.6f}mm"'

    return re.sub(r'(width|height)="([\d.]+)mm"', grow, text)


@pytest.mark.parametrize(
    ("factor", "name"),
    [
        (1.02, "scale-factor"),
        (0.5, "scale-factor"),
        (25.4, "scale-inches"),
        (1 / 25.4, "scale-inches"),
        (96 / 25.4, "scale-pixels-96"),
        (72 / 25.4, "scale-points-72"),
        (90 / 96, "scale-dpi-96-90"),
        (0.75, "scale-dpi-96-72"),
        (10.0, "scale-centimetres"),
    ],
)
def test_scale_factors_by_name(tmp_path, good, factor, name):
    found = _verify(tmp_path, good, good, text=_scaled(write_svg(good, PLAIN), factor))
    assert _errors(found) - {"ligament-thin"} == {name}
    assert found.measured["scale"] == pytest.approx(factor, rel=1e-4)


@pytest.mark.parametrize(("growth_mm", "named"), [(0.007, False), (0.014, True), (0.019, True)])
def test_extents_are_held_to_the_tolerance_and_not_to_twice_of_it(tmp_path, good, growth_mm, named):
    """Laid centre on centre, a drawing that is 0.019 mm too long is off by half of it."""
    long = np.ptp(good.of("outline")[0].points_mm[:, 1])
    text = _scaled(write_svg(good, PLAIN), 1 + growth_mm / long)
    found = _verify(tmp_path, good, good, text=text)
    assert ("outline-changed" in _errors(found)) == named
    assert found.passed != named


def test_missing_view_box(tmp_path, good):
    text = re.sub(r' viewBox="[^"]*"', "", write_svg(good, PLAIN))
    found = _verify(tmp_path, good, good, text=text)
    assert {"svg-viewbox-missing", "scale-pixels-96"} <= _errors(found)


def test_inches_of_the_right_size_are_a_warning_and_of_the_wrong_size_an_error(tmp_path, good):
    text = write_svg(good, PLAIN)
    right = re.sub(r'="([\d.]+)mm"', lambda m: f'="{float(m[1]) / 25.4:.8f}in"', text)
    found = _verify(tmp_path, good, good, text=right)
    assert (_errors(found), _warnings(found)) == (set(), {"units-inches"})
    wrong = text.replace('mm"', 'in"')
    found = _verify(tmp_path, good, good, text=wrong)
    assert "scale-inches" in _errors(found)
    assert "units-inches" in _warnings(found)


@pytest.mark.parametrize(
    ("unit", "error", "warning"),
    [
        (1, "scale-inches", "units-inches"),
        (5, "scale-centimetres", "units-not-mm"),
        (6, "scale-metres", "units-not-mm"),
        (0, None, "dxf-no-unit"),
    ],
)
def test_dxf_of_another_unit(tmp_path, good, unit, error, warning):
    text = write_dxf(good, PLAIN).replace("$INSUNITS\n 70\n4\n", f"$INSUNITS\n 70\n{unit}\n")
    assert f"$INSUNITS\n 70\n{unit}\n" in text
    found = _verify(tmp_path, good, good, ".dxf", text=text)
    assert _errors(found) - {"ligament-thin"} == ({error} if error else set())
    assert warning in _warnings(found)


def test_dxf_in_inches_with_numbers_in_inches_is_right(tmp_path, good):
    small = _with(good, lambda s: [replace(x, points_mm=x.points_mm / 25.4) for x in s])
    small = replace(small, height_mm=good.height_mm / 25.4)
    text = write_dxf(small, PLAIN).replace("$INSUNITS\n 70\n4\n", "$INSUNITS\n 70\n1\n")
    found = _verify(tmp_path, good, good, ".dxf", text=text)
    assert (_errors(found), _warnings(found)) == (set(), {"units-inches"})


def test_stretched(tmp_path, good):
    text = re.sub(
        r'height="([\d.]+)mm"',
        lambda m: f'height="{float(m[1]) * 1.03}mm"',
        write_svg(good, PLAIN),
        count=1,
    )
    text = text.replace("<svg ", '<svg preserveAspectRatio="none" ', 1)
    assert "drawing-stretched" in _errors(_verify(tmp_path, good, good, text=text))


@pytest.mark.parametrize("design", [random_design(0, 6, 4), uniform_design(0.8, 0.8, 6, 4)])
def test_mirrored_and_turned(tmp_path, design):
    """Also where all cuts are alike: then the label tells."""
    drawing = draw_patch(plan_patch(design, PatchOptions(0.15)), "p", PLAIN)
    width = drawing.width_mm
    mirrored = _with(drawing, lambda s: [x.moved((0, 0), mirror_x_mm=width) for x in s])
    assert _errors(_verify(tmp_path, mirrored, drawing)) == {"drawing-mirrored"}

    def turn(x):
        return replace(x, points_mm=np.array([width, drawing.height_mm]) - x.points_mm)

    found = _verify(tmp_path, _with(drawing, lambda s: list(map(turn, s))), drawing)
    assert (_errors(found), _warnings(found)) == (set(), {"drawing-turned"})

    def quarter(x):
        return replace(x, points_mm=x.points_mm[:, ::-1] * (-1, 1) + (drawing.height_mm, 0))

    quarters = replace(
        _with(drawing, lambda s: list(map(quarter, s))),
        width_mm=drawing.height_mm,
        height_mm=drawing.width_mm,
    )
    found = _verify(tmp_path, quarters, drawing)
    assert (_errors(found), _warnings(found)) == (set(), {"drawing-turned"})
    assert found.measured["slits_matched"] == len(drawing.of("slit"))


def test_an_outline_and_slits_in_pieces_are_put_together(tmp_path, good):
    """Exploded to single lines and arcs, as many programs export: right, with a warning."""

    def explode(strokes):
        pieces = []
        for stroke in strokes:
            if stroke.role in ("outline", "slot"):
                for a, b, bulge in zip(*stroke.pieces, strict=True):
                    pieces.append(Stroke(stroke.role, np.array([a, b]), np.array([bulge, 0.0])))
            elif stroke.role == "slit" and np.ptp(stroke.points_mm) > 5:
                a, b = stroke.points_mm
                middle = 0.4 * a + 0.6 * b
                pieces += [polyline("slit", [a, middle]), polyline("slit", [b, middle])]
            else:
                pieces.append(stroke)
        return pieces

    for suffix in WRITERS:
        found = _verify(tmp_path, _with(good, explode), good, suffix)
        assert (_errors(found), _warnings(found)) == (set(), {"slit-split"})
        assert found.measured["slits_matched"] == len(good.of("slit"))


def test_other_layers_colours_and_origin_are_no_fault(tmp_path, good):
    text = write_svg(good, PLAIN)
    text = re.sub(r'stroke="#[0-9a-f]{6}"', 'stroke="#123456"', text)
    text = re.sub(r' (id|class|inkscape:label)="[^"]*"', "", text)
    text = text.replace(
        "<g inkscape:groupmode", '<g transform="translate(17.3 -4.2)" inkscape:groupmode'
    )
    found = _verify(tmp_path, good, good, text=text)
    assert found.faults == ()
    alone = _verify(tmp_path, good, None, text=text)
    assert "layer-unknown" in _warnings(alone)


def test_an_outline_that_cuts_into_the_windows_is_thin_too(tmp_path, good):
    def deeper(strokes):
        return hoop_cut_off([*strokes[:-1], hoop_cut_off(strokes)[-1]])

    found = _verify(tmp_path, _with(good, deeper), good)
    assert _errors(found) >= {"outline-changed", "ligament-thin"}


def test_marks_that_were_dropped_are_a_warning(tmp_path, good):
    bare = _with(good, lambda s: [x for x in s if x.role != "label"])
    found = _verify(tmp_path, bare, good)
    assert (_errors(found), _warnings(found)) == (set(), {"marks-missing"})


def test_text_and_pictures_are_no_lines(tmp_path, good):
    text = write_svg(good, PLAIN).replace("</svg>", "<text>S1</text><image href=''/></svg>")
    assert {"text-not-lines", "picture-not-lines"} <= _errors(
        _verify(tmp_path, good, good, text=text)
    )
    hidden = write_svg(good, PLAIN).replace('<g id="marks"', '<g style="display: none" id="marks"')
    assert "layer-off" in _warnings(_verify(tmp_path, good, good, text=hidden))


def test_outlined_slits_are_named(tmp_path, good):
    """A program that turns strokes into shapes: each slit becomes a thin ring."""

    def outlined(strokes):
        i = _slit_at(strokes)
        (x0, y0), (x1, y1) = np.sort(strokes[i].points_mm, axis=0)
        w = 0.05
        ring = [(x0 - w, y0 - w), (x1 + w, y0 - w), (x1 + w, y1 + w), (x0 - w, y1 + w)]
        return [*strokes[:i], polyline("slit", ring, closed=True), *strokes[i + 1 :]]

    assert {"slot-extra", "slit-missing"} <= _errors(_verify(tmp_path, _with(good, outlined), good))


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        (
            "a.svg",
            '<svg xmlns="http://www.w3.org/2000/svg" width="1mm" height="1mm" viewBox="0 0 1 1"/>',
            "drawing-empty",
        ),
        ("a.dxf", "  0\nSECTION\n  2\nENTITIES\n  0\nENDSEC\n  0\nEOF\n", "drawing-empty"),
        ("a.dxf", "no dxf at all", "drawing-unreadable"),
        ("a.dxf", "", "drawing-unreadable"),
        ("a.pdf", "%PDF", "drawing-format"),
        ("a.svg", '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L nan nan"/></svg>', None),
    ],
)
def test_files_that_are_no_drawings(tmp_path, good, name, content, code):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DataError) as caught:
        verify_foreign(path, good, PLAIN, LIMITS)
    assert code is None or caught.value.code == code
    with pytest.raises(DataError) as caught:
        verify_foreign(tmp_path / "none.svg", good, PLAIN, LIMITS)
    assert caught.value.code == "drawing-missing"


@pytest.mark.parametrize("suffix", [".svg", ".dxf"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.99])
def test_truncated_files(tmp_path, good, suffix, share):
    text = WRITERS[suffix](good, PLAIN)
    path = tmp_path / f"cut{suffix}"
    path.write_text(text[: int(share * len(text))])
    try:
        found = verify_foreign(path, good, PLAIN, LIMITS)
    except DataError as error:
        assert error.code in {"svg-syntax", "drawing-unreadable", "drawing-empty"}
    else:
        assert not found.passed


def test_the_writers_own_check_sees_a_file_that_is_not_as_drawn(tmp_path, good):
    for suffix, write in WRITERS.items():
        path = tmp_path / f"own{suffix}"
        path.write_text(write(good, PLAIN))
        assert verify_export(path, good, PLAIN, LIMITS, is_patch=True).faults == ()
        for change in (missing, shortened, outline_first):
            path.write_text(_in_given_order(suffix, _with(good, change)))
            assert not verify_export(path, good, PLAIN, LIMITS, is_patch=True).passed
