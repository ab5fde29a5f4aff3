"""Registration, the uncertainty: residuals that are correlated within blocks, a smooth bias."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.surface.mesh import FloatArray
from kiribench.surface.register_descent import FREE

_BLOCK_MM = 10.0  # residuals within a block may be correlated


def _blocks(position: FloatArray) -> NDArray[np.int64]:
    """(k,) number of the 10 mm block that each point lies in."""
    block = np.floor(position / _BLOCK_MM).astype(np.int64)
    return np.unique(block, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def block_rms(residual: FloatArray, position: FloatArray) -> float:
    """Rms of the mean residuals (mm) of 10 mm blocks: what is left when noise averages out.

    Args:
        residual: (k,) mm. position: (k, 3) mm, where each lies.
    """
    label = _blocks(position)
    points = np.bincount(label)
    mean = np.bincount(label, weights=residual) / points
    return float(np.sqrt(np.average(mean**2, weights=points)))


def covariance_of(
    rows: FloatArray,
    residual: FloatArray,
    position: FloatArray,
    reach: float,
    systematic_mm: float,
) -> FloatArray:
    """Sandwich covariance in (radians, mm), with 10 mm blocks as clusters (Liang and Zeger 1986,
    doi 10.1093/biomet/73.1.13), and what a smooth error of the shape adds.
    """
    normal = rows.T @ rows
    values, vectors = np.linalg.eigh(normal)
    inverse = (vectors / np.maximum(values, FREE * values[-1])) @ vectors.T
    label = _blocks(position)
    blocks = int(label.max()) + 1
    score = np.zeros((blocks, 6))
    np.add.at(score, label, rows * residual[:, None])
    freedom = blocks / max(blocks - 6, 1)
    # Few blocks make the sandwich too small by chance: never below independence.
    robust = inverse @ (freedom * score.T @ score) @ inverse
    plain = inverse * float(residual @ residual) / max(len(residual) - 6, 1)
    scale = np.diag([1.0 / reach] * 3 + [1.0] * 3)
    larger = robust if np.trace(robust) > np.trace(plain) else plain
    # A smooth error field e moves the solution by inverse rows' e; here it is taken to lie in
    # the span of the six columns, in no preferred direction.
    smooth = systematic_mm**2 * len(rows) / 6.0 * inverse
    covariance = scale @ (larger + smooth) @ scale
    return np.asarray(0.5 * (covariance + covariance.T))
