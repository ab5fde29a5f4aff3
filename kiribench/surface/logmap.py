"""The logarithmic map: points by geodesic length and direction about a centre, in a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kiribench.errors import NodesError
from kiribench.surface.geodesic import Labels, geodesics, snapped
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints
from kiribench.surface.topology import Topology, topology


def tangent_frame(
    mesh: Mesh,
    centre: SurfacePoints,
    x_hint_mm: ArrayLike,
    *,
    topology: Topology | None = None,
) -> FloatArray:
    """Right-handed frame in the plane of the centre's face.

    Args:
        mesh: the surface.
        centre: one point.
        x_hint_mm: (3,) direction that the x axis should have, any length.
        topology: of ``mesh``; needed only where its faces are wound against each other.

    Returns:
        (3, 3) unit rows x, y, n; x is the hint projected into the face's plane, n points to
        the side from which the face is counter-clockwise.

    Raises:
        NodesError: the hint is perpendicular to the face, or the face has no area; remedy:
            another hint.
    """
    face = int(np.asarray(centre.faces).reshape(-1)[0])
    normal = mesh.face_normals[face]
    if topology is not None and topology.reversed_faces[face]:
        normal = -normal
    hint = np.asarray(x_hint_mm, dtype=np.float64).reshape(3)
    x = hint - (hint @ normal) * normal
    size = float(np.linalg.norm(x))
    if not size > 1e-9 * float(np.linalg.norm(hint)) or not normal.any():
        raise NodesError(
            "tangent-hint",
            "The direction given for the x axis has no part in the surface at the centre.",
            remedy="Give a direction along the surface, such as distal.",
            got=hint.tolist(),
        )
    x = x / size
    return np.stack([x, np.cross(normal, x), normal])


def log_map(
    mesh: Mesh,
    centre: SurfacePoints,
    points: SurfacePoints,
    *,
    x_hint_mm: ArrayLike | None = None,
    labels: Labels | None = None,
    topology: Topology | None = None,
) -> FloatArray:
    """Coordinates of ``points`` in the tangent plane at ``centre``: exact length and direction.

    Lengths from the centre and angles between directions there are kept. A centre on an
    edge folds its second face into the plane of its own; at a vertex inside the surface the
    angles around it are scaled to a full turn (Polthier and Schmies 1998), at a border
    vertex they are kept.

    Args:
        mesh: the surface.
        centre: one point.
        points: k points.
        x_hint_mm: (3,) direction of the x axis (see :func:`tangent_frame`); the first edge of
            the centre's face if not given.
        labels: k names for errors.
        topology: of ``mesh``; computed here if not given.

    Returns:
        (k, 2) mm along x and y of ``tangent_frame(mesh, centre, x_hint_mm)``.

    Raises:
        PathError: a point is not connected to the centre.
        NodesError: as :func:`tangent_frame`, or a point is not on the mesh.
    """
    table = _topology(mesh) if topology is None else topology
    if len(centre) != 1:
        raise ValueError(f"one centre is needed, not {len(centre)}")
    face, weights = snapped(table, centre, "centre")
    corners = mesh.vertices_mm[table.faces[face[0]]]
    hint = corners[1] - corners[0] if x_hint_mm is None else x_hint_mm
    frame = tangent_frame(mesh, centre, hint, topology=table)
    here = SurfacePoints(
        np.repeat(np.asarray(centre.faces), len(points)),
        np.repeat(np.asarray(centre.barycentric), len(points), axis=0),
    )
    lines = geodesics(mesh, here, points, labels=labels, topology=table)
    first = lines.path_faces[lines.path_offsets[:-1]]
    direction = _unfolded(
        mesh, table, int(face[0]), weights[0], frame, first, lines.start_direction
    )
    return direction * lines.length_mm[:, None]


_topology = topology  # the argument of log_map has the same name


def _unfolded(
    mesh: Mesh,
    table: Topology,
    own: int,
    weights: FloatArray,
    frame: FloatArray,
    faces: IntArray,
    directions: FloatArray,
) -> FloatArray:
    """(k, 2) unit directions in ``frame``, from tangents in the planes of ``faces``."""
    flat = directions @ frame[:2].T
    other = faces != own
    if not other.any():
        return flat
    corners = mesh.vertices_mm[table.faces[own]]
    zeros = np.flatnonzero(weights == 0.0)
    if len(zeros) == 1:
        across = int(zeros[0])  # the corner opposite to the edge that holds the centre
        edge = corners[(across + 2) % 3] - corners[(across + 1) % 3]
        edge = edge / np.linalg.norm(edge)
        outward = np.cross(edge, frame[2])
        along = directions[other] @ edge
        away = np.sqrt(np.maximum(0.0, 1.0 - along**2))
        away[~directions[other].any(axis=1)] = 0.0
        flat[other] = (along[:, None] * edge + away[:, None] * outward) @ frame[:2].T
        return flat
    at = int(np.argmax(weights))
    vertex = int(table.faces[own, at])
    fan, begins, turn, closed = _fan(mesh, table, 3 * own + at)
    scale = 2.0 * np.pi / turn if closed else 1.0
    first = corners[(at + 1) % 3] - corners[at]
    zero = np.arctan2(first @ frame[1], first @ frame[0])
    where = {corner // 3: k for k, corner in enumerate(fan)}
    centre = mesh.vertices_mm[vertex]
    for k in np.flatnonzero(directions.any(axis=1)):
        if int(faces[k]) not in where:
            raise NodesError(
                "logmap-pinched",
                "The surface is pinched at the centre: two sheets touch at one vertex.",
                remedy="Move the centre off the vertex, or repair the scan.",
            )
        n = where[int(faces[k])]
        f, i = fan[n] // 3, fan[n] % 3
        edge = mesh.vertices_mm[table.faces[f, (i + 1) % 3]] - centre
        angle = np.arctan2(np.linalg.norm(np.cross(edge, directions[k])), edge @ directions[k])
        turned = zero + scale * (begins[n] + angle)
        flat[k] = np.cos(turned), np.sin(turned)
    return flat


def _fan(mesh: Mesh, table: Topology, first: int) -> tuple[list[int], list[float], float, bool]:
    """Corners around a vertex counter-clockwise, the angle where each begins, total, closed?"""

    def wide(corner: int) -> float:
        f, i = corner // 3, corner % 3
        v, a, b = mesh.vertices_mm[table.faces[f, [i, (i + 1) % 3, (i + 2) % 3]]]
        return float(np.arctan2(np.linalg.norm(np.cross(a - v, b - v)), (a - v) @ (b - v)))

    fan, begins, angle = [first], [0.0], wide(first)
    corner = first
    while True:
        corner = int(table.twins[corner // 3, (corner % 3 + 2) % 3])
        if corner == first:
            return fan, begins, angle, True
        if corner < 0:
            break
        fan.append(corner)
        begins.append(angle)
        angle += wide(corner)
    corner, back = first, 0.0
    while True:
        twin = int(table.twins[corner // 3, corner % 3])
        if twin < 0:
            return fan, begins, angle - back, False
        corner = 3 * (twin // 3) + (twin % 3 + 1) % 3
        back -= wide(corner)
        fan.append(corner)
        begins.append(back)
