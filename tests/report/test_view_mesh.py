"""The small mesh of the pictures and the frame that looks at it."""

from __future__ import annotations

import numpy as np
import pytest
from report_cases import CELL_MM, RADIUS_MM, conformability_case, cylinder_mesh, lift
from tolerances import LINEAR_ALGEBRA, PICTURE_DEPTH

from kiribench.report.sections.space import lifted
from kiribench.report.view_mesh import decimate, front_view
from kiribench.surface.mesh import Mesh


def centres(side: str = "right") -> np.ndarray:
    along, across = CELL_MM * (np.arange(12) - 5.5), CELL_MM * (np.arange(6) - 2.5)
    return lift(np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1), side)


@pytest.mark.parametrize("faces", [500, 2000, 4000])
def test_a_decimated_mesh_is_small_and_stays_on_the_surface(faces: int) -> None:
    mesh = cylinder_mesh(step_mm=2.0)
    vertices, triangles = decimate(mesh, faces)
    assert faces / 4 < len(triangles) <= faces
    assert triangles.min() == 0
    assert triangles.max() == len(vertices) - 1
    # A mean of points of a cube of edge h lies at most h^2 / (2 R) inside the cylinder.
    edge = np.sqrt(2 * mesh.face_areas_mm2.sum() / faces) * 1.5
    depth = RADIUS_MM - np.hypot(vertices[:, 0], vertices[:, 2])
    assert depth.min() > -1e-9
    assert depth.max() < PICTURE_DEPTH * edge**2 / (2 * RADIUS_MM)
    small = Mesh(vertices, triangles)
    assert np.all(small.face_areas_mm2 > 0)
    # The mean of the cubes at the border lies up to half an edge inside.
    area, border = mesh.face_areas_mm2.sum(), 2 * (260 + 200) * edge / 2
    assert area - border < small.face_areas_mm2.sum() <= area


def test_a_small_mesh_is_left_as_it_is() -> None:
    mesh = cylinder_mesh(step_mm=20.0)
    vertices, triangles = decimate(mesh, 10_000)
    assert vertices is mesh.vertices_mm
    assert triangles is mesh.faces


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_view_is_from_outside_with_proximal_up_and_lateral_where_it_belongs(side: str) -> None:
    frame = front_view(cylinder_mesh(side), centres(side))
    assert frame.axes @ frame.axes.T == pytest.approx(np.eye(3), abs=LINEAR_ALGEBRA)
    assert np.linalg.det(frame.axes) == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    seen = frame.turn(centres(side))
    assert np.all(np.diff(seen[:, 0, 1]) < 0)
    lateral_left = seen[0, 0, 0] < seen[0, -1, 0]
    assert lateral_left == (side == "right")
    assert frame.axes[2] == pytest.approx([0, 0, 1], abs=0.01)


def test_the_view_does_not_move_with_missing_cells() -> None:
    holes = centres()
    holes[0, 0] = holes[11, 5] = np.nan
    full = front_view(cylinder_mesh(), centres())
    some = front_view(cylinder_mesh(), holes)
    assert np.degrees(np.arccos(np.clip(full.axes[1] @ some.axes[1], -1, 1))) < 0.5


def test_a_patch_of_one_row_can_be_viewed() -> None:
    frame = front_view(cylinder_mesh(), centres()[:1])
    assert np.isfinite(frame.axes).all()


@pytest.mark.parametrize("side", ["right", "left"])
def test_outlines_are_lifted_off_the_skin(side: str) -> None:
    score = conformability_case(side=side)
    frame = front_view(cylinder_mesh(side), centres(side))
    outlines = frame.turn(score.skin_outline_3d_mm)
    higher = lifted(outlines, 2.0)
    moved = (higher - outlines)[score.scored]
    assert np.linalg.norm(moved, axis=-1) == pytest.approx(2.0, abs=1e-9)
    assert np.all(moved[..., 2] > 0)
    assert np.isnan(higher[~score.scored]).all()
