"""The coordinates of a surrogate's design kernel, with two derivatives.

Closed forms: the search asks for them thousands of times at a few points each, where automatic
differentiation costs five to sixty times the arithmetic. The tests hold them against torch's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.kernel_form import WARP_DEPTH

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The map from cut lengths to the coordinates in which the kernel is stationary.

    Attributes:
        low, span: (2,) an input is scaled as ``(100 x - low) / span`` from a fraction x.
        warp: end slopes of a and of b, or None.
        corner: of the angle, or None where the kernel has none.
        lengths: (2,) or (3,) length scales.
    """

    low: FloatArray
    span: FloatArray
    warp: tuple[tuple[float, float], ...] | None
    corner: tuple[float, float] | None
    lengths: FloatArray

    @classmethod
    def of(cls, learnt: Hyperparameters) -> Coordinates:
        """The coordinates of a process over a, b (percent) and strain."""
        cornered = len(learnt.corner) == 2
        scales = learnt.length_scales
        lengths = np.array(scales[:-1] if len(scales) > 1 else scales * (2 + cornered))
        return cls(
            np.array(learnt.input_low[:2]),
            np.array(learnt.input_span[:2]),
            learnt.warp or None,
            (learnt.corner[0], learnt.corner[1]) if cornered else None,
            lengths,
        )

    def scaled(self, x: FloatArray) -> FloatArray:
        """(k, 2) fractions in the surrogate's units."""
        return np.asarray((100.0 * x - self.low) / self.span)

    def jet(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates over their length scales at (k, 2) scaled points, by fractions a and b.

        Returns:
            (k, C) coordinates, (k, C, 2) first and (k, C, 2, 2) second derivatives.
        """
        count = len(self.lengths)
        value = np.empty((len(scaled), count))
        first = np.zeros((len(scaled), count, 2))
        second = np.zeros((len(scaled), count, 2, 2))
        for j in range(2):
            if self.warp is None:
                value[:, j], first[:, j, j] = scaled[:, j], 1.0
            else:
                value[:, j], first[:, j, j], second[:, j, j, j] = warp_jet(
                    scaled[:, j], self.warp[j]
                )
        if self.corner is not None:
            u, v = scaled[:, 0] + self.corner[0], 1.0 - scaled[:, 1] + self.corner[1]
            square = u * u + v * v
            value[:, 2] = np.arctan2(u, v)
            first[:, 2, 0], first[:, 2, 1] = v / square, u / square
            twist = 2.0 * u * v / square**2
            second[:, 2, 0, 0], second[:, 2, 1, 1] = -twist, twist
            second[:, 2, 0, 1] = second[:, 2, 1, 0] = (v * v - u * u) / square**2
            for array in (value, first, second):
                array[:, 2] /= 0.5 * math.pi
        rate = 100.0 / self.span
        value /= self.lengths
        first *= rate / self.lengths[:, None]
        second *= rate[:, None] * rate / self.lengths[:, None, None]
        return value, first, second


def warp_jet(
    x: FloatArray, steepness: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The surrogate's input warp with two derivatives: steeper to both ends, straight beyond."""
    low, high = steepness
    inside = np.clip(x, 0.0, 1.0)
    end = math.exp(-1.0 / WARP_DEPTH)
    at_low, at_high = np.exp(-inside / WARP_DEPTH), np.exp((inside - 1.0) / WARP_DEPTH)
    rise, fall = 1.0 - at_low, at_high - end
    slope = 1.0 + low * at_low + high * at_high
    norm = 1.0 + WARP_DEPTH * (low + high) * (1.0 - end)
    value = inside + WARP_DEPTH * (low * rise + high * fall) + (x - inside) * slope
    curvature = np.where(x == inside, (high * at_high - low * at_low) / WARP_DEPTH, 0.0)
    return value / norm, slope / norm, curvature / norm
