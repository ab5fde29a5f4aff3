"""Triangle meshes and points on them, as immutable values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in millimetres.

    Attributes:
        vertices_mm: (n, 3) float64.
        faces: (m, 3) int32, 0-based, counter-clockwise seen from outside.
        uv: (k, 2) float64 texture coordinates, or None.
        face_uv: (m, 3) int32 into ``uv``, or None.
        colours: (n, 3) uint8 vertex colours, or None.
        texture: path of the texture picture, or None.
    """

    vertices_mm: FloatArray
    faces: IntArray
    uv: FloatArray | None = None
    face_uv: IntArray | None = None
    colours: NDArray[np.uint8] | None = None
    texture: Path | None = None

    @cached_property
    def corners_mm(self) -> FloatArray:
        """(m, 3, 3) corner positions of every face."""
        return self.vertices_mm[self.faces]

    @cached_property
    def face_normals(self) -> FloatArray:
        """(m, 3) unit normals; zero for a degenerate face."""
        corners = self.corners_mm
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.asarray(np.divide(normal, length, out=np.zeros_like(normal), where=length > 0))

    @cached_property
    def face_areas_mm2(self) -> FloatArray:
        """(m,) areas."""
        corners = self.corners_mm
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(0.5 * np.linalg.norm(normal, axis=1))


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on a mesh, each inside (or on the border of) one face.

    Attributes:
        faces: (k,) int32 face indices.
        barycentric: (k, 3) float64, rows sum to 1, each >= 0.
    """

    faces: IntArray
    barycentric: FloatArray

    def __len__(self) -> int:
        return len(self.faces)

    def __getitem__(
        self, index: NDArray[np.integer[Any]] | NDArray[np.bool_] | slice
    ) -> SurfacePoints:
        return SurfacePoints(self.faces[index], self.barycentric[index])

    def positions_mm(self, mesh: Mesh) -> FloatArray:
        """(k, 3) positions on ``mesh``."""
        return np.asarray(np.einsum("kc,kcx->kx", self.barycentric, mesh.corners_mm[self.faces]))
