"""Pictures of a stretched sheet whose motion is known exactly.

A sheet is a set of triangles with material points at rest and their places when stretched.
Every sample of a picture is traced back through the camera to the plane and through its
triangle to the material point, whose paint it sees; where there is no triangle, as in an open
cut, it sees the background. So the pictures hold the motion without any interpolation of
pictures, and what is measured in them can be held against the nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.synthetic.tensile_camera import Camera
from kiribench.synthetic.tensile_pattern import Pattern

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
UInt8Array = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class SheetMotion:
    """A sheet at rest and stretched.

    Attributes:
        material_mm: (n, 2) nodes at rest, x across the pull, y along it, mm.
        place_mm: (n, 2) where they are now, mm.
        triangles: (m, 3) node numbers; the map is affine in each triangle.
    """

    material_mm: FloatArray
    place_mm: FloatArray
    triangles: IntArray

    @classmethod
    def of_map(
        cls,
        mapping: Callable[[FloatArray], FloatArray],
        low_mm: tuple[float, float],
        high_mm: tuple[float, float],
        step_mm: float,
    ) -> SheetMotion:
        """An uncut rectangle under a map of (n, 2) mm, affine in triangles of ``step_mm``."""
        x = np.linspace(low_mm[0], high_mm[0], max(2, round((high_mm[0] - low_mm[0]) / step_mm)))
        y = np.linspace(low_mm[1], high_mm[1], max(2, round((high_mm[1] - low_mm[1]) / step_mm)))
        across, along = np.meshgrid(x, y)
        nodes = np.column_stack([across.ravel(), along.ravel()])
        number = np.arange(len(nodes)).reshape(across.shape)
        one = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:]], axis=-1)
        two = np.stack([number[:-1, :-1], number[1:, 1:], number[1:, :-1]], axis=-1)
        triangles = np.concatenate([one.reshape(-1, 3), two.reshape(-1, 3)])
        return cls(nodes, mapping(nodes), triangles.astype(np.int64))

    def follow(self, material_mm: FloatArray) -> FloatArray:
        """(k, 2) mm, where material points (k, 2) mm are now.

        Raises:
            ValueError: a point is not on the sheet.
        """
        corner = self.material_mm[self.triangles]
        found = np.empty_like(material_mm)
        for index, point in enumerate(material_mm):
            weights = _weights(corner, point)
            best = int(np.argmax(weights.min(axis=1)))
            if weights[best].min() < -1e-9:
                raise ValueError(f"the point {point} is not on the sheet")
            found[index] = weights[best] @ self.place_mm[self.triangles[best]]
        return found


@dataclass(frozen=True)
class Look:
    """Light, lens and sensor.

    Attributes:
        blur_px: sd of the Gaussian blur.
        noise: sd of the sensor's noise, in grey levels of 255.
        slope: relative change of the light across the picture, in x and y.
        vignette: relative loss of light in the corners.
        background: brightness behind the sheet.
        samples: of every pixel in each direction.
        exposure: factor on the brightness; above about 1.2 the bright paint is cut off.
    """

    blur_px: float = 0.7
    noise: float = 1.5
    slope: tuple[float, float] = (0.0, 0.0)
    vignette: float = 0.0
    background: float = 0.03
    samples: int = 2
    exposure: float = 1.0


def render(
    camera: Camera, motion: SheetMotion, pattern: Pattern, look: Look, *, seed: int
) -> UInt8Array:
    """One picture, (height, width) grey levels.

    Args:
        camera: where from. motion: of the sheet. pattern: its paint. look: light and sensor.
        seed: of the sensor's noise.
    """
    from scipy.ndimage import gaussian_filter

    fine = look.samples
    height, width = camera.height_px * fine, camera.width_px * fine
    x = (np.arange(width) + 0.5) / fine - 0.5
    y = (np.arange(height) + 0.5) / fine - 0.5
    sample_px = np.column_stack([np.tile(x, height), np.repeat(y, width)])
    plane = camera.plane(sample_px).reshape(height, width, 2)
    nodes_px = (camera.project(motion.place_mm) + 0.5) * fine - 0.5
    owner = np.full((height, width), -1, dtype=np.int64)
    _paint(nodes_px, motion.place_mm, motion.triangles, plane, owner)
    seen = owner >= 0
    on_sheet = _material(
        plane[seen], owner[seen], motion.triangles, motion.place_mm, motion.material_mm
    )
    bright = np.full((height, width), look.background)
    bright[seen] = pattern.shade(on_sheet)
    light = bright.reshape(camera.height_px, fine, camera.width_px, fine).mean(axis=(1, 3))
    if look.blur_px > 0:
        light = gaussian_filter(light, look.blur_px, mode="nearest")
    u = np.linspace(-0.5, 0.5, camera.width_px)[None, :]
    v = np.linspace(-0.5, 0.5, camera.height_px)[:, None]
    gain = 1 + look.slope[0] * u + look.slope[1] * v - look.vignette * 2 * (u * u + v * v)
    levels = 255 * look.exposure * gain * light
    levels += look.noise * np.random.default_rng(seed).standard_normal(levels.shape)
    return np.asarray(np.clip(np.round(levels), 0, 255), dtype=np.uint8)


def _weights(corner: FloatArray, point: FloatArray) -> FloatArray:
    """(m, 3) barycentric weights of a point (2,) in triangles (m, 3, 2)."""
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    away = point - corner[:, 0]
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    u = (away[:, 0] * two[:, 1] - away[:, 1] * two[:, 0]) / area
    v = (one[:, 0] * away[:, 1] - one[:, 1] * away[:, 0]) / area
    return np.stack([1 - u - v, u, v], axis=1)


@njit(cache=True)
def _paint(
    nodes_px: FloatArray,
    place: FloatArray,
    triangles: IntArray,
    plane: FloatArray,
    owner: IntArray,
) -> None:
    """Write into (h, w) which triangle every sample sees; samples lie in the plane at ``plane``."""
    height, width = owner.shape
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        low_x = min(nodes_px[a, 0], nodes_px[b, 0], nodes_px[c, 0]) - 1.0
        high_x = max(nodes_px[a, 0], nodes_px[b, 0], nodes_px[c, 0]) + 1.0
        low_y = min(nodes_px[a, 1], nodes_px[b, 1], nodes_px[c, 1]) - 1.0
        high_y = max(nodes_px[a, 1], nodes_px[b, 1], nodes_px[c, 1]) + 1.0
        if high_x < 0 or high_y < 0 or low_x > width or low_y > height:
            continue
        ax, ay = place[a]
        ux, uy = place[b, 0] - ax, place[b, 1] - ay
        vx, vy = place[c, 0] - ax, place[c, 1] - ay
        area = ux * vy - uy * vx
        if area == 0.0:
            continue
        for i in range(max(0, int(low_y)), min(height, int(high_y) + 2)):
            for j in range(max(0, int(low_x)), min(width, int(high_x) + 2)):
                dx, dy = plane[i, j, 0] - ax, plane[i, j, 1] - ay
                u = (dx * vy - dy * vx) / area
                v = (ux * dy - uy * dx) / area
                if u >= -1e-9 and v >= -1e-9 and u + v <= 1 + 1e-9:
                    owner[i, j] = t


@njit(cache=True)
def _material(
    plane: FloatArray,
    owner: IntArray,
    triangles: IntArray,
    place: FloatArray,
    material: FloatArray,
) -> FloatArray:
    """(k, 2) material points of samples at ``plane`` (k, 2) in their triangles."""
    found = np.empty((len(owner), 2))
    for k in range(len(owner)):
        a, b, c = triangles[owner[k]]
        ux, uy = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
        vx, vy = place[c, 0] - place[a, 0], place[c, 1] - place[a, 1]
        area = ux * vy - uy * vx
        dx, dy = plane[k, 0] - place[a, 0], plane[k, 1] - place[a, 1]
        u = (dx * vy - dy * vx) / area
        v = (ux * dy - uy * dx) / area
        for d in range(2):
            found[k, d] = (1 - u - v) * material[a, d] + u * material[b, d] + v * material[c, d]
    return found
