"""The worn patch on the skin, and the motion between two scans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.mismatch import Mismatch

RIM_MM = 5.0
"""The patch's sheet reaches this far beyond its outer cells."""

FLANK_MM = 3.0
"""Width over which the scanned surface falls from the patch to the skin."""

MOTION_DEG = 8.0
MOTION_MM = 20.0


@dataclass(frozen=True, eq=False)
class PatchRelief:
    """The patch over the skin's material points.

    Attributes:
        mismatch: where it lies.
        centre: (2,) material coordinates of the skin point under a perfect patch's centre.
        half_mm: (2,) half sizes of its cells together, as cut.
        thickness_mm: height of its top over the skin, along the skin's normal.
    """

    mismatch: Mismatch
    centre: FloatArray
    half_mm: FloatArray
    thickness_mm: float

    @classmethod
    def of(cls, mismatch: Mismatch, under: FloatArray, thickness_mm: float) -> PatchRelief:
        """The patch whose cell corners should lie on the skin nodes under (R+1, C+1, 2)."""
        first, last = under[0, 0], under[-1, -1]
        return cls(mismatch, 0.5 * (first + last), 0.5 * (last - first), thickness_mm)

    def on_skin(self, q: FloatArray) -> FloatArray:
        """(..., 2) material points where the patch's points for q (..., 2) really lie."""
        return self.centre + self.mismatch.on_skin(q - self.centre)

    def patch_point(self, q: FloatArray) -> FloatArray:
        """(..., 2) patch coordinates, mm from its centre as cut, above q (..., 2)."""
        return self.mismatch.patch_point(q - self.centre)

    def outside_mm(self, p: FloatArray) -> FloatArray:
        """(...) distance of the patch points p (..., 2) outside the sheet's edge; 0 within."""
        beyond = np.maximum(np.abs(p) - self.half_mm - RIM_MM, 0.0)
        return np.asarray(np.linalg.norm(beyond, axis=-1))

    def height_mm(self, q: FloatArray) -> FloatArray:
        """(...) height of the scanned surface over the skin at q (..., 2), along its normal."""
        t = np.clip(1.0 - self.outside_mm(self.patch_point(q)) / FLANK_MM, 0.0, 1.0)
        return np.asarray(self.thickness_mm * t * t * (3.0 - 2.0 * t))


@dataclass(frozen=True, eq=False)
class Motion:
    """A rigid motion x -> rotation x + translation.

    Attributes:
        rotation: (3, 3).
        translation_mm: (3,).
    """

    rotation: FloatArray
    translation_mm: FloatArray

    def apply(self, xyz_mm: FloatArray) -> FloatArray:
        """(..., 3) the moved points."""
        return np.asarray(xyz_mm @ self.rotation.T + self.translation_mm)


def random_motion(rng: np.random.Generator) -> Motion:
    """A rotation of 8 degrees about a random axis, then a shift of 20 mm in a random direction."""
    axis, direction = rng.standard_normal((2, 3))
    x, y, z = axis / np.linalg.norm(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.radians(MOTION_DEG)
    rotation = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return Motion(rotation, MOTION_MM * direction / np.linalg.norm(direction))
