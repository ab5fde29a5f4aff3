"""The skin that a patch is put on: missing nodes, and whether it is flat at rest.

Material coordinates q are mm on the flat drawn grid, and a patch that fits perfectly is laid with
(x, y) = q. That holds if the skin at 0 degrees can be laid flat with the grid's pitch. A skin
that cannot (Gauss curvature) is measured here, and needs a rest map: where a flat patch comes to
lie on it with the least distortion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import NodesError

FloatArray = npt.NDArray[np.float64]

MOST_MISMATCH = 0.03
"""Root mean square difference of edge lengths from the pitch up to which a skin counts as flat:
on 15 mm it is .45 mm, about the error of two drawn nodes."""

_MOST_MISSING = 0.1


def fill_nodes(xyz_mm: FloatArray) -> FloatArray:
    """Nodes (R + 1, C + 1, 3) with those that are missing (NaN) put where the grid bends least.

    The sum of squared second differences along rows and columns is minimised.

    Raises:
        NodesError: more than a tenth of the nodes are missing, or some of a grid with fewer than
            three rows or columns of nodes.
    """
    nodes = np.array(xyz_mm, dtype=np.float64)
    absent = ~np.isfinite(nodes).all(axis=2)
    if not absent.any():
        return nodes
    if absent.mean() > _MOST_MISSING or min(absent.shape) < 3:
        raise NodesError(
            "nodes-too-few",
            "Too many nodes are missing to fill them from their neighbours.",
            remedy="Digitise more of the grid.",
            got=f"{int(absent.sum())} of {absent.shape[0]} x {absent.shape[1]} missing",
            expected=f"at most {_MOST_MISSING:.0%}, and a grid of 3 x 3 nodes or more",
        )
    rows, columns = absent.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    triples = np.concatenate(
        [
            np.stack([number[:-2], number[1:-1], number[2:]], axis=-1).reshape(-1, 3),
            np.stack([number[:, :-2], number[:, 1:-1], number[:, 2:]], axis=-1).reshape(-1, 3),
        ]
    )
    bend = np.zeros((len(triples), rows * columns))
    bend[np.arange(len(triples))[:, None], triples] = (1.0, -2.0, 1.0)
    flat, gone = nodes.reshape(-1, 3), absent.ravel()
    right = -bend[:, ~gone] @ flat[~gone]
    flat[gone] = np.linalg.lstsq(bend[:, gone], right, rcond=None)[0]
    return nodes


@dataclass(frozen=True, eq=False)
class Flatness:
    """How far a drawn grid is from a flat one; nodes (R + 1, C + 1), edges as chords.

    Attributes:
        gauss_curvature: (R - 1, C - 1) at inner nodes, 1/mm^2: angle defect of the four cells
            round a node / a quarter of their area.
        total_curvature: its integral over the grid, radians; 0 where developable.
        along_mismatch: (R, C + 1) length of the edges along / pitch - 1.
        across_mismatch: (R + 1, C) the same of edges across.
        shear: (R, C) cosine of the angle between the mid-lines of the cells.
    """

    gauss_curvature: FloatArray
    total_curvature: float
    along_mismatch: FloatArray
    across_mismatch: FloatArray
    shear: FloatArray

    @property
    def mismatch(self) -> float:
        """Root mean square of both edge mismatches and the shear."""
        parts = np.concatenate(
            [self.along_mismatch.ravel(), self.across_mismatch.ravel(), self.shear.ravel()]
        )
        return float(np.sqrt(np.mean(parts * parts)))

    @property
    def flat(self) -> bool:
        """Whether the mismatch is within ``MOST_MISMATCH``."""
        return self.mismatch <= MOST_MISMATCH


def flatness(xyz_mm: FloatArray, pitch_mm: float) -> Flatness:
    """Measure nodes (R + 1, C + 1, 3) mm, none missing, against a flat grid of a pitch."""
    nodes = np.asarray(xyz_mm, dtype=np.float64)
    along = np.linalg.norm(np.diff(nodes, axis=0), axis=2) / pitch_mm - 1
    across = np.linalg.norm(np.diff(nodes, axis=1), axis=2) / pitch_mm - 1
    corners = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    # Angles and areas of the cells as pairs of triangles, the mean of both diagonals.
    before, after = np.roll(corners, 1, axis=2) - corners, np.roll(corners, -1, axis=2) - corners
    diagonal = np.roll(corners, 2, axis=2) - corners
    split = _angle(before, diagonal) + _angle(diagonal, after)
    angle = 0.5 * (_angle(before, after) + split)
    area = 0.5 * np.linalg.norm(np.cross(before, after), axis=3).sum(axis=2) / 2
    defect = 2 * np.pi - (
        angle[1:, 1:, 0] + angle[1:, :-1, 1] + angle[:-1, :-1, 2] + angle[:-1, 1:, 3]
    )
    around = 0.25 * (area[1:, 1:] + area[1:, :-1] + area[:-1, :-1] + area[:-1, 1:])
    down = corners[:, :, 3] + corners[:, :, 2] - corners[:, :, 0] - corners[:, :, 1]
    side = corners[:, :, 1] + corners[:, :, 2] - corners[:, :, 0] - corners[:, :, 3]
    shear = np.einsum("rcd,rcd->rc", down, side) / (
        np.linalg.norm(down, axis=2) * np.linalg.norm(side, axis=2)
    )
    return Flatness(defect / around, float(defect.sum()), along, across, shear)


def _angle(one: FloatArray, two: FloatArray) -> FloatArray:
    cross = np.linalg.norm(np.cross(one, two), axis=-1)
    return np.asarray(np.arctan2(cross, np.einsum("...d,...d->...", one, two)))
