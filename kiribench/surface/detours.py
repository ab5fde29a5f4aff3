"""Shortest paths that lead around a hole, and so are longer than the skin under the hole.

Inside a surface a shortest path is straight. It turns only at vertices of the border, around
a hole or a bay of the scan's edge; there its length says nothing about the missing surface.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kiribench.surface.geodesic import Geodesics
from kiribench.surface.mesh import FloatArray, Mesh
from kiribench.surface.topology import Topology

DETOUR_DEG = 1.0
"""A path that turns less is taken for straight: so small a turn in its middle lengthens it
by 1 - cos(0.5 deg) < 4e-5."""

AT_VERTEX = 1e-9
"""A path's point this near to a corner, as a part of the face's longest side, is the corner."""


def border_turns_deg(mesh: Mesh, topology: Topology, paths: Geodesics) -> FloatArray:
    """How much each path turns around the border, in degrees; 0 for a straight path.

    Args:
        mesh: that the paths lie on.
        topology: of ``mesh``.
        paths: k geodesics.

    Returns:
        (k,) the sum over the border vertices that the path turns at; each turn is the angle on
        the surface's side between the path's two directions, less 180 degrees.
    """
    turns = np.zeros(len(paths.length_mm))
    owner = np.repeat(np.arange(len(turns)), np.diff(paths.path_offsets))
    inner = np.ones(len(owner), dtype=bool)
    inner[paths.path_offsets[:-1]] = False
    inner[paths.path_offsets[1:] - 1] = False
    vertex = _vertices_met(mesh, topology, paths, inner)
    on_border = np.zeros(len(mesh.vertices_mm), dtype=bool)
    border_face, border_corner = np.nonzero(topology.twins < 0)
    on_border[topology.faces[border_face, border_corner]] = True
    on_border[topology.faces[border_face, (border_corner + 1) % 3]] = True
    met = np.flatnonzero(inner & (vertex >= 0))
    met = met[on_border[vertex[met]]]
    for place in met.tolist():
        path, v = int(owner[place]), int(vertex[place])
        if place > 0 and vertex[place - 1] == v and owner[place - 1] == path and inner[place - 1]:
            continue  # the same corner met twice
        before = _direction(paths, place, -1, mesh.vertices_mm[v])
        after = _direction(paths, place, 1, mesh.vertices_mm[v])
        if before is None or after is None:
            continue
        fan = _fan(mesh, topology, v)
        turn = abs(_bearing(fan, after) - _bearing(fan, before)) - math.pi
        turns[path] += max(0.0, math.degrees(turn))
    return turns


def detours(mesh: Mesh, topology: Topology, paths: Geodesics) -> NDArray[np.bool_]:
    """(k,) whether each path leads around a hole or a bay of the border."""
    return border_turns_deg(mesh, topology, paths) > DETOUR_DEG


def _vertices_met(
    mesh: Mesh, topology: Topology, paths: Geodesics, inner: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """(p,) the vertex that each inner point of the paths is, -1 for a point on an edge."""
    vertex = np.full(len(inner), -1, dtype=np.int64)
    places = np.flatnonzero(inner)
    corners = topology.faces[paths.path_faces[places]]
    xyz = mesh.vertices_mm[corners]
    size = np.linalg.norm(xyz - np.roll(xyz, 1, axis=1), axis=2).max(axis=1)
    gap = np.linalg.norm(xyz - paths.path_mm[places, None, :], axis=2)
    nearest = gap.argmin(axis=1)
    row = np.arange(len(places))
    at = gap[row, nearest] <= AT_VERTEX * size
    vertex[places[at]] = corners[row, nearest][at]
    return vertex


def _direction(paths: Geodesics, place: int, step: int, origin: FloatArray) -> FloatArray | None:
    """Unit direction from a path's point to the next distinct one, backwards or forwards."""
    path = int(np.searchsorted(paths.path_offsets, place, side="right")) - 1
    first, last = paths.path_offsets[path], paths.path_offsets[path + 1] - 1
    there = place + step
    while first <= there <= last:
        way = paths.path_mm[there] - origin
        length = float(np.linalg.norm(way))
        if length > AT_VERTEX * float(paths.length_mm[path]):
            return np.asarray(way / length)
        there += step
    return None


def _fan(mesh: Mesh, topology: Topology, v: int) -> list[tuple[float, FloatArray, FloatArray]]:
    """The faces around a border vertex, one way round: bearing of the first side, both sides."""
    lo, hi = topology.corner_offsets[v], topology.corner_offsets[v + 1]
    corners = topology.corners[lo:hi]
    starts = [c for c in corners.tolist() if topology.twins[c // 3, c % 3] < 0]
    fan: list[tuple[float, FloatArray, FloatArray]] = []
    bearing, corner = 0.0, starts[0]
    for _ in range(len(corners)):
        face, i = divmod(corner, 3)
        origin, one, other = mesh.vertices_mm[np.roll(topology.faces[face], -i)]
        side, next_side = _unit(one - origin), _unit(other - origin)
        fan.append((bearing, side, next_side))
        bearing += _angle(side, next_side)
        corner = int(topology.twins[face, (i + 2) % 3])
        if corner < 0:
            break
    return fan


def _bearing(fan: list[tuple[float, FloatArray, FloatArray]], direction: FloatArray) -> float:
    """The bearing of a direction that lies in one of the fan's faces."""
    misfits = [
        _angle(side, direction) + _angle(direction, next_side) - _angle(side, next_side)
        for _, side, next_side in fan
    ]
    bearing, side, _ = fan[int(np.argmin(misfits))]
    return bearing + _angle(side, direction)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector))


def _angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between unit vectors, accurate for small and for straight angles."""
    return 2.0 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
