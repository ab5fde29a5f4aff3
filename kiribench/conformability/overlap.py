"""Areal overlap of flat outlines, by three definitions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from kiribench.conformability.result import GradeBy

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Areas of cells and of their intersections, mm^2, all (...).

    Attributes:
        skin: area of S; patch: area of K; both: area of the intersection.
    """

    skin: FloatArray
    patch: FloatArray
    both: FloatArray

    @property
    def paper(self) -> FloatArray:
        """Covered fraction of the skin cell; an oversized patch cell is not penalised."""
        return self.both / self.skin

    @property
    def strict(self) -> FloatArray:
        """Intersection over the larger of the two cells."""
        return self.both / np.maximum(self.skin, self.patch)

    @property
    def iou(self) -> FloatArray:
        """Intersection over union."""
        return self.both / (self.skin + self.patch - self.both)

    def by(self, definition: GradeBy) -> FloatArray:
        """The overlap by a named definition."""
        if definition == "paper":
            return self.paper
        if definition == "strict":
            return self.strict
        return self.iou


def overlaps(skin: FloatArray, patch: FloatArray) -> Overlaps:
    """Intersect outlines pair by pair.

    Args:
        skin, patch: (..., n, 2) and (..., m, 2) outlines, mm, in one flat frame, first
            point not repeated; must be simple (see :func:`simple`).
    """
    s = shapely.polygons(skin)
    k = shapely.polygons(patch)
    return Overlaps(
        skin=np.asarray(shapely.area(s)),
        patch=np.asarray(shapely.area(k)),
        both=np.asarray(shapely.area(shapely.intersection(s, k))),
    )


def simple(outline: FloatArray) -> NDArray[np.bool_]:
    """Whether outlines have an area and do not cross themselves.

    Args:
        outline: (..., n, 2); not finite counts as not simple.
    """
    finite = np.asarray(np.isfinite(outline).all(axis=(-1, -2)))
    safe = np.where(finite[..., None, None], outline, 0.0)
    polygons = shapely.polygons(safe)
    valid = np.asarray(shapely.is_valid(polygons)) & (np.asarray(shapely.area(polygons)) > 0.0)
    return np.asarray(finite & valid)
