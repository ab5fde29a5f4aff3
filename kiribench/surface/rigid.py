"""Rigid motions: apply, invert, and the best one between corresponding points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.errors import RegistrationError
from kiribench.surface.mesh import FloatArray, Mesh


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """``x -> rotation x + translation``.

    Attributes:
        rotation: (3, 3) proper rotation.
        translation_mm: (3,).
    """

    rotation: FloatArray
    translation_mm: FloatArray

    @classmethod
    def identity(cls) -> RigidTransform:
        """The motion that moves nothing."""
        return cls(np.eye(3), np.zeros(3))

    def apply(self, points_mm: FloatArray) -> FloatArray:
        """(..., 3) the moved points."""
        return np.asarray(points_mm @ self.rotation.T + self.translation_mm)

    def after(self, first: RigidTransform) -> RigidTransform:
        """This motion after ``first``."""
        return RigidTransform(self.rotation @ first.rotation, self.apply(first.translation_mm))

    def inverse(self) -> RigidTransform:
        """The motion back."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation_mm)

    def moved(self, mesh: Mesh) -> Mesh:
        """``mesh`` moved; everything but its vertices is shared."""
        return Mesh(
            vertices_mm=self.apply(mesh.vertices_mm),
            faces=mesh.faces,
            uv=mesh.uv,
            face_uv=mesh.face_uv,
            colours=mesh.colours,
            texture=mesh.texture,
        )

    @property
    def angle_deg(self) -> float:
        """The angle of the rotation, 0 to 180."""
        skew = self.rotation - self.rotation.T
        sine = 0.5 * np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]])
        return float(np.degrees(np.arctan2(sine, 0.5 * (np.trace(self.rotation) - 1.0))))


def rotation_of(vector: FloatArray) -> FloatArray:
    """(3, 3) rotation about ``vector`` (3,) by its length in radians (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # sin(a)/a and (1 - cos(a))/a^2 without loss at small angles.
    first = float(np.sinc(angle / np.pi))
    second = 0.5 * float(np.sinc(angle / (2 * np.pi))) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def kabsch(source_mm: FloatArray, target_mm: FloatArray) -> RigidTransform:
    """The rigid motion that takes ``source_mm`` (k, 3) onto ``target_mm`` (k, 3) best.

    Least squares over proper rotations (Kabsch 1978, doi 10.1107/S0567739478001680); rows
    that are not finite in either are left out.

    Raises:
        RegistrationError: ``registration-correspondences``, fewer than three points in common
            or all on one line; give more common nodes, or no initial motion.
    """
    common = np.isfinite(source_mm).all(axis=1) & np.isfinite(target_mm).all(axis=1)
    source, target = source_mm[common], target_mm[common]
    remedy = "Mark at least three nodes, not on one line, that both scans show."
    if len(source) < 3:
        raise RegistrationError(
            "registration-correspondences",
            f"{len(source)} corresponding points cannot fix a rigid motion.",
            remedy=remedy,
            got=len(source),
            expected="at least 3",
        )
    from_centre, to_centre = source.mean(axis=0), target.mean(axis=0)
    left, sizes, right = np.linalg.svd((source - from_centre).T @ (target - to_centre))
    if sizes[1] <= 1e-9 * max(sizes[0], np.finfo(float).tiny):
        raise RegistrationError(
            "registration-correspondences",
            "The corresponding points lie on one line; the rotation about it is free.",
            remedy=remedy,
        )
    sign = np.sign(np.linalg.det(right.T @ left.T))
    rotation = right.T @ np.diag([1.0, 1.0, sign]) @ left.T
    return RigidTransform(rotation, to_centre - rotation @ from_centre)
