"""Repair of a scan: what can be mended without guessing, and a refusal of the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import MeshError
from kiribench.surface.clean import clean
from kiribench.surface.clean_state import Cleaned
from kiribench.surface.mesh import FloatArray, IntArray, Mesh, SurfacePoints

_MENDED = frozenset(
    {
        "mesh-unwelded",
        "mesh-degenerate-faces",
        "mesh-duplicate-faces",
        "mesh-specks",
        "mesh-winding",
        "mesh-inside-out",
        "mesh-bow-ties",
        "mesh-unreferenced",
    }
)


@dataclass(frozen=True, eq=False)
class Repaired:
    """A mesh on which geodesics are defined, and how it came about.

    Attributes:
        mesh: the repaired mesh; the very mesh that was given if nothing was wrong with it.
        actions: what was done, one sentence with magnitudes each; empty if nothing was.
        face_map: (m,) int64, the face of the given mesh that each face was (or lies in).
        vertex_map: (n,) int64, the vertex of the given mesh that each vertex was.
        face_of: (m given,) int64, the face that each given face is now (a dropped duplicate:
            its twin); -1 where it is gone or was remade.
        corner_of: (m given, 3) int8, the corner of that face at each given corner.
    """

    mesh: Mesh
    actions: tuple[str, ...]
    face_map: NDArray[np.int64]
    vertex_map: NDArray[np.int64]
    face_of: NDArray[np.int64]
    corner_of: NDArray[np.int8]

    @cached_property
    def unchanged(self) -> bool:
        """Whether the mesh is the one that was given."""
        return not self.actions

    def carry(self, points: SurfacePoints) -> tuple[SurfacePoints, NDArray[np.bool_]]:
        """Points on the given mesh as points on the repaired one.

        Args:
            points: (k,) on the given mesh.

        Returns:
            The points (k,) and whether each could be carried (k,); where not (its face is
            gone), face 0's first corner stands in: locate such a point by its position.
        """
        face = self.face_of[points.faces]
        good = face >= 0
        barycentric = np.zeros_like(points.barycentric)
        corner = self.corner_of[points.faces].astype(np.int64)
        np.put_along_axis(barycentric, corner, points.barycentric, axis=1)
        barycentric[~good] = (1.0, 0.0, 0.0)
        return SurfacePoints(np.where(good, face, 0).astype(np.int32), barycentric), good


def repair_mesh(mesh: Mesh, *, file: str | None = None) -> Repaired:
    """Mend ``mesh`` (mm), or refuse it.

    Mended: unwelded, unreferenced and bow-tie vertices, duplicate and degenerate faces,
    specks below 1 % of the largest piece, winding. Left as they are: holes, several large
    pieces. No vertex moves.

    Raises:
        MeshError: with every error at once: ``mesh-no-faces``, ``mesh-index-range``,
            ``mesh-nan-vertex``, ``mesh-huge``, ``mesh-tiny``, ``mesh-far-off``,
            ``mesh-no-area``, ``mesh-degenerate``, ``mesh-nonmanifold``, ``mesh-one-sided``.
    """
    work = clean(mesh, file=file)
    if not work.usable:
        raise MeshError.of(fault for fault in work.faults if fault.severity == "error")
    actions = tuple(fault.what for fault in work.faults if fault.code in _MENDED)
    if not actions:
        identity = np.arange(len(mesh.faces))
        corners = np.tile(np.arange(3, dtype=np.int8), (len(mesh.faces), 1))
        return Repaired(mesh, (), identity, np.arange(len(mesh.vertices_mm)), identity, corners)
    face_of, corner_of = _faces_now(mesh, work)
    uv, face_uv = _texture(mesh, work)
    repaired = Mesh(
        vertices_mm=np.ascontiguousarray(work.xyz),
        faces=work.faces,
        uv=uv,
        face_uv=face_uv,
        colours=None if mesh.colours is None else mesh.colours[work.vertex_source],
        texture=mesh.texture,
    )
    return Repaired(
        mesh=repaired,
        actions=actions,
        face_map=work.face_source,
        vertex_map=work.vertex_source,
        face_of=face_of,
        corner_of=corner_of,
    )


def _faces_now(mesh: Mesh, work: Cleaned) -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """For every given face the face that it is now, and where its corners went."""
    face_of = np.full(len(mesh.faces), -1, dtype=np.int64)
    kept = ~work.remade
    face_of[work.face_source[kept]] = np.flatnonzero(kept)
    face_of = np.where(face_of >= 0, face_of, face_of[work.twin])
    before = work.welded_to[mesh.faces]
    now = work.welded_to[work.vertex_source[work.faces]][np.maximum(face_of, 0)]
    match = before[:, :, None] == now[:, None, :]
    complete = match.any(axis=2).all(axis=1)
    face_of[~complete] = -1
    return face_of, match.argmax(axis=2).astype(np.int8)


def _texture(mesh: Mesh, work: Cleaned) -> tuple[FloatArray | None, IntArray | None]:
    """Texture corners of the kept faces; remade faces take theirs from the face they lie in."""
    if mesh.uv is None or mesh.face_uv is None:
        return mesh.uv, None
    rows = mesh.face_uv[work.face_source].copy()
    rows[work.flipped] = rows[work.flipped][:, [0, 2, 1]]
    remade = np.flatnonzero(work.remade)
    if len(remade) == 0:
        return mesh.uv, np.ascontiguousarray(rows)
    source = work.face_source[remade]
    origin, *corners = np.moveaxis(mesh.vertices_mm[mesh.faces[source]], 1, 0)
    sides = np.stack([corner - origin for corner in corners], axis=2)
    offsets = work.xyz[work.faces[remade]] - origin[:, None, :]
    weights = np.einsum("kij,kcj->kci", np.linalg.pinv(sides), offsets)
    at, *others = np.moveaxis(mesh.uv[mesh.face_uv[source]], 1, 0)
    uv_sides = np.stack([other - at for other in others], axis=1)
    uv = at[:, None, :] + np.einsum("kci,kiu->kcu", weights, uv_sides)
    rows[remade] = len(mesh.uv) + np.arange(3 * len(remade), dtype=np.int32).reshape(-1, 3)
    return np.concatenate([mesh.uv, uv.reshape(-1, 2)]), np.ascontiguousarray(rows)
