"""Paths around holes, against plane geometry."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import DETOUR_ANGLE_DEG

from kiribench.surface.detours import border_turns_deg, detours
from kiribench.surface.geodesic import Geodesics, geodesics
from kiribench.surface.locate import locate
from kiribench.surface.mesh import Mesh
from kiribench.surface.topology import topology


def plate(radius: float | None = None, hole: bool = False) -> Mesh:
    """[0, 100] x [0, 100] mm in squares of 10 mm; rolled on a cylinder; without [40, 60]^2."""
    x, y = np.meshgrid(np.arange(0, 101, 10.0), np.arange(0, 101, 10.0), indexing="ij")
    if radius is None:
        xyz = np.stack([x, y, 0 * x], axis=-1)
    else:
        xyz = np.stack([x, radius * np.sin(y / radius), radius * np.cos(y / radius)], axis=-1)
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    kept = np.ones((10, 10), dtype=bool)
    if hole:
        kept[4:6, 4:6] = False
    corner = corner[kept.ravel()]
    a, b, c, d = corner, corner + 11, corner + 12, corner + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(xyz.reshape(-1, 3), faces.astype(np.int32))


def paths(mesh: Mesh, start: tuple[float, ...], end: tuple[float, ...]) -> Geodesics:
    ends = [locate(mesh, np.array([[*point, 0.0]])).points for point in (start, end)]
    return geodesics(mesh, ends[0], ends[1])


@pytest.mark.parametrize(
    ("start", "end", "turn"),
    [
        ((30, 50), (70, 50), 90.0),  # 45 degrees at each of two corners
        ((30, 55), (70, 57), np.degrees(np.arctan2(5, 10) + np.arctan2(3, 10))),
        ((30, 65), (55, 45), None),  # through the hole: below
        ((30, 50), (40, 70), 0.0),  # passes the hole by
        ((30, 60), (70, 60), 0.0),  # along the hole's side, straight
        ((5, 5), (95, 5), 0.0),
    ],
)
def test_turns_of_a_path_in_a_plate(
    start: tuple[float, float], end: tuple[float, float], turn: float | None
) -> None:
    mesh = plate(hole=True)
    if turn is None:
        end = (65.0, 45.0)  # around the corner (60, 60): from (-30, -5) to (5, -15)
        turn = np.degrees(np.arctan2(15, 5) - np.arctan2(5, 30))
    table = topology(mesh)
    found = paths(mesh, start, end)
    assert border_turns_deg(mesh, table, found)[0] == pytest.approx(turn, abs=DETOUR_ANGLE_DEG)
    assert detours(mesh, table, found)[0] == (turn > 1.0)


@pytest.mark.parametrize("reverse", [False, True])
def test_path_along_the_curved_border_of_a_cylinder_is_straight(reverse: bool) -> None:
    mesh = plate(radius=57.0)
    if reverse:
        mesh = Mesh(mesh.vertices_mm, mesh.faces[:, ::-1].copy())
    ends = [locate(mesh, mesh.vertices_mm[[k]]).points for k in (0, 10)]
    found = geodesics(mesh, ends[0], ends[1])
    assert len(found.path(0)) > 5
    assert border_turns_deg(mesh, topology(mesh), found)[0] == pytest.approx(
        0.0, abs=DETOUR_ANGLE_DEG
    )


def test_many_paths_at_once_keep_their_own_turns() -> None:
    mesh = plate(hole=True)
    starts = locate(mesh, np.array([[30.0, 50, 0], [5, 5, 0], [30, 50, 0], [50, 30, 0]])).points
    ends = locate(mesh, np.array([[70.0, 50, 0], [95, 5, 0], [30, 50, 0], [50, 70, 0]])).points
    turns = border_turns_deg(mesh, topology(mesh), geodesics(mesh, starts, ends))
    np.testing.assert_allclose(turns, [90, 0, 0, 90], rtol=0, atol=DETOUR_ANGLE_DEG)
