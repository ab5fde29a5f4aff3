"""Why a cell does not overlap: the mismatch split into parts, each with its own cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.overlap import overlaps, simple
from kiribench.conformability.result import CAUSES, GradeBy
from kiribench.strain.gradient import decompose, triangular

FloatArray = NDArray[np.float64]

#: A cost below this is no cause: half of one percent of a cell, the size of the bias that
#: 0.1 mm of node noise alone produces.
MAIN_FROM = 0.005


@dataclass(frozen=True, eq=False)
class AffineFit:
    """Affine map of the skin cell's corners onto the patch cell's, k = c + shift + A (s - c).

    Attributes:
        centre: (2,) mean of the skin corners; shift: (2,) mean patch minus mean skin.
        matrix: (2, 2) ``A``, least squares over the four corners.
        rotation: radians, longitudinal, lateral, shear: ``A = R [[a, g b], [0, b]]``.
        rest_mm: rms distance of the patch corners from the map.
    """

    centre: FloatArray
    shift: FloatArray
    matrix: FloatArray
    rotation: float
    longitudinal: float
    lateral: float
    shear: float
    rest_mm: float


def fit_affine(skin: FloatArray, patch: FloatArray) -> AffineFit:
    """Fit the affine map from skin corners to patch corners.

    Args:
        skin, patch: (4, 2) corners, mm, in the skin cell's material frame (first axis
            distal, second medial).
    """
    centre = skin.mean(axis=0)
    shift = patch.mean(axis=0) - centre
    s = skin - centre
    k = patch - centre - shift
    matrix = np.linalg.lstsq(s, k, rcond=None)[0].T
    parts = decompose(matrix)
    residual = k - s @ matrix.T
    return AffineFit(
        centre=centre,
        shift=shift,
        matrix=matrix,
        rotation=float(np.arctan2(matrix[1, 0], matrix[0, 0])),
        longitudinal=float(parts.longitudinal_stretch),
        lateral=float(parts.lateral_stretch),
        shear=float(parts.shear),
        rest_mm=float(np.sqrt((residual**2).sum(axis=1).mean())),
    )


def parts_alone(fit: AffineFit, skin: FloatArray, patch: FloatArray) -> FloatArray:
    """The skin outline moved by each part of the mismatch alone.

    Args:
        fit: of the corners.
        skin, patch: (n, 2) outlines with corresponding points.

    Returns:
        (6, n, 2) in the order of ``CAUSES``.
    """
    cos, sin = np.cos(fit.rotation), np.sin(fit.rotation)
    about = skin - fit.centre
    maps = (
        np.array([[cos, -sin], [sin, cos]]),
        triangular(fit.longitudinal, 1.0, 0.0),
        triangular(1.0, fit.lateral, 0.0),
        triangular(1.0, 1.0, fit.shear),
    )
    rest = patch - (fit.centre + fit.shift + about @ fit.matrix.T)
    moved = [skin + fit.shift, *(fit.centre + about @ m.T for m in maps), skin + rest]
    return np.stack(moved)


def costs(fit: AffineFit, skin: FloatArray, patch: FloatArray, definition: GradeBy) -> FloatArray:
    """Overlap that each part alone would cost.

    Args:
        fit, skin, patch: as in :func:`parts_alone`.
        definition: of the overlap.

    Returns:
        (6,) ``1 - overlap`` in the order of ``CAUSES``; 1 where the part alone would
        fold the cell.
    """
    moved = parts_alone(fit, skin, patch)
    fine = simple(moved)
    safe = np.where(fine[:, None, None], moved, skin[None])
    loss = 1.0 - overlaps(np.broadcast_to(skin, moved.shape), safe).by(definition)
    return np.where(fine, np.maximum(loss, 0.0), 1.0)


def main_cause(cost: FloatArray) -> str:
    """The cause of the largest cost, or ``"none"`` when all are below ``MAIN_FROM``."""
    worst = int(np.argmax(cost))
    return CAUSES[worst] if cost[worst] >= MAIN_FROM else "none"
