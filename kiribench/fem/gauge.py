"""What is read off a deformed sheet: stretches of cells, and overlap of crack faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.fem.mesh import SheetMesh

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def site_positions(mesh: SheetMesh, x: FloatArray) -> FloatArray:
    """Where the lattice sites are in the deformed sheet: (Q + 1, P + 1, 2) mm.

    A site is the middle of a cut, so two nodes lie on it, one on either face; its place is
    their mean. One face alone would be wrong by half the opening of the cut.

    Args:
        mesh: the sheet.
        x: (n, 2) deformed nodes, mm.
    """
    rows, columns = mesh.corners.shape[:2]
    total = np.zeros((rows + 1, columns + 1, 2))
    facets = np.zeros((rows + 1, columns + 1, 1))
    # Every face at a site belongs to two facets (one face at an outline: to one), so the mean
    # over facets is the mean over faces.
    for k, (down, right) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
        into = (slice(down, down + rows), slice(right, right + columns))
        total[into] += x[mesh.corners[:, :, k]]
        facets[into] += 1
    return np.asarray(total / facets)


@dataclass(frozen=True, eq=False)
class CellStretches:
    """Length ratios deformed / rest of cells, each the mean of two opposite cell edges.

    Attributes:
        longitudinal: (R, C) along the pull (y).
        lateral: (R, C) across the pull (x).
    """

    longitudinal: FloatArray
    lateral: FloatArray


def cell_stretches(corners_mm: FloatArray, cell_mm: float) -> CellStretches:
    """Stretches of square cells from their deformed corners (R + 1, C + 1, 2) mm."""
    along = np.linalg.norm(np.diff(corners_mm, axis=0), axis=2) / cell_mm
    across = np.linalg.norm(np.diff(corners_mm, axis=1), axis=2) / cell_mm
    return CellStretches(0.5 * (along[:, :-1] + along[:, 1:]), 0.5 * (across[:-1] + across[1:]))


@dataclass(frozen=True, eq=False)
class FacePairs:
    """Opposite crack faces in one flat table, for the overlap check.

    Attributes:
        left, right: (k,) nodes of the faces, face after face. ``left`` faces have their
            facet to the left of the walk from site to tip, ``right`` ones to the right.
        left_start, right_start: (f + 1,) where each face begins.
    """

    left: IntArray
    right: IntArray
    left_start: IntArray
    right_start: IntArray

    @classmethod
    def of(cls, mesh: SheetMesh) -> FacePairs:
        """The pairs of every half-cut inside the sheet."""
        faces = mesh.cut_faces()
        empty = [np.empty(0, dtype=np.int64)]
        return cls(
            np.concatenate([*empty, *(left for left, _ in faces)]),
            np.concatenate([*empty, *(right for _, right in faces)]),
            np.concatenate([[0], np.cumsum([len(left) for left, _ in faces], dtype=np.int64)]),
            np.concatenate([[0], np.cumsum([len(right) for _, right in faces], dtype=np.int64)]),
        )

    def overlap_mm(self, x: FloatArray) -> float:
        """Largest depth of a node of one face behind the opposite face, mm; 0 if none."""
        if not len(self.left):
            return 0.0
        depth = deepest_overlap(x, self.left, self.right, self.left_start, self.right_start)
        return float(depth.max())


def deepest_overlap(
    x: FloatArray,
    left: IntArray,
    right: IntArray,
    left_start: IntArray,
    right_start: IntArray,
) -> FloatArray:
    """(f,) largest depth of a node of either face behind the other at nodes x (n, 2), mm.

    Faces as the attributes of ``FacePairs`` say.
    """
    one = _deepest(x, left, left_start, right, right_start, -1.0)
    two = _deepest(x, right, right_start, left, left_start, 1.0)
    return np.asarray(np.maximum(one, two))


@njit(cache=True, error_model="numpy")
def _deepest(
    x: FloatArray,
    probes: IntArray,
    probe_start: IntArray,
    face: IntArray,
    face_start: IntArray,
    inside: float,
) -> FloatArray:
    """(f,) largest depth of a face's probes behind its polyline.

    ``inside`` is +1 where the body is to the left.

    A probe counts where its nearest point of the polyline lies within it, not at an end.
    """
    deepest = np.zeros(len(face_start) - 1)
    for f in range(len(face_start) - 1):
        for k in range(probe_start[f], probe_start[f + 1]):
            px, py = x[probes[k], 0], x[probes[k], 1]
            best, depth = np.inf, 0.0
            for s in range(face_start[f], face_start[f + 1] - 1):
                ax, ay = x[face[s], 0], x[face[s], 1]
                ex, ey = x[face[s + 1], 0] - ax, x[face[s + 1], 1] - ay
                length2 = ex * ex + ey * ey
                t = ((px - ax) * ex + (py - ay) * ey) / length2
                t_in = min(1.0, max(0.0, t))
                dx, dy = px - ax - t_in * ex, py - ay - t_in * ey
                distance = dx * dx + dy * dy
                if distance < best:
                    best = distance
                    at_end = (s == face_start[f] and t < 0) or (
                        s == face_start[f + 1] - 2 and t > 1
                    )
                    behind = inside * (ex * dy - ey * dx) > 0
                    depth = np.sqrt(distance) if behind and not at_end else 0.0
            deepest[f] = max(deepest[f], depth)
    return deepest
