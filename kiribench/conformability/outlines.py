"""Outlines of cells with geodesic sides, flattened about the skin cell's centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.strain.gradient import mid_lines, signed_area
from kiribench.surface.cells import (
    FlatFrames,
    GridSides,
    cell_frames,
    cells_around_hole,
    equal_area,
    flatten,
    gauss_curvature,
    grid_sides,
)
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints
from kiribench.surface.nodes import LocatedNodes
from kiribench.surface.topology import Topology

#: Straight pieces of a side. On a sphere of radius 25 mm the sides of a 15 mm cell bow by
#: 0.2 mm in the flat frame; eight chords leave a 64th of the area that one would cut off.
PIECES = 8


@dataclass(frozen=True, eq=False)
class Charts:
    """The flat frames of the k complete cells, to put further points of the skin into them.

    Attributes:
        cells: (R, C) the complete cells; k of them, row-major.
        frames: tangent frames at the k centres.
        curvature: (k,) Gauss curvature, 1/mm^2.
        turn: (k, 2, 2) into the material axes. origin: (k, 2) mean of the skin corners.
    """

    cells: NDArray[np.bool_]
    frames: FlatFrames
    curvature: FloatArray
    turn: FloatArray
    origin: FloatArray

    def flat(
        self, mesh: Mesh, owner: IntArray, points: SurfacePoints, topology: Topology
    ) -> FloatArray:
        """(p, 2) mm in the frame of each point's owner; NaN behind a hole."""
        about = flatten(mesh, self.frames, owner, points, topology)
        kept = equal_area(about, self.curvature[owner]) - self.origin[owner]
        return np.asarray(np.einsum("pab,pb->pa", self.turn[owner], kept))


@dataclass(frozen=True, eq=False)
class FlatOutlines:
    """Skin and patch cells in flat frames; NaN where either is incomplete.

    The frame of a cell has its origin at the mean of the skin corners, its first axis
    along the skin cell's longitudinal mid-line (distal), its second medial; areas are kept.

    Attributes:
        skin, patch: (R, C, n, 2) outlines, mm, n = 4 ``PIECES``, corners at every
            ``PIECES``-th point.
        skin_3d, patch_3d: (R, C, n, 3) the same points on the skin, mm.
        axes: (R, C, 2, 3) directions of the two axes in space.
        curvature: (R, C) Gauss curvature of the skin cell, 1/mm^2.
        turned: (R, C) whether the skin cell or the patch cell is turned over.
        around_hole: (R, C) whether a path of either leads around a hole of the scan.
        charts: the frames themselves; None where the skin is a plane.
    """

    skin: FloatArray
    patch: FloatArray
    skin_3d: FloatArray
    patch_3d: FloatArray
    axes: FloatArray
    curvature: FloatArray
    turned: NDArray[np.bool_]
    around_hole: NDArray[np.bool_]
    charts: Charts | None = None

    @property
    def skin_corners(self) -> FloatArray:
        """(R, C, 4, 2) corners of the skin cells."""
        return self.skin[:, :, ::PIECES]

    @property
    def patch_corners(self) -> FloatArray:
        """(R, C, 4, 2) corners of the patch cells."""
        return self.patch[:, :, ::PIECES]


def sample_paths(sides: GridSides, mesh: Mesh) -> tuple[FloatArray, SurfacePoints]:
    """Points at equal arc lengths along every side.

    Returns:
        (p, PIECES + 1, 3) mm and the same p (PIECES + 1) points in faces, row-major.
    """
    paths = sides.paths
    begin, end = paths.path_offsets[:-1], paths.path_offsets[1:]
    step = np.linalg.norm(np.diff(paths.path_mm, axis=0, append=paths.path_mm[-1:]), axis=1)
    step[end - 1] = 0.0
    along = np.concatenate([[0.0], step.cumsum()])
    part = np.linspace(0.0, 1.0, PIECES + 1)
    at = along[begin, None] + part * (along[end - 1] - along[begin])[:, None]
    segment = np.searchsorted(along, at, side="right") - 1
    segment = np.clip(segment, begin[:, None], np.maximum(end - 2, begin)[:, None])
    length = step[segment]
    share = np.divide(at - along[segment], length, out=np.zeros_like(at), where=length > 0.0)
    share = np.clip(share, 0.0, 1.0)[..., None]
    points = (1.0 - share) * paths.path_mm[segment] + share * paths.path_mm[segment + 1]
    faces = paths.path_faces[segment].ravel()
    return points, SurfacePoints(faces, barycentric_of(mesh, faces, points.reshape(-1, 3)))


def barycentric_of(mesh: Mesh, faces: IntArray, points: FloatArray) -> FloatArray:
    """Weights of points that lie in given faces, up to rounding.

    Args:
        faces: (p,); points: (p, 3) mm.

    Returns:
        (p, 3), none negative, rows sum to 1.
    """
    corner = mesh.corners_mm[faces]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    offset = points - corner[:, 0]
    aa, ab, bb = ((u * v).sum(axis=1) for u, v in ((first, first), (first, second), (second,) * 2))
    pa, pb = (offset * first).sum(axis=1), (offset * second).sum(axis=1)
    det = aa * bb - ab * ab
    w1, w2 = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    weights = np.maximum(np.stack([1.0 - w1 - w2, w1, w2], axis=1), 0.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def cell_outline_index(sides: GridSides, cells: NDArray[np.bool_]) -> IntArray:
    """Which sampled points make up the outline of each complete cell.

    Args:
        cells: (R, C) complete cells.

    Returns:
        (k, 4 PIECES) int32 into the rows of :func:`sample_paths`, corners in the order
        (r, c), (r, c+1), (r+1, c+1), (r+1, c).
    """
    forward = np.arange(PIECES)
    backward = np.arange(PIECES, 0, -1)
    row, col = np.nonzero(cells)

    def points(path: IntArray, order: NDArray[np.intp]) -> NDArray[np.intp]:
        return path[:, None].astype(np.intp) * (PIECES + 1) + order[None, :]

    return np.concatenate(
        [
            points(sides.lateral_path[row, col], forward),
            points(sides.longitudinal_path[row, col + 1], forward),
            points(sides.lateral_path[row + 1, col], backward),
            points(sides.longitudinal_path[row, col], backward),
        ],
        axis=1,
    ).astype(np.int32)


def cell_sides_mm(sides: GridSides) -> FloatArray:
    """(R, C, 4) lengths of the sides, corner i to corner i + 1."""
    along, across = sides.longitudinal_mm, sides.lateral_mm
    return np.stack([across[:-1], along[:, 1:], across[1:], along[:, :-1]], axis=-1)


def flat_outlines(
    mesh: Mesh, skin: LocatedNodes, patch: LocatedNodes, topology: Topology
) -> FlatOutlines:
    """Flatten every pair of a skin cell and its patch cell.

    Args:
        mesh: the bare scan in the worn pose.
        skin: (R+1, C+1) skin nodes under the patch's corners.
        patch: (R+1, C+1) patch corners projected onto the skin.

    Raises:
        PathError: no path joins two nodes of a side, or a centre and its outline.
    """
    complete = skin.cells_present & patch.cells_present
    frames = _frames_of(mesh, skin, complete, topology)
    flat, space, sides = [], [], []
    around = np.zeros(complete.shape, dtype=bool)
    for nodes in (skin, patch):
        side = grid_sides(mesh, nodes, topology)
        line, points = sample_paths(side, mesh)
        index = cell_outline_index(side, complete)
        owner = np.repeat(np.arange(len(index), dtype=np.int32), index.shape[1])
        coordinates = flatten(mesh, frames, owner, points[index.ravel()], topology)
        flat.append(coordinates.reshape(*index.shape, 2))
        around |= cells_around_hole(mesh, side, topology)
        around[complete] |= ~np.isfinite(flat[-1]).all(axis=(1, 2))
        space.append(line.reshape(-1, 3)[index])
        sides.append(side)
    corners = flat[0][:, ::PIECES]
    curvature = gauss_curvature(corners, cell_sides_mm(sides[0])[complete])
    area = [signed_area(outline[:, ::PIECES]) for outline in flat]
    sense = float(np.sign(np.nansum(np.sign(area[0])))) or 1.0
    turned = (area[0] * sense <= 0.0) | (area[1] * sense <= 0.0)
    kept = [equal_area(outline, curvature[:, None]) for outline in flat]
    turn, origin = _material_axes(kept[0][:, ::PIECES], sense)
    kept = [np.einsum("kab,knb->kna", turn, outline - origin[:, None]) for outline in kept]
    axes = np.einsum("kab,kbx->kax", turn, frames.axes[:, :2])

    def full(values: FloatArray) -> FloatArray:
        out = np.full((*complete.shape, *values.shape[1:]), np.nan)
        out[complete] = values
        return out

    flag = np.zeros(complete.shape, dtype=bool)
    flag[complete] = turned
    return FlatOutlines(
        skin=full(kept[0]),
        patch=full(kept[1]),
        skin_3d=full(space[0]),
        patch_3d=full(space[1]),
        axes=full(axes),
        curvature=full(curvature),
        turned=flag,
        around_hole=around & complete,
        charts=Charts(complete, frames, curvature, turn, origin),
    )


def _frames_of(
    mesh: Mesh, skin: LocatedNodes, complete: NDArray[np.bool_], topology: Topology
) -> FlatFrames:
    every = cell_frames(mesh, skin, topology)
    kept = np.flatnonzero(complete[skin.cells_present])
    return FlatFrames(every.centres[kept], every.axes[kept])


def _material_axes(corners: FloatArray, sense: float) -> tuple[FloatArray, FloatArray]:
    """Rotation (or reflection) into the material frame, and its origin.

    Args:
        corners: (k, 4, 2) skin corners.
        sense: +1 where lateral to medial is counter-clockwise of distal, else -1.
    """
    along, _ = mid_lines(corners)
    first = along / np.linalg.norm(along, axis=-1, keepdims=True)
    second = sense * np.stack([-first[:, 1], first[:, 0]], axis=-1)
    return np.stack([first, second], axis=1), corners.mean(axis=1)
