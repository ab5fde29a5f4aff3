"""Exact geodesic distances and paths between points inside faces, for many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, NodesError, NotConvergedError, PathError
from kiribench.surface.geodesic_kernels import NO_ROOM, Scratch, scratch
from kiribench.surface.geodesic_pairs import DONE, NO_STRIP, solve_pairs
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints
from kiribench.surface.topology import Topology, topology

# A weight below this puts the point on the edge: it moves by less than 1e-12 of a face's size.
ON_EDGE = 1e-12
WEIGHT_TOLERANCE = 1e-6  # how far given weights may be from a convex combination
_SHORT_STEP = 1e-9  # of the path's length; a shorter first step does not give its direction
FIRST_ROOM = 1 << 14
MOST_ROOM = 1 << 23  # windows a pair; 0.7 GB


Labels = Sequence[str] | Sequence[tuple[str, str]]


@dataclass(frozen=True, eq=False)
class Geodesics:
    """Shortest paths of k pairs of points.

    Attributes:
        length_mm: (k,) lengths.
        start_direction: (k, 3) unit tangents at the sources, in the plane of the path's first
            face; zero where source and target coincide.
        path_offsets: (k + 1,) int64; path ``i`` is ``path_mm[path_offsets[i] :
            path_offsets[i + 1]]``, from source to target, at least two points.
        path_mm: (p, 3) points where the paths cross edges or turn at vertices.
        path_faces: (p,) int32, the face of the segment from this point to the next; a path's
            last entry repeats the one before.
    """

    length_mm: FloatArray
    start_direction: FloatArray
    path_offsets: NDArray[np.int64]
    path_mm: FloatArray
    path_faces: IntArray

    def path(self, pair: int) -> FloatArray:
        """(q, 3) the polyline of one pair, in mm."""
        return self.path_mm[self.path_offsets[pair] : self.path_offsets[pair + 1]]


def geodesics(
    mesh: Mesh,
    sources: SurfacePoints,
    targets: SurfacePoints,
    *,
    labels: Labels | None = None,
    topology: Topology | None = None,
) -> Geodesics:
    """Exact shortest paths on ``mesh`` from ``sources`` to ``targets``, pair by pair.

    A taut strip of faces gives each path; an exact window search, bounded by its length,
    then proves that no path is shorter or finds the one that is. The result equals MMP
    (Mitchell, Mount and Papadimitriou 1987, doi:10.1137/0216045).

    Args:
        mesh: an edge-manifold mesh; borders, holes and several components are allowed.
        sources: k points.
        targets: k points.
        labels: k names for errors: of the pairs, or (source, target) of each pair.
        topology: of ``mesh``; computed here if not given.

    Raises:
        MeshError: the mesh has faults that ``repair_mesh`` mends (see ``topology``).
        NodesError: a point's face or weights are not on the mesh.
        PathError: two points lie on pieces that are not connected; remedy: repair the hole
            or mark the node missing.
        NotConvergedError: the search met its bound of windows.
    """
    lengths, offsets, path, face = _solve_all(mesh, sources, targets, labels, topology, True)
    begin, end = offsets[:-1], offsets[1:]
    direction = np.zeros((len(lengths), 3))
    if len(lengths):
        step = path[begin + 1] - path[begin]
        size = np.linalg.norm(step, axis=1)
        for k in np.flatnonzero((size <= _SHORT_STEP * lengths) & (lengths > 0)):
            steps = path[begin[k] + 1 : end[k]] - path[begin[k]]
            sizes = np.linalg.norm(steps, axis=1)
            first = int(np.argmax(sizes > _SHORT_STEP * lengths[k]))
            step[k], size[k] = steps[first], sizes[first]
        direction = np.divide(
            step, size[:, None], out=direction, where=((lengths > 0) & (size > 0))[:, None]
        )
    return Geodesics(lengths, direction, offsets, path, face)


def geodesic_distances(
    mesh: Mesh,
    sources: SurfacePoints,
    targets: SurfacePoints,
    *,
    labels: Labels | None = None,
    topology: Topology | None = None,
) -> FloatArray:
    """(k,) exact geodesic distances in mm; as :func:`geodesics`, without the paths."""
    return _solve_all(mesh, sources, targets, labels, topology, False)[0]


def _solve_all(
    mesh: Mesh,
    sources: SurfacePoints,
    targets: SurfacePoints,
    labels: Labels | None,
    table: Topology | None,
    paths: bool,
) -> tuple[FloatArray, NDArray[np.int64], FloatArray, IntArray]:
    if len(sources) != len(targets):
        raise ValueError(f"{len(sources)} sources but {len(targets)} targets")
    if labels is not None and len(labels) != len(sources):
        raise ValueError(f"{len(labels)} labels but {len(sources)} pairs")
    table = topology(mesh) if table is None else table
    xyz = np.ascontiguousarray(mesh.vertices_mm, dtype=np.float64)
    faces = table.faces
    source_faces, source_weights = snapped(table, sources, "source", labels)
    target_faces, target_weights = snapped(table, targets, "target", labels)
    pairs = len(sources)
    lengths = np.full(pairs, np.nan)
    offsets = np.zeros(pairs + 1, np.int64)
    unbounded = np.zeros(pairs, np.bool_)
    room = FIRST_ROOM
    work = scratch(len(faces), len(xyz), room)
    k = 0
    while True:
        k, status = solve_pairs(
            xyz, faces, table.twins, table.corner_offsets, table.corners,
            source_faces, source_weights, target_faces, target_weights,
            k, unbounded, paths, lengths, offsets, work,
        )  # fmt: skip
        if status == DONE:
            break
        if status == NO_ROOM:
            room *= 2
            if room > MOST_ROOM + 4 * int(offsets[k]):
                raise NotConvergedError(
                    "geodesic-work-bound",
                    f"The search for the path {_names(labels, k)} met its bound of windows.",
                    remedy="Denoise or repair the scan near these points.",
                )
            work = _with_room(work, room, int(offsets[k]))
        elif status == NO_STRIP:
            _check_connected(table, source_faces, target_faces, labels)
            unbounded[k] = True  # connected at a vertex only: the exact search alone finds it
        else:
            raise _no_path([_names(labels, k)])
    if not np.isfinite(lengths).all():  # cannot happen on a mesh that topology() accepts
        bad = int(np.flatnonzero(~np.isfinite(lengths))[0])
        raise _no_path([_names(labels, bad)])
    end = int(offsets[-1])
    return lengths, offsets, work.path_mm[:end].copy(), work.path_face[:end].copy()


def snapped(
    table: Topology, points: SurfacePoints, role: str, labels: Labels | None = None
) -> tuple[IntArray, FloatArray]:
    """Faces and weights (in ``table.faces``) of checked points; nearly zero becomes zero."""
    faces = np.ascontiguousarray(points.faces, dtype=np.int32).reshape(-1)
    weights = np.array(points.barycentric, dtype=np.float64).reshape(-1, 3)
    good = (faces >= 0) & (faces < len(table.faces)) & np.isfinite(weights).all(axis=1)
    good &= (weights >= -WEIGHT_TOLERANCE).all(axis=1)
    good &= np.abs(weights.sum(axis=1) - 1.0) <= WEIGHT_TOLERANCE
    if not good.all():
        k = int(np.flatnonzero(~good)[0])
        raise NodesError(
            "point-off-face",
            f"The {role} {_names(labels, k)} is not a point of a face of the mesh.",
            remedy="Locate the points on this mesh (surface.locate) before measuring.",
            got=f"face {faces[k]}, weights {weights[k].tolist()}",
            expected="a face of the mesh and three weights >= 0 that sum to 1",
        )
    turned = table.reversed_faces[faces]
    weights[turned] = weights[turned][:, [0, 2, 1]]
    weights[weights < ON_EDGE] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    return faces, weights


def _names(labels: Labels | None, k: int) -> str:
    if labels is None:
        return f"of pair {k}"
    label = labels[k]
    return f"of {label}" if isinstance(label, str) else f"from {label[0]} to {label[1]}"


def _check_connected(
    table: Topology, source_faces: IntArray, target_faces: IntArray, labels: Labels | None
) -> None:
    piece = table.components
    apart = np.flatnonzero(piece[source_faces] != piece[target_faces])
    if len(apart):
        raise _no_path([_names(labels, int(k)) for k in apart])


def _no_path(names: list[str]) -> PathError:
    error = PathError.of(
        Fault(
            code="geodesic-disconnected",
            what=f"There is no path on the surface {name}: the points lie on separate pieces.",
            remedy="Repair the scan so that one piece holds both, or mark a node as missing.",
        )
        for name in names
    )
    assert isinstance(error, PathError)
    return error


def _with_room(work: Scratch, room: int, used: int) -> Scratch:
    bigger = scratch(len(work.face_stamp), len(work.vertex_stamp), room)
    bigger.path_mm[:used] = work.path_mm[:used]
    bigger.path_face[:used] = work.path_face[:used]
    return bigger
