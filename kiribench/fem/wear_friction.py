"""Coulomb friction between patch and skin, along the way from 0 to 90 degrees.

In every step each node drags on the skin with mu times the normal force that it had, against
its slip in the step, measured on the skin: the potential mu N (sqrt(|slip|^2 + e^2) - e) is
minimised together with the elastic energy. Slip below e is creep: that is the regularisation.
The normal forces are brought up to date by solving each step again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.surface_map import NodeSpline, SurfaceMap
from kiribench.fem.wear_system import Equilibrium, WearSystem, relax

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CREEP_MM = 0.05
"""Slip at which friction reaches 0.7 of its limit."""

_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Drag:
    """The friction potential of one step.

    Attributes:
        start: (U, 2) q at the start of the step.
        limit: (U,) mu times normal force, N per mm thickness.
        metric: (U, 2, 2) of the skin at the start.
    """

    start: FloatArray
    limit: FloatArray
    metric: FloatArray

    def _slip(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        pulled = np.einsum("nab,nb->na", self.metric, q - self.start)
        square = np.einsum("na,na->n", pulled, q - self.start)
        return pulled, np.sqrt(square + CREEP_MM**2)

    def energy(self, q: FloatArray) -> float:
        """The potential at q (U, 2), N."""
        return float(np.sum(self.limit * (self._slip(q)[1] - CREEP_MM)))

    def gradient(self, q: FloatArray) -> FloatArray:
        """(U, 2) its derivative."""
        pulled, size = self._slip(q)
        return np.asarray((self.limit / size)[:, None] * pulled)

    def stiffness(self, q: FloatArray) -> FloatArray:
        """(U, 4) its second derivative, row by row; never negative."""
        pulled, size = self._slip(q)
        outer = pulled[:, :, None] * pulled[:, None, :] / (size**2)[:, None, None]
        return np.asarray((self.limit / size)[:, None] * (self.metric - outer).reshape(-1, 4))


def drag_along(
    system: WearSystem, path: Sequence[SurfaceMap], laid: FloatArray, friction: float
) -> Equilibrium:
    """Follow the skin along ``path`` (the last is the pose) from q ``laid`` (U, 2).

    The system's surface is set to each of the path in turn and is the last one afterwards.
    """
    q = laid
    iterations = 0
    limit = np.zeros(len(q))
    found = Equilibrium(q, np.zeros((len(q), 3)), 0, 0.0, "the path of the skin is empty")
    for surface in path:
        system.surface = surface
        metric = system.jet(q).metric
        start = q
        for _ in range(_ROUNDS):
            found = relax(system, q, Drag(start, limit, metric))
            iterations += found.iterations
            if found.reason is not None:
                break
            q = found.q
            jet = system.jet(q)
            normal = np.einsum("na,na->n", found.force, jet.normal(surface.outward))
            limit = friction * np.maximum(normal, 0.0)
        if found.reason is not None:
            break
    return Equilibrium(found.q, found.force, iterations, found.energy, found.reason)


def skin_path(
    rest_mm: FloatArray, pose_mm: FloatArray, pitch_mm: float, steps: int = 10
) -> list[NodeSpline]:
    """Skins between two poses of the same grid (R + 1, C + 1, 3), at 1/steps, ..., 1.

    As rigid as possible (Alexa et al. 2000, doi 10.1145/344779.344859): the deformation of every
    triangle of nodes is split in a rotation, whose angle grows evenly, and a stretch, which grows
    evenly; the nodes follow by least squares. The last skin is the pose itself, moved rigidly
    onto the rest: a patch does not feel rigid motions.
    """
    from scipy.spatial.transform import Rotation

    rest = np.asarray(rest_mm, dtype=np.float64).reshape(-1, 3)
    turn, _ = Rotation.align_vectors(
        rest - rest.mean(axis=0), pose_mm.reshape(-1, 3) - pose_mm.reshape(-1, 3).mean(axis=0)
    )
    pose = turn.apply(pose_mm.reshape(-1, 3) - pose_mm.reshape(-1, 3).mean(axis=0))
    triangles = _triangles(rest_mm.shape[0], rest_mm.shape[1])
    before, after = _frames(rest, triangles), _frames(pose, triangles)
    left, stretch, right = np.linalg.svd(after @ np.linalg.inv(before))
    rotation = Rotation.from_matrix(left @ right).as_rotvec()
    strain = np.einsum("tki,tk,tkj->tij", right, stretch, right) - np.eye(3)
    # Edge vectors of all triangles by nodes; the mean of the nodes stays in the origin.
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [0, 2]], triangles[:, [1, 2]]])
    difference = np.zeros((len(edges) + 1, len(rest)))
    difference[np.arange(len(edges)), edges[:, 0]] = -1.0
    difference[np.arange(len(edges)), edges[:, 1]] = 1.0
    difference[-1] = 1.0
    solve = np.linalg.pinv(difference)
    vectors = rest[edges[:, 1]] - rest[edges[:, 0]]
    result = []
    for step in range(1, steps + 1):
        part = step / steps
        gradient = Rotation.from_rotvec(part * rotation).as_matrix() @ (np.eye(3) + part * strain)
        wanted = np.einsum("tij,tj->ti", np.concatenate([gradient] * 3), vectors)
        nodes = solve @ np.concatenate([wanted, np.zeros((1, 3))])
        if step == steps:
            nodes = pose
        result.append(NodeSpline.of(nodes.reshape(rest_mm.shape), pitch_mm))
    return result


def _triangles(rows: int, columns: int) -> IntArray:
    """Four triangles a cell: both ways of splitting it."""
    number = np.arange(rows * columns).reshape(rows, columns)
    corners = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1
    )
    flat = corners.reshape(-1, 4)
    return np.concatenate(
        [flat[:, [0, 1, 2]], flat[:, [0, 2, 3]], flat[:, [0, 1, 3]], flat[:, [1, 2, 3]]]
    )


def _frames(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(t, 3, 3) two edges and the unit normal as columns."""
    one = points[triangles[:, 1]] - points[triangles[:, 0]]
    two = points[triangles[:, 2]] - points[triangles[:, 0]]
    normal = np.cross(one, two)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([one, two, normal], axis=-1)
