"""The camera that looks at a synthetic sheet: a pinhole with tilt and radial distortion.

Written apart from :mod:`kiribench.tensile`, which has to undo what is done here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A camera over a flat sheet; picture x is across the sheet, y (downwards) along it.

    Attributes:
        width_px, height_px: size of the pictures.
        px_per_mm: at the point in the middle of the picture.
        centre_mm: (x, y) of that point on the sheet's plane, mm.
        focal_px: focal length; long lenses see little perspective.
        tilt_deg: turn of the plane about the picture's x and y axes.
        roll_deg: turn of the camera about its axis.
        k1, k2: radial distortion (Brown): r (1 + k1 r^2 + k2 r^4), r in focal lengths.
    """

    width_px: int
    height_px: int
    px_per_mm: float
    centre_mm: tuple[float, float] = (0.0, 0.0)
    focal_px: float = 4000.0
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    roll_deg: float = 0.0
    k1: float = 0.0
    k2: float = 0.0

    @property
    def principal_px(self) -> FloatArray:
        """(2,) the middle of the picture; the centre of the first pixel is (0, 0)."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    def project(self, points_mm: FloatArray) -> FloatArray:
        """(n, 2) px of points (n, 2) mm of the sheet's plane."""
        pose = self._pose()
        ray = np.column_stack([points_mm, np.ones(len(points_mm))]) @ pose.T
        flat = ray[:, :2] / ray[:, 2:]
        square = np.sum(flat * flat, axis=1, keepdims=True)
        bent = flat * (1 + self.k1 * square + self.k2 * square * square)
        return np.asarray(self.focal_px * bent + self.principal_px)

    def plane(self, points_px: FloatArray) -> FloatArray:
        """(n, 2) mm on the sheet's plane that are seen at (n, 2) px; inverse of `project`."""
        bent = (points_px - self.principal_px) / self.focal_px
        length = np.sqrt(np.sum(bent * bent, axis=1))
        radius = length.copy()
        # Newton on r (1 + k1 r^2 + k2 r^4) = length.
        for _ in range(20 if self.k1 or self.k2 else 0):
            square = radius * radius
            value = radius * (1 + self.k1 * square + self.k2 * square * square) - length
            slope = 1 + 3 * self.k1 * square + 5 * self.k2 * square * square
            radius = radius - value / slope
        with np.errstate(invalid="ignore", divide="ignore"):
            flat = bent * np.where(length > 0, radius / length, 1.0)[:, None]
        back = np.column_stack([flat, np.ones(len(flat))]) @ np.linalg.inv(self._pose()).T
        return np.asarray(back[:, :2] / back[:, 2:])

    def _pose(self) -> FloatArray:
        """(3, 3) from (x mm, y mm, 1) on the plane to the ray in camera coordinates."""
        about_x, about_y = np.radians(self.tilt_deg)
        roll = np.radians(self.roll_deg)
        cx, sx, cy, sy = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
        turn_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        turn_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        turn_z = np.array(
            [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
        )
        turn = turn_z @ turn_y @ turn_x
        distance = self.focal_px / self.px_per_mm
        origin = -turn[:, :2] @ np.asarray(self.centre_mm) + np.array([0, 0, distance])
        return np.column_stack([turn[:, 0], turn[:, 1], origin])
