"""The drawings: what is on them, where it lies, and in which order it is cut."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from patch_cases import random_design, uniform_design
from shapely import LineString, Polygon

from kiribench.fabrication.drawing import MARGIN_MM
from kiribench.fabrication.foam import draw_coupon, draw_foam, draw_template
from kiribench.fabrication.patch import PatchOptions, draw_patch, plan_patch
from kiribench.fabrication.profile import PROFILES, read_profile
from kiribench.fabrication.strokes import CUT_ROLES

PLAIN = read_profile("plain")

SHAPES = [
    uniform_design(0.9, 0.9),
    random_design(0, side="left"),
    uniform_design(0.0, 0.0, side="", participant=""),
    random_design(2, 3, 3, cell=6.0, participant="A-VERY-LONG-NAME"),
    random_design(4, 1, 1, cell=20.0, side="left"),
    random_design(5, 4, 9, cell=10.0),
]


def _lines(strokes) -> list[LineString]:
    return [LineString(stroke.flattened()) for stroke in strokes]


@pytest.mark.parametrize("design", SHAPES)
@pytest.mark.parametrize("hoops", [True, False])
def test_marks_keep_clear_of_every_cut_and_lie_on_the_patch(design, hoops):
    options = PatchOptions(0.15) if hoops else PatchOptions(0.15, None)
    plan = plan_patch(design, options)
    drawing = draw_patch(plan, "patch", PLAIN)
    cuts = shapely.union_all(_lines(drawing.of("slit", "slot", "outline")))
    sheet = Polygon(drawing.of("outline")[0].flattened())
    slits = shapely.union_all(_lines(drawing.of("slit", "slot")))
    for mark in _lines(drawing.of("label", "fiducial")):
        assert sheet.covers(mark)
        assert slits.is_empty or mark.distance(slits) > 0.3
    for word in _lines(drawing.of("label")):
        assert word.distance(cuts) > 0.3
    for words in _lines(drawing.of("info")):
        assert words.distance(sheet) > 1.0
        x0, y0, x1, y1 = words.bounds
        assert min(x0, y0) >= MARGIN_MM - 1e-9
        assert x1 <= drawing.width_mm - MARGIN_MM + 1e-9
        assert y1 <= drawing.height_mm
    # No word lies on another one: the boxes of label and of registration marks are apart.
    for word in _lines(drawing.of("label")):
        assert all(word.distance(mark) > 0.2 for mark in _lines(drawing.of("fiducial")))


@pytest.mark.parametrize("name", PROFILES)
def test_order_of_work_inner_first_outline_last(name):
    drawing = draw_patch(plan_patch(random_design(0), PatchOptions()), "patch", read_profile(name))
    roles = [stroke.role for stroke in drawing.strokes]
    assert roles[-1] == "outline"
    assert roles.count("outline") == 1
    assert max(i for i, r in enumerate(roles) if r == "slit") < roles.index("slot")
    marks = [i for i, r in enumerate(roles) if r not in CUT_ROLES]
    assert max(marks) < roles.index("slit")
    assert roles.count("slit") == 287
    assert roles.count("slot") == 14


def test_a_left_patch_is_the_mirror_image_with_readable_words():
    right = plan_patch(random_design(0), PatchOptions())
    left = plan_patch(random_design(0, side="left"), PatchOptions())
    assert (right.mirrored, left.mirrored) == (False, True)

    def slits(plan, mirror):
        points = np.array([s.points_mm for s in plan.part if s.role == "slit"])
        points[..., 0] = 90 - points[..., 0] if mirror else points[..., 0]
        return np.array(sorted(tuple(np.sort(p, axis=0).ravel().round(9)) for p in points))

    np.testing.assert_allclose(slits(left, True), slits(right, False))

    # 'UP' is written alike on both, not mirrored: the same strokes, moved.
    def word(plan):
        strokes = [s.points_mm for s in plan.part if s.role == "label"]
        middle = [p for p in strokes if abs(p[:, 0].mean() - 45) < 6 and p[:, 1].max() < 0]
        points = np.concatenate(middle)
        return np.array(sorted(map(tuple, (points - points.min(axis=0)).round(9))))

    np.testing.assert_allclose(word(left), word(right), atol=1e-9)


def test_lateral_mark_lies_over_the_lateral_edge():
    for side, expected in (("right", 0.0), ("left", 90.0)):
        plan = plan_patch(uniform_design(0.5, 0.5, side=side), PatchOptions())
        words = [s.points_mm for s in plan.part if s.role == "label"]
        near = [p for p in words if abs(p[:, 0].mean() - expected) < 6]
        far = [p for p in words if abs(p[:, 0].mean() - (90 - expected)) < 6]
        # L, A (two strokes), T (two strokes); M, E (two), D.
        assert (len(near), len(far)) == (5, 4)


def test_fiducials_fit_in_one_way_only():
    plan = plan_patch(random_design(0), PatchOptions())
    points = plan.fiducials_mm - np.array([45.0, 90.0])
    for turn in ((-1, 1), (1, -1), (-1, -1)):
        moved = points * turn
        off = np.linalg.norm(moved[:, None] - points[None], axis=2).min(axis=1)
        assert off.max() > 1.0
    bare = plan_patch(random_design(0), PatchOptions(fiducials=False))
    assert not [s for s in bare.part if s.role == "fiducial"]


@pytest.mark.parametrize(("rows", "columns", "cell"), [(12, 6, 15.0), (3, 2, 10.0)])
def test_foam_falls_into_one_tile_a_facet(rows, columns, cell):
    plan = plan_patch(uniform_design(0.5, 0.5, rows, columns, cell=cell), PatchOptions())
    drawing = draw_foam(plan, "foam", PLAIN)
    assert len(drawing.of("tile")) == 2 * rows - 1 + 2 * columns - 1
    noded = shapely.union_all(_lines(drawing.of("tile", "outline")))
    tiles = list(shapely.polygonize(shapely.get_parts(noded)).geoms)
    assert len(tiles) == 4 * rows * columns
    assert {round(tile.area, 6) for tile in tiles} == {(cell / 2) ** 2}
    crosses = _lines(drawing.of("fiducial"))
    assert all(any(tile.contains(cross) for tile in tiles) for cross in crosses)
    assert drawing.strokes[-1].role == "outline"


def test_foam_crosses_lie_where_the_patchs_do():
    plan = plan_patch(random_design(0, side="left"), PatchOptions())

    def crosses(drawing):
        rim = np.array(Polygon(drawing.of("outline")[0].flattened()).bounds)
        centre = (rim[:2] + rim[2:]) / 2
        points = np.array([s.points_mm for s in drawing.of("fiducial") if len(s.points_mm) == 2])
        middles = points.mean(axis=1) - centre
        inner = np.abs(middles[:, 1]) < 89  # not the ticks on the hoops
        return np.array(sorted(map(tuple, middles[inner].round(6))))

    foam, patch = draw_foam(plan, "f", PLAIN), draw_patch(plan, "p", PLAIN)
    np.testing.assert_allclose(crosses(foam), crosses(patch), atol=1e-6)
    template = draw_template(plan, "t", PLAIN)
    assert len(template.of("slot")) == len(plan.fiducials_mm) == 5


@pytest.mark.parametrize("kerf", [0.12, 0.2, 0.33])
def test_the_coupon_tells_the_kerf_that_cuts_it(kerf):
    """A beam of width k joins exactly the facing slits whose gap is not wider than k."""
    drawing = draw_coupon("coupon", PLAIN)
    slits = [s.points_mm for s in drawing.of("slit")]
    rows: dict[float, list] = {}
    for ends in slits:
        if ends[:, 0].max() < 8 + 35:
            rows.setdefault(round(float(ends[0, 1]), 6), []).append(LineString(ends))
    assert len(rows) == 12
    joined = []
    for k, y in enumerate(sorted(rows)):
        burnt = shapely.union_all([line.buffer(kerf / 2, quad_segs=32) for line in rows[y]])
        if burnt.geom_type == "Polygon":
            joined.append(0.05 * (k + 1))
    assert max(joined) <= kerf < max(joined) + 0.05
    lengths = sorted(round(LineString(e).length, 6) for e in slits if e[:, 0].min() > 8 + 40)
    assert lengths == [5.0] * 3 + [10.0] * 3 + [20.0] * 3


def test_warnings_name_what_is_left_out():
    codes = {f.code for f in plan_patch(SHAPES[2], PatchOptions(0.1)).warnings}
    assert codes == {"side-not-stated"}
    codes = {f.code for f in plan_patch(SHAPES[3], PatchOptions(0.1)).warnings}
    assert "label-no-room" in codes
    thin = plan_patch(uniform_design(0.01, 0.5), PatchOptions(0.2))
    assert "slit-below-kerf" in {f.code for f in thin.warnings}
