"""What is painted on a synthetic sheet: brightness as a function of the material point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Pattern(Protocol):
    """Brightness of the paint at material points."""

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness from 0 (black) to 1 (white) at (n, 2) mm of the sheet at rest."""


@dataclass(frozen=True, eq=False)
class Speckle:
    """Random speckle: a texture over a rectangle, read bilinearly (so it is exact everywhere).

    Attributes:
        texture: (h, w) brightness.
        origin_mm: (x, y) of the texture's first texel.
        texel_mm: distance of texels.
    """

    texture: FloatArray
    origin_mm: tuple[float, float]
    texel_mm: float

    @classmethod
    def over(
        cls,
        low_mm: tuple[float, float],
        high_mm: tuple[float, float],
        *,
        grain_mm: float,
        seed: int,
        dark: float = 0.12,
        bright: float = 0.85,
    ) -> Speckle:
        """Speckle with grains of about ``grain_mm`` over a rectangle."""
        from scipy.ndimage import gaussian_filter

        texel = grain_mm / 8
        size = [int(np.ceil((high_mm[axis] - low_mm[axis]) / texel)) + 2 for axis in (1, 0)]
        rough = np.random.default_rng(seed).standard_normal(size)
        smooth = gaussian_filter(rough, 8 / 2.5, mode="wrap")
        smooth /= smooth.std()
        sharp = 1 / (1 + np.exp(-4.0 * (smooth - 0.1)))
        return cls(dark + (bright - dark) * sharp, low_mm, texel)

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness; points outside have that of the rim."""
        rows, columns = self.texture.shape
        x = np.clip((material_mm[:, 0] - self.origin_mm[0]) / self.texel_mm, 0, columns - 1.001)
        y = np.clip((material_mm[:, 1] - self.origin_mm[1]) / self.texel_mm, 0, rows - 1.001)
        j, i = x.astype(np.int64), y.astype(np.int64)
        u, v = x - j, y - i
        t = self.texture
        return np.asarray(
            (1 - v) * ((1 - u) * t[i, j] + u * t[i, j + 1])
            + v * ((1 - u) * t[i + 1, j] + u * t[i + 1, j + 1])
        )


@dataclass(frozen=True, eq=False)
class Dots:
    """Round dark dots on a bright ground, with edges softened over ``soft_mm``.

    Attributes:
        centre_mm: (k, 2) mm.
        radius_mm: of every dot.
    """

    centre_mm: FloatArray
    radius_mm: float
    soft_mm: float = 0.2
    dark: float = 0.1
    bright: float = 0.8

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness."""
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(self.centre_mm).query(material_mm)
        inside = np.clip(0.5 - (distance - self.radius_mm) / self.soft_mm, 0, 1)
        return np.asarray(self.bright - (self.bright - self.dark) * inside)


@dataclass(frozen=True, eq=False)
class DrawnGrid:
    """Straight dark lines, ``pitch_mm`` apart in both directions, through ``origin_mm``."""

    pitch_mm: float
    line_mm: float
    origin_mm: tuple[float, float] = (0.0, 0.0)
    soft_mm: float = 0.2
    dark: float = 0.1
    bright: float = 0.8

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness."""
        offset = material_mm - np.asarray(self.origin_mm)
        away = np.abs(offset - self.pitch_mm * np.round(offset / self.pitch_mm))
        nearest = away.min(axis=1)
        inside = np.clip(0.5 - (nearest - self.line_mm / 2) / self.soft_mm, 0, 1)
        return np.asarray(self.bright - (self.bright - self.dark) * inside)


@dataclass(frozen=True, eq=False)
class Kerfs:
    """Another pattern with the cuts of a sheet as dark hairlines.

    Attributes:
        under: the pattern of the sheet's face.
        start_mm, end_mm: (k, 2) the cuts.
        width_mm: of a closed cut as it is seen.
    """

    under: Pattern
    start_mm: FloatArray
    end_mm: FloatArray
    width_mm: float
    dark: float = 0.05

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness."""
        nearest = np.full(len(material_mm), np.inf)
        for start, end in zip(self.start_mm, self.end_mm, strict=True):
            low = np.minimum(start, end) - self.width_mm
            high = np.maximum(start, end) + self.width_mm
            near = np.flatnonzero(np.all((material_mm > low) & (material_mm < high), axis=1))
            if not len(near):
                continue
            along = end - start
            t = np.clip((material_mm[near] - start) @ along / (along @ along), 0, 1)
            away = np.linalg.norm(material_mm[near] - start - t[:, None] * along, axis=1)
            nearest[near] = np.minimum(nearest[near], away)
        inside = np.clip(0.5 - (nearest - self.width_mm / 2) / (0.3 * self.width_mm), 0, 1)
        ground = self.under.shade(material_mm)
        return np.asarray(ground + (self.dark - ground) * inside)


@dataclass(frozen=True)
class Plain:
    """One brightness everywhere."""

    brightness: float = 0.75

    def shade(self, material_mm: FloatArray) -> FloatArray:
        """(n,) brightness."""
        return np.full(len(material_mm), self.brightness)
