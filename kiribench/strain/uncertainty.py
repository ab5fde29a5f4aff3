"""From the uncertainty of the nodes to that of stretch, shear and Poisson's ratio.

A node's place is uncertain by ``sd_mm`` in each of the two tangent directions,
independently of all other nodes and of the other pose. Everything here is first order in
that uncertainty; the tests compare it with Monte Carlo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.strain.gradient import decompose, gradient_of

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: 97.5 % point of the standard normal.
Z95 = 1.959963984540054
#: Step of the central differences, mm: the error is of the order of its square over
#: the cell size squared (1e-10), far below what first order in the node sd can mean.
STEP_MM = 1e-4


def cell_quantities(reference: FloatArray, deformed: FloatArray) -> FloatArray:
    """Longitudinal stretch, lateral stretch and shear of straight-sided flat cells.

    Args:
        reference, deformed: (..., 4, 2) corners, mm.

    Returns:
        (..., 3): the two stretches as means of opposite sides' length ratios, the shear
        from the gradient.
    """

    def side(corners: FloatArray, start: int, end: int) -> FloatArray:
        return np.asarray(np.linalg.norm(corners[..., end, :] - corners[..., start, :], axis=-1))

    def ratio(start: int, end: int) -> FloatArray:
        return side(deformed, start, end) / side(reference, start, end)

    along = 0.5 * (ratio(0, 3) + ratio(1, 2))
    across = 0.5 * (ratio(0, 1) + ratio(3, 2))
    shear = decompose(gradient_of(reference, deformed)).shear
    return np.stack([along, across, shear], axis=-1)


def jacobian(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    reference: FloatArray,
    deformed: FloatArray,
) -> FloatArray:
    """Derivatives of a cell function by central differences.

    Args:
        function: (reference, deformed) -> (..., q).
        reference, deformed: (..., 4, 2) corners, mm.

    Returns:
        (..., q, 2, 4, 2): pose, corner, coordinate.
    """
    columns = []
    for pose in range(2):
        for corner in range(4):
            for axis in range(2):
                step = np.zeros((4, 2))
                step[corner, axis] = STEP_MM
                if pose == 0:
                    up = function(reference + step, deformed)
                    down = function(reference - step, deformed)
                else:
                    up = function(reference, deformed + step)
                    down = function(reference, deformed - step)
                columns.append((up - down) / (2.0 * STEP_MM))
    stacked = np.stack(columns, axis=-1)
    return stacked.reshape(*stacked.shape[:-1], 2, 4, 2)


def propagate(
    reference: FloatArray, deformed: FloatArray, sd_reference: FloatArray, sd_deformed: FloatArray
) -> FloatArray:
    """Covariance of (longitudinal stretch, lateral stretch, shear) of every cell.

    Args:
        reference, deformed: (..., 4, 2) flattened corners, mm.
        sd_reference, sd_deformed: (..., 4) node sd per tangent direction, mm.

    Returns:
        (..., 3, 3).
    """
    slope = jacobian(cell_quantities, reference, deformed)
    sd = np.stack([sd_reference, sd_deformed], axis=-2)
    scaled = slope * sd[..., None, :, :, None]
    flat = scaled.reshape(*scaled.shape[:-3], 16)
    return np.asarray(np.einsum("...qk,...pk->...qp", flat, flat))


@dataclass(frozen=True, eq=False)
class RatioInterval:
    """Fieller's interval of a ratio; ``bounded`` is False where it is not finite."""

    value: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray
    bounded: BoolArray


def fieller(
    numerator: FloatArray,
    denominator: FloatArray,
    var_numerator: FloatArray,
    var_denominator: FloatArray,
    covariance: FloatArray,
    *,
    z: float = Z95,
) -> RatioInterval:
    """Fieller's confidence interval of ``numerator / denominator``.

    The set of ratios r for which ``numerator - r denominator`` is within ``z`` of its
    sd from zero. Finite only where the denominator itself is significantly different
    from zero (Fieller 1954, doi 10.1111/j.2517-6161.1954.tb00159.x).

    Args:
        numerator, denominator, var_numerator, var_denominator, covariance: same shape.
        z: normal quantile.
    """
    a = denominator**2 - z * z * var_denominator
    b = numerator * denominator - z * z * covariance
    c = numerator**2 - z * z * var_numerator
    bounded = np.asarray(a > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = numerator / denominator
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        low = np.where(bounded, (b - root) / a, np.nan)
        high = np.where(bounded, (b + root) / a, np.nan)
        variance = (
            var_numerator - 2.0 * value * covariance + value**2 * var_denominator
        ) / denominator**2
    return RatioInterval(value, np.sqrt(np.maximum(variance, 0.0)), low, high, bounded)
