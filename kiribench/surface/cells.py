"""Cells of a node grid on a surface: geodesic sides, flattening about the cell's centre.

A cell (r, c) has the corners (r, c), (r, c+1), (r+1, c+1), (r+1, c). It is flattened by
the logarithmic map at its centre: a point goes to geodesic length times start direction in
the centre's tangent plane. The map keeps all distances from the centre and all directions
there; areas shrink or grow with the Gauss curvature, which :func:`equal_area` corrects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.surface.detours import detours
from kiribench.surface.geodesic import Geodesics, geodesics
from kiribench.surface.locate import locate
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints
from kiribench.surface.nodes import LocatedNodes
from kiribench.surface.topology import Topology

#: Corner offsets (row, column) of a cell in order.
CORNERS = ((0, 0), (0, 1), (1, 1), (1, 0))

#: How far a cell's centre is moved towards the middle of its face, a fraction. Any point
#: near the middle of the cell serves as its centre; one on an edge has two tangent planes.
OFF_EDGE = 0.02


@dataclass(frozen=True, eq=False)
class GridSides:
    """The geodesic sides of all cells of a node grid.

    Attributes:
        longitudinal_mm: (R, C+1) lengths from node (r, c) to (r+1, c); NaN beside an
            absent node.
        lateral_mm: (R+1, C) lengths from node (r, c) to (r, c+1).
        longitudinal_path: (R, C+1) int32 index into ``paths``, -1 where there is none.
        lateral_path: (R+1, C) int32 likewise.
        paths: the geodesics.
    """

    longitudinal_mm: FloatArray
    lateral_mm: FloatArray
    longitudinal_path: IntArray
    lateral_path: IntArray
    paths: Geodesics


@dataclass(frozen=True, eq=False)
class FlatFrames:
    """Tangent frames at the centres of k cells.

    Attributes:
        centres: k points.
        axes: (k, 3, 3) rows: two tangent axes and the outward normal, right-handed.
    """

    centres: SurfacePoints
    axes: FloatArray


def grid_sides(mesh: Mesh, nodes: LocatedNodes, topology: Topology) -> GridSides:
    """Measure all sides between adjacent nodes that are present.

    Raises:
        PathError: no path joins two nodes; both are named.
    """
    index = nodes.index
    pairs: list[tuple[IntArray, IntArray]] = [
        (index[:-1, :], index[1:, :]),
        (index[:, :-1], index[:, 1:]),
    ]
    starts, ends, where = [], [], []
    count = 0
    for start, end in pairs:
        both = (start >= 0) & (end >= 0)
        slot = np.full(start.shape, -1, dtype=np.int32)
        slot[both] = np.arange(count, count + int(both.sum()), dtype=np.int32)
        count += int(both.sum())
        starts.append(start[both])
        ends.append(end[both])
        where.append(slot)
    start_all, end_all = np.concatenate(starts), np.concatenate(ends)
    paths = geodesics(
        mesh,
        nodes.points[start_all],
        nodes.points[end_all],
        labels=_pair_labels(index, start_all, end_all),
        topology=topology,
    )
    lengths = []
    for slot in where:
        length = np.full(slot.shape, np.nan)
        length[slot >= 0] = paths.length_mm[slot[slot >= 0]]
        lengths.append(length)
    return GridSides(lengths[0], lengths[1], where[0], where[1], paths)


def cells_around_hole(mesh: Mesh, sides: GridSides, topology: Topology) -> NDArray[np.bool_]:
    """(R, C) cells with a side that leads around a hole instead of over the skin."""
    around = np.append(detours(mesh, topology, sides.paths), False)
    # Index -1, an absent side, meets the False that was appended.
    along, across = around[sides.longitudinal_path], around[sides.lateral_path]
    return np.asarray(along[:, :-1] | along[:, 1:] | across[:-1] | across[1:])


def _pair_labels(index: IntArray, start: IntArray, end: IntArray) -> list[str]:
    row, col = np.nonzero(index >= 0)
    name = np.empty(len(row), dtype=object)
    name[index[row, col]] = [f"node ({r}, {c})" for r, c in zip(row, col, strict=True)]
    return [f"{name[a]} to {name[b]}" for a, b in zip(start, end, strict=True)]


def corner_values(nodes: NDArray[np.generic]) -> NDArray[np.generic]:
    """Values at nodes gathered at the corners of the cells.

    Args:
        nodes: (R+1, C+1, ...).

    Returns:
        (R, C, 4, ...).
    """
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    return np.stack([nodes[r : r + rows, c : c + columns] for r, c in CORNERS], axis=2)


def cell_frames(mesh: Mesh, nodes: LocatedNodes, topology: Topology) -> FlatFrames:
    """A tangent frame at the centre of every cell whose corners are all present.

    The centre is the point of the surface closest to the mean of the corners, moved off
    the edges of its face, so that all directions at the centre lie in one plane. The first
    axis points along the projected longitudinal mid-line (distal).

    Returns:
        Frames of the k complete cells in row-major order.
    """
    corners = np.asarray(corner_values(nodes.positions_mm), dtype=np.float64)
    corners = corners[nodes.cells_present]
    closest = locate(mesh, corners.mean(axis=1)).points
    inside = (1.0 - OFF_EDGE) * closest.barycentric + OFF_EDGE / 3.0
    centres = SurfacePoints(closest.faces, inside)
    normal = mesh.face_normals[centres.faces]
    normal = np.where(topology.reversed_faces[centres.faces][:, None], -normal, normal)
    along = corners[:, 2] + corners[:, 3] - corners[:, 0] - corners[:, 1]
    along = along - (along * normal).sum(axis=1, keepdims=True) * normal
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return FlatFrames(centres, np.stack([along, np.cross(normal, along), normal], axis=1))


def flatten(
    mesh: Mesh,
    frames: FlatFrames,
    owner: IntArray,
    points: SurfacePoints,
    topology: Topology,
    labels: list[str] | None = None,
) -> FloatArray:
    """Logarithmic-map coordinates of points about the centres of their cells.

    Args:
        frames: of k cells.
        owner: (p,) the cell about whose centre each point is flattened.
        points: p points.
        labels: (p,) names for messages.

    Returns:
        (p, 2) mm along the first two axes of the owner's frame; NaN where the line from the
        centre leads around a hole and so says neither direction nor distance.

    Raises:
        PathError: a point cannot be reached from the centre.
    """
    lines = geodesics(mesh, frames.centres[owner], points, labels=labels, topology=topology)
    direction = np.einsum("pax,px->pa", frames.axes[owner, :2], lines.start_direction)
    flat = direction * np.asarray(lines.length_mm)[:, None]
    flat[detours(mesh, topology, lines)] = np.nan
    return np.asarray(flat)


def flat_corners(
    mesh: Mesh, nodes: LocatedNodes, frames: FlatFrames, topology: Topology
) -> FloatArray:
    """The corners of all complete cells, each flattened about its own centre.

    Returns:
        (R, C, 4, 2) mm; NaN where a corner is absent or behind a hole.
    """
    complete = nodes.cells_present
    corner = np.asarray(corner_values(nodes.index), dtype=np.int32)[complete]
    owner = np.repeat(np.arange(len(corner), dtype=np.int32), 4)
    row, col = np.nonzero(complete)
    labels = [
        f"centre of cell ({r}, {c}) to node ({r + i}, {c + j})"
        for r, c in zip(row, col, strict=True)
        for i, j in CORNERS
    ]
    flat = flatten(mesh, frames, owner, nodes.points[corner.ravel()], topology, labels)
    out = np.full((*complete.shape, 4, 2), np.nan)
    out[complete] = flat.reshape(-1, 4, 2)
    return out


def gauss_curvature(corners: FloatArray, sides_mm: FloatArray) -> FloatArray:
    """Mean Gauss curvature of cells from flattened corners and geodesic sides.

    In logarithmic coordinates x, y about a point of curvature K two points are
    ``d^2 = |x - y|^2 - K/3 (x ^ y)^2 + ...`` apart; the four sides give K by least squares.

    Args:
        corners: (..., 4, 2) mm about the centre.
        sides_mm: (..., 4) geodesic lengths of the sides corner i to corner i + 1.

    Returns:
        (...) 1/mm^2.
    """
    after = np.roll(corners, -1, axis=-2)
    wedge2 = (corners[..., 0] * after[..., 1] - corners[..., 1] * after[..., 0]) ** 2
    excess = ((after - corners) ** 2).sum(axis=-1) - sides_mm**2
    return np.asarray(3.0 * (excess * wedge2).sum(axis=-1) / (wedge2**2).sum(axis=-1))


def equal_area(flat: FloatArray, curvature: FloatArray) -> FloatArray:
    """Turn logarithmic coordinates into coordinates that keep areas.

    Lambert's azimuthal equal-area projection where the curvature is constant: the radius
    r becomes ``2/k sin(k r / 2)``, ``k^2 = K`` (``sinh`` where K is negative).

    Args:
        flat: (..., 2) mm about the centre.
        curvature: broadcasts to (...), 1/mm^2.
    """
    k = np.sqrt(np.abs(curvature))
    half = 0.5 * k * np.linalg.norm(flat, axis=-1)
    safe = np.where(half > 1e-9, half, 1.0)
    # Half a turn of the sphere is as far as the map goes.
    round_ = np.sin(np.minimum(safe, 0.5 * np.pi)) / safe
    scale = np.where(curvature >= 0.0, round_, np.sinh(np.minimum(safe, 10.0)) / safe)
    return np.asarray(flat * np.where(half > 1e-9, scale, 1.0)[..., None])
