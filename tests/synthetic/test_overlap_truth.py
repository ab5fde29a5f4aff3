"""Overlap truth against planar polygons, spherical polygons and counting of points."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import clip_spherical, plane, sphere, spherical_polygon_mm2
from matplotlib.path import Path as Outline
from shapely import Polygon
from synthetic_subjects import stored_subject
from tolerances import COUNTED_OVERLAP, TRUE_OVERLAP

from kiribench.schema.layout import Layout
from kiribench.synthetic import STORED
from kiribench.synthetic.overlap_truth import cell_outlines, grade, overlap_truth
from kiribench.synthetic.subject import patch_nodes

STEP = 15.0


def _grid(rows: int, columns: int) -> np.ndarray:
    u = (np.arange(columns + 1) - columns / 2) * STEP
    v = (np.arange(rows + 1) - rows / 2) * STEP
    return np.stack(np.meshgrid(u, v), axis=-1)


def _misplaced(nodes: np.ndarray, size: float = 2.0) -> np.ndarray:
    """The nodes, each moved by its own draw: shifts, turns, shears, larger and smaller cells."""
    return nodes + np.random.default_rng(4).uniform(-size, size, nodes.shape)


def _corners(nodes: np.ndarray, row: int, column: int) -> np.ndarray:
    return np.array(
        [
            nodes[row, column],
            nodes[row, column + 1],
            nodes[row + 1, column + 1],
            nodes[row + 1, column],
        ]
    )


def test_polygons_in_a_plane_with_curved_coordinates() -> None:
    surface, skin = plane(), _grid(4, 4)
    patch = _misplaced(skin)
    truth = overlap_truth(surface, skin, patch)
    for row in range(4):
        for column in range(4):
            s, k = (
                Polygon(surface.points_mm(_corners(nodes, row, column))[:, :2])
                for nodes in (skin, patch)
            )
            common = s.intersection(k).area
            entry = (row, column)
            assert truth.paper[entry] == pytest.approx(common / s.area, abs=TRUE_OVERLAP)
            assert truth.strict[entry] == pytest.approx(
                common / max(s.area, k.area), abs=TRUE_OVERLAP
            )
            assert truth.iou[entry] == pytest.approx(common / s.union(k).area, abs=TRUE_OVERLAP)


@pytest.mark.parametrize("radius", [25.0, 40.0, 60.0])
def test_spherical_polygons(radius: float) -> None:
    surface, skin = sphere(radius), _grid(2, 2)
    patch = _misplaced(skin)
    truth = overlap_truth(surface, skin, patch)
    for row in range(2):
        for column in range(2):
            s, k = (surface.points_mm(_corners(n, row, column)) for n in (skin, patch))
            common = spherical_polygon_mm2(clip_spherical(s, k))
            area = spherical_polygon_mm2(s)
            assert truth.skin_mm2[row, column] == pytest.approx(area, rel=TRUE_OVERLAP)
            assert truth.paper[row, column] == pytest.approx(common / area, abs=TRUE_OVERLAP)


def test_a_perfect_fit_an_empty_one_and_one_inside() -> None:
    surface, skin = plane(), _grid(1, 1)
    assert overlap_truth(surface, skin, skin).iou[0, 0] == pytest.approx(1.0, abs=TRUE_OVERLAP)
    assert overlap_truth(surface, skin, skin + 20.0).paper[0, 0] == 0.0
    inside = overlap_truth(surface, skin, 0.5 * skin)
    assert inside.common_mm2[0, 0] == pytest.approx(inside.patch_mm2[0, 0], rel=TRUE_OVERLAP)
    outside = overlap_truth(surface, skin, 1.5 * skin)
    assert outside.paper[0, 0] == pytest.approx(1.0, abs=TRUE_OVERLAP)
    assert outside.strict[0, 0] < 0.5


@pytest.mark.parametrize("name", STORED)
def test_refinement_changes_no_overlap_on_the_knees(name: str) -> None:
    knee = STORED[name]
    skin = patch_nodes(Layout.of())
    patch = knee.mismatch.on_skin(skin)
    surface = knee.build.flexed()
    rows = slice(4, 9)
    usual = overlap_truth(surface, skin[rows], patch[rows])
    finer = overlap_truth(surface, skin[rows], patch[rows], side_pieces=60)
    for kind in ("paper", "strict", "iou"):
        np.testing.assert_allclose(getattr(usual, kind), getattr(finer, kind), atol=TRUE_OVERLAP)


def test_counting_points_weighted_by_area_agrees_on_a_knee() -> None:
    # A lattice turned by an irrational angle, so that no row of it follows a side.
    knee = STORED["S2"]
    skin = patch_nodes(Layout.of())[3:6, :2]
    patch = knee.mismatch.on_skin(skin)
    surface = knee.build.flexed()
    truth = overlap_truth(surface, skin, patch)
    outlines = [cell_outlines(surface, nodes, 48) for nodes in (skin, patch)]
    line = np.arange(-16.0, 16.0, 0.04)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    lattice = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2) @ turn.T
    for cell in range(truth.paper.size):
        s, k = (outline[cell] for outline in outlines)
        points = lattice + s.mean(axis=0)
        inside = Outline(s).contains_points(points)
        points = points[inside]
        density = surface.area_density(points)
        covered = density[Outline(k).contains_points(points)].sum() / density.sum()
        assert truth.paper.ravel()[cell] == pytest.approx(covered, abs=COUNTED_OVERLAP)


def test_grades_at_their_limits() -> None:
    assert [grade(x) for x in (1.0, 0.9, 0.8999, 0.75, 0.7499, 0.0)] == [
        "good",
        "good",
        "fair",
        "fair",
        "poor",
        "poor",
    ]


@pytest.mark.parametrize(("name", "satisfactory"), [("S1", 66), ("S2", 58), ("S3", 56)])
def test_the_stored_subjects_have_the_papers_counts(name: str, satisfactory: int) -> None:
    person = stored_subject(name)
    overlaps = person.overlap.paper
    assert (overlaps >= 0.75).sum() == satisfactory
    # An analysis that errs by .002 still counts right.
    assert np.abs(overlaps[..., None] - [0.75, 0.90]).min() > 0.002
    # Good in the middle, worst in the edge columns, as the paper saw.
    assert overlaps[:, 1:-1].min() > 0.75
    assert overlaps[:, [0, -1]].mean() < overlaps[:, [1, -2]].mean() - 0.1
