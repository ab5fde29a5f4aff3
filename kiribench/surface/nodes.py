"""Grid nodes on their scan: from a nodes table to points inside faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, NodesError
from kiribench.schema.nodes import NodesTable
from kiribench.surface.locate import locate
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints
from kiribench.surface.repair import Repaired

#: A node farther than this from its scan belongs to another scan, frame or unit. Four
#: times the usual node error; the closest point of a coarse or denoised mesh stays within.
OFF_SURFACE_MM = 1.0

#: So many single nodes are named before the rest is only counted.
NAMED_NODES = 10


@dataclass(frozen=True, eq=False)
class LocatedNodes:
    """A grid of nodes on a mesh; shape (R+1, C+1), row 0 proximal, column 0 lateral.

    Attributes:
        points: the k nodes that are present, inside faces of the mesh.
        index: (R+1, C+1) int32 into ``points``, -1 where the node is missing or hidden.
        sd_mm: (R+1, C+1) standard deviation of the node in each tangent direction.
        offset_mm: (R+1, C+1) distance of the table's position from the surface, NaN where
            absent.
        positions_mm: (R+1, C+1, 3) on the surface, NaN where absent.
        sd_source: where ``sd_mm`` comes from (``column``, ``sidecar``, ``default``).
    """

    points: SurfacePoints
    index: IntArray
    sd_mm: FloatArray
    offset_mm: FloatArray
    positions_mm: FloatArray
    sd_source: str

    @property
    def present(self) -> NDArray[np.bool_]:
        """(R+1, C+1) whether the node was seen."""
        return np.asarray(self.index >= 0)

    @property
    def cells_present(self) -> NDArray[np.bool_]:
        """(R, C) whether all four corners of the cell were seen."""
        seen = self.present
        return np.asarray(seen[:-1, :-1] & seen[:-1, 1:] & seen[1:, 1:] & seen[1:, :-1])

    def window(self, row: int, column: int, shape: tuple[int, int]) -> LocatedNodes:
        """The nodes of a part of the grid, ``shape`` nodes from (row, column) on."""
        part = (slice(row, row + shape[0]), slice(column, column + shape[1]))
        old = self.index[part]
        kept = old[old >= 0]
        index = np.full(old.shape, -1, dtype=np.int32)
        index[old >= 0] = np.arange(len(kept), dtype=np.int32)
        return LocatedNodes(
            self.points[kept],
            index,
            self.sd_mm[part],
            self.offset_mm[part],
            self.positions_mm[part],
            self.sd_source,
        )

    def moved(self, mesh: Mesh) -> LocatedNodes:
        """The same material points on a mesh with the same faces (a denoised scan)."""
        positions = np.full_like(self.positions_mm, np.nan)
        positions[self.present] = self.points.positions_mm(mesh)
        return LocatedNodes(
            self.points, self.index, self.sd_mm, self.offset_mm, positions, self.sd_source
        )


def locate_nodes(
    mesh: Mesh,
    table: NodesTable,
    *,
    repaired: Repaired | None = None,
    tolerance_mm: float = OFF_SURFACE_MM,
) -> LocatedNodes:
    """Put the nodes of a table on a scan.

    A node with face and barycentric weights is taken as such and checked against its
    position; a node with a position only goes to the closest point of the surface.

    Args:
        mesh: the scan in mm, after repair.
        table: k nodes; its faces are those of the file.
        repaired: how ``mesh`` came from the file's mesh; None where it is that mesh. A
            node on a face that repair dropped goes to the closest point of what is left.
        tolerance_mm: largest distance of a position from the surface.

    Raises:
        NodesError: ``nodes-off-surface`` (check units, frame and that table and scan belong
            together), ``nodes-face-range``, ``nodes-face-mismatch``; all nodes at once.
    """
    seen = table.present
    rows, cols, xyz = table.row[seen], table.col[seen], table.xyz_mm[seen]
    lines = table.line[seen]
    found = locate(mesh, xyz)
    faces = found.points.faces.copy()
    weights = found.points.barycentric.copy()
    distance = np.asarray(found.distance_mm).copy()
    faults = _off_surface(table, lines, distance, tolerance_mm)
    if table.face is not None and table.barycentric is not None:
        wanted, known = _given_places(table, mesh, repaired, faults)
        gap = np.where(known, np.linalg.norm(wanted.positions_mm(mesh) - xyz, axis=1), 0.0)
        for k in np.flatnonzero(gap > tolerance_mm)[:NAMED_NODES]:
            faults.append(
                Fault(
                    "nodes-face-mismatch",
                    "The node's position and its place on the face disagree.",
                    "Write one of the two anew: the scan's faces were probably reordered.",
                    file=str(table.file),
                    row=int(lines[k]),
                    column="face",
                    got=f"{gap[k]:.3g} mm apart",
                    expected=f"at most {tolerance_mm:g} mm",
                )
            )
        faces[known] = wanted.faces[known]
        weights[known] = wanted.barycentric[known]
        distance[known] = gap[known]
    if faults:
        raise NodesError.of(faults)
    return _grid(mesh, table, seen, SurfacePoints(faces, weights), rows, cols, distance)


def _grid(
    mesh: Mesh,
    table: NodesTable,
    seen: NDArray[np.bool_],
    points: SurfacePoints,
    rows: IntArray,
    cols: IntArray,
    distance: FloatArray,
) -> LocatedNodes:
    index = np.full(table.shape, -1, dtype=np.int32)
    index[rows, cols] = np.arange(len(points), dtype=np.int32)
    sd = np.full(table.shape, np.nan)
    sd[table.row, table.col] = table.sd_mm
    offset = np.full(table.shape, np.nan)
    offset[rows, cols] = distance
    positions = np.full((*table.shape, 3), np.nan)
    positions[rows, cols] = points.positions_mm(mesh)
    return LocatedNodes(points, index, sd, offset, positions, table.sd_source)


def _off_surface(
    table: NodesTable, lines: IntArray, distance: FloatArray, tolerance_mm: float
) -> list[Fault]:
    far = np.flatnonzero(~(distance <= tolerance_mm))
    if len(far) == 0:
        return []
    labels = np.array(table.labels())[table.present]
    worst = far[np.argsort(-distance[far])]
    faults = [
        Fault(
            "nodes-off-surface",
            f"{labels[k]} does not lie on the scan.",
            "Check that scan and nodes are of the same acquisition, frame and unit "
            "(nodes are in mm; the scan's unit stands in its sidecar).",
            file=str(table.file),
            row=int(lines[k]),
            column="x_mm",
            got=f"{distance[k]:.3g} mm off",
            expected=f"at most {tolerance_mm:g} mm",
        )
        for k in worst[:NAMED_NODES]
    ]
    if len(far) > NAMED_NODES:
        faults.append(
            Fault(
                "nodes-off-surface",
                f"{len(far)} of {len(distance)} nodes do not lie on the scan.",
                "If all are off, scan and table are in different frames or units.",
                file=str(table.file),
                got=f"median {np.median(distance):.3g} mm off",
                expected=f"at most {tolerance_mm:g} mm",
            )
        )
    return faults


def _given_places(
    table: NodesTable, mesh: Mesh, repaired: Repaired | None, faults: list[Fault]
) -> tuple[SurfacePoints, NDArray[np.bool_]]:
    """The places on faces that the table gives, on the repaired mesh, and which count.

    Returns:
        One point a present node (the first corner of face 0 where there is none), and
        (k,) whether it is the table's.
    """
    seen = table.present
    given = np.full(int(seen.sum()), -1, dtype=np.int64)
    weights = np.zeros((len(given), 3))
    if table.face is not None and table.barycentric is not None:
        given = table.face[seen].astype(np.int64)
        weights = table.barycentric[seen]
    limit = len(mesh.faces) if repaired is None else len(repaired.face_of)
    lines = table.line[seen]
    for k in np.flatnonzero(given >= limit)[:NAMED_NODES]:
        faults.append(
            Fault(
                "nodes-face-range",
                "The node names a face that the scan does not have.",
                "Count faces from 0 in the order of the scan file.",
                file=str(table.file),
                row=int(lines[k]),
                column="face",
                got=str(int(given[k])),
                expected=f"0 to {limit - 1}",
            )
        )
    known = np.asarray((given >= 0) & (given < limit))
    points = SurfacePoints(
        np.where(known, given, 0).astype(np.int32),
        np.where(known[:, None], weights, [1.0, 0.0, 0.0]),
    )
    if repaired is not None:
        points, carried = repaired.carry(points)
        known = known & carried
    return points, known
