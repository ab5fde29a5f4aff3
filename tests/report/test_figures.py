"""Each drawing says what its numbers say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from report_cases import cylinder_mesh
from tolerances import REPORT_LIGHTNESS_STEP

from kiribench.report.figures.cellmap import Sheet
from kiribench.report.figures.grades import grade_map
from kiribench.report.figures.heatmap import heatmap, scale_limit, short
from kiribench.report.figures.outlines import outline_card
from kiribench.report.figures.regions import label_places, region_map
from kiribench.report.figures.surface_view import surface_view
from kiribench.report.palette import DIVERGING, GRADE_FILL, GRADE_INK, SEQUENTIAL, ink_on
from kiribench.report.svg import canvas, drawing, inline_svg

SVG = "{http://www.w3.org/2000/svg}"


def texts(svg: str) -> dict[str, list[tuple[float, float]]]:
    """Words of a drawing -> where they stand."""
    found: dict[str, list[tuple[float, float]]] = {}
    for node in ElementTree.fromstring(svg).iter(f"{SVG}text"):
        where = (float(node.get("x", "nan")), float(node.get("y", "nan")))
        if np.isnan(where[0]):
            moved = re.search(r"translate\(([-\d.]+) ([-\d.]+)\)", node.get("transform", ""))
            assert moved, ElementTree.tostring(node)
            where = (float(moved[1]), float(moved[2]))
        found.setdefault("".join(node.itertext()), []).append(where)
    return found


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def lightness(colour: str) -> float:
    """CIE L*, 0 to 100."""
    y = luminance(colour)
    return 116 * y ** (1 / 3) - 16 if y > 0.008856 else 903.3 * y


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def example_grades(mirrored: bool) -> str:
    return grade_map(
        [["good", "poor"], ["fair", None]],
        np.array([[0.95, 0.5], [0.8, np.nan]]),
        [["A", "A"], ["B", "B"]],
        np.array([[False, False], [True, False]]),
        mirrored=mirrored,
        alt="test",
    )


def test_the_grade_map_writes_letter_and_overlap_of_every_cell() -> None:
    words = texts(example_grades(mirrored=False))
    # One letter in the map and one in the key.
    assert [len(words[letter]) for letter in "GFP"] == [2, 2, 2]
    assert {"0.95", "0.50", "0.80", "n/a"} <= set(words)


def test_cells_whose_grade_is_contested_have_a_corner() -> None:
    """The corner of cell (1, 0) and the one of the key; no other triangle."""
    svg = example_grades(mirrored=False)
    words = texts(svg)
    triangles = [
        np.array(re.findall(r"([-\d.]+) ([-\d.]+)", path), dtype=float)
        for path in re.findall(r'<path d="([^"]+)"', svg)
        if path.count("L") == 2 and path.rstrip().endswith("z")
    ]
    assert len(triangles) == 2
    x, y = triangles[0].max(axis=0)[0], triangles[0].min(axis=0)[1]
    assert 0 < x - words["0.80"][0][0] < 48
    assert 0 < words["0.80"][0][1] - y < 48


def test_the_picture_of_the_skin_has_the_letter_of_every_cell_in_sight() -> None:
    outline = np.array([[-5.0, -5.0, 9.0], [-5.0, 5.0, 9.0], [5.0, 5.0, 9.0], [5.0, -5.0, 9.0]])
    cells = np.stack([outline, outline + np.array([12.0, 0, 0]), outline + np.array([24.0, 0, 0])])[
        None
    ]
    on_edge = cells[0, 2].copy()
    on_edge[:, 0] = on_edge[:, 2] = 20.0
    on_edge[:2, 2] = 30.0
    cells[0, 2] = on_edge
    mesh = cylinder_mesh(step_mm=20.0)
    svg = surface_view(
        mesh.vertices_mm, mesh.faces, cells, cells, np.array([["good", "poor", "fair"]]), alt="t"
    )
    words = texts(svg)
    assert len(words["G"]) == len(words["P"]) == 1
    assert words["G"][0][0] < words["P"][0][0]
    assert "F" not in words  # seen edge-on
    assert svg.count("<image") == 1


def test_a_left_leg_is_drawn_with_lateral_at_the_right() -> None:
    right, left = texts(example_grades(mirrored=False)), texts(example_grades(mirrored=True))
    assert right["0.95"][0][0] < right["0.50"][0][0]
    assert left["0.95"][0][0] > left["0.50"][0][0]
    assert right["lateral"][0][0] < right["medial"][0][0]
    assert left["lateral"][0][0] > left["medial"][0][0]


def test_proximal_is_up() -> None:
    words = texts(example_grades(mirrored=False))
    assert words["proximal ↑"][0][1] < words["0.95"][0][1] < words["0.80"][0][1]


def test_the_region_map_writes_share_and_counts() -> None:
    svg = region_map([["S", "S"], ["P", "P"]], {"S": (1, 2), "P": (2, 2)}, mirrored=False, alt="t")
    words = texts(svg)
    assert {"S", "50 %", "1 of 2", "P", "100 %", "2 of 2"} <= set(words)
    assert words["S"][0][1] < words["P"][0][1]


def test_a_label_stands_in_the_middle_of_a_block() -> None:
    assert label_places([["a", "a", "b"], ["a", "a", "b"]])["a"] == (0.5, 0.5)


def test_labels_stand_inside_their_region_whatever_its_shape() -> None:
    ring = [["a", "a", "a"], ["a", "b", "a"], ["a", "a", "a"]]
    places = label_places(ring)
    assert places["b"] == (1, 1)
    row, column = places["a"]
    assert ring[int(row)][int(column)] == "a"
    split = [["a", "b", "a"], ["a", "b", "b"]]
    assert label_places(split)["a"] == (0.5, 0.0)


def test_long_and_hostile_labels_do_not_break_the_drawing() -> None:
    svg = region_map([["$x^2$<b>", "ok"]], {}, mirrored=False, alt='"><script>')
    words = texts(svg)
    assert "$x^2$…" in words
    assert "<script" not in svg


def test_the_heatmap_writes_values_reasons_and_asterisks() -> None:
    values = np.array([[0.25, -0.5], [np.nan, 1.5]])
    svg = heatmap(
        values,
        limit=1.0,
        label="nu",
        mirrored=False,
        name="map",
        alt="t",
        reasons={(1, 0): "s"},
        doubtful=np.array([[True, False], [False, False]]),
    )
    words = texts(svg)
    assert {".25*", "−.50", "s", "1.50", "−1", "0", "+1"} <= set(words)


def fills(svg: str) -> list[str]:
    return re.findall(r"fill: (#[0-9a-f]{6}); stroke: #ffffff", svg)


def test_a_value_has_its_colour_of_the_scale() -> None:
    values = np.array([[-0.4, 0.0, 0.4, 0.8]])
    svg = heatmap(values, limit=0.4, label="x", mirrored=False, name="m", alt="t")
    low, middle, high, beyond = fills(svg)
    assert low == DIVERGING[0]
    assert lightness(middle) == pytest.approx(lightness(DIVERGING[3]), abs=1.0)
    assert high == beyond == DIVERGING[-1]


def test_values_beyond_the_scale_give_it_arrows() -> None:
    def arrows(top: float) -> int:
        svg = heatmap(np.array([[top]]), limit=1.0, label="x", mirrored=False, name="m", alt="t")
        return svg.count("<path")

    assert arrows(1.5) == arrows(1.0) + 2


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.254, ".25"), (-0.5, "−.50"), (-0.001, "0"), (0.0, "0"), (1.0, "1.00"), (-1.25, "−1.25"),
     (10.0, "10.00"), (-10.05, "−10.05"), (0.999, "1.00")],
)  # fmt: skip
def test_short_numbers(value: float, shown: str) -> None:
    assert short(value) == shown


def test_scales_hold_all_values_and_are_shared() -> None:
    along, across = np.array([0.02, 0.43]), np.array([-0.21, np.nan])
    assert scale_limit(along, across) == 0.5
    assert scale_limit(np.array([7.3])) == 8
    assert scale_limit(np.array([7.3]), ceiling=2.0) == 2
    assert scale_limit(np.array([np.nan])) > 0


def test_the_tint_of_the_outline_card_is_the_intersection() -> None:
    skin = np.array([[-7.0, -7.0], [-7.0, 7.0], [7.0, 7.0], [7.0, -7.0]])
    moved = skin + np.array([0.0, 3.5])
    svg = outline_card(
        skin, moved, [("shift 3.5 mm", 0.25), ("rest", 0.0)],
        half_mm=12.0, cost_limit=0.5, mirrored=False, name="card", alt="t",
    )  # fmt: skip
    tint = re.search(r'<path d="([^"]+)"[^>]*fill: #f3c9a5', svg)
    assert tint is not None
    points = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", tint[1]), dtype=float)
    width, height = np.ptp(points, axis=0)
    # 14 - 3.5 mm of 14 mm are covered, in the lateral direction, which runs across.
    assert width / height == pytest.approx(10.5 / 14.0, rel=1e-3)
    assert {"shift 3.5 mm", "0.25", "5 mm"} <= set(texts(svg))


def test_shift_towards_medial_goes_left_on_a_left_leg() -> None:
    skin = np.array([[-7.0, -7.0], [-7.0, 7.0], [7.0, 7.0], [7.0, -7.0]])
    moved = skin + np.array([0.0, 3.5])

    def middle(mirrored: bool) -> float:
        svg = outline_card(
            skin, moved, [], half_mm=12.0, cost_limit=0.5, mirrored=mirrored,
            name="card", alt="t",
        )  # fmt: skip
        dashed = re.search(r'<path d="([^"]+)"[^>]*stroke-dasharray', svg)
        assert dashed is not None
        return float(np.mean(np.array(re.findall(r"(-?[\d.]+) -?[\d.]+", dashed[1]), dtype=float)))

    assert middle(mirrored=False) > 150 > middle(mirrored=True)


def test_grades_differ_in_lightness_and_letters_are_readable() -> None:
    levels = sorted(lightness(colour) for colour in GRADE_FILL.values())
    assert min(np.diff(levels)) > REPORT_LIGHTNESS_STEP
    for grade, fill in GRADE_FILL.items():
        assert contrast(fill, GRADE_INK[grade]) >= 4.5  # WCAG 2.2, 1.4.3


def test_the_diverging_scale_is_even_and_balanced() -> None:
    levels = np.array([lightness(colour) for colour in DIVERGING])
    middle = len(levels) // 2
    assert np.argmax(levels) == middle
    assert np.all(np.diff(levels[: middle + 1]) > REPORT_LIGHTNESS_STEP)
    assert np.all(np.diff(levels[middle:]) < -REPORT_LIGHTNESS_STEP)
    assert np.abs(levels - levels[::-1]).max() < REPORT_LIGHTNESS_STEP


def test_numbers_on_every_colour_of_a_map_are_readable() -> None:
    from matplotlib.colors import LinearSegmentedColormap, to_hex

    for colours in (DIVERGING, SEQUENTIAL):
        scale = LinearSegmentedColormap.from_list("scale", colours)
        for part in np.linspace(0, 1, 101):
            fill = scale(part)[:3]
            assert contrast(to_hex(fill), ink_on(fill)) >= 4.5


def test_drawings_are_deterministic_and_their_ids_unique() -> None:
    def hatched(name: str) -> str:
        with drawing():
            sheet = Sheet(1, 1)
            figure, axes = sheet.open()
            sheet.box(axes, 0, 0, facecolor="white", hatch="////")
            axes.scatter([0.2, 0.8], [0.5, 0.5])
            return inline_svg(figure, name, "t")

    one, again, other = hatched("one"), hatched("one"), hatched("two")
    assert one == again
    ids = [set(re.findall(r' id="([^"]+)"', svg)) for svg in (one, other)]
    assert len(ids[0]) >= 2
    assert "href=" in one
    assert not ids[0] & ids[1]
    for svg in (one, other):
        used = set(re.findall(r"url\(#([^)]+)\)", svg)) | set(re.findall(r'href="#([^"]+)"', svg))
        assert used <= set(re.findall(r' id="([^"]+)"', svg))


def test_the_users_matplotlibrc_does_not_change_a_drawing() -> None:
    import matplotlib as mpl

    plain = example_grades(mirrored=False)
    with mpl.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "svg.fonttype": "path"}):
        assert example_grades(mirrored=False) == plain


def test_a_figure_name_that_is_no_id_is_refused() -> None:
    with pytest.raises(ValueError, match="figure name"):
        inline_svg(canvas(10, 10), "a b", "t")


def test_the_test_cylinder_looks_outwards() -> None:
    for side in ("right", "left"):
        mesh = cylinder_mesh(side, step_mm=20.0)
        middles = mesh.corners_mm.mean(axis=1) * [1, 0, 1]
        assert np.all(np.einsum("fx,fx->f", mesh.face_normals, middles) > 0)
