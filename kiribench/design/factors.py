"""One input's factor of a product kernel with its first two derivatives, in closed form.

The search asks for them thousands of times at a few points each, where automatic
differentiation costs five to sixty times the arithmetic; the tests hold them against torch's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.likelihood import WARP_DEPTH, KernelForm

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Factor:
    """The correlation of one design input with q nodes.

    Attributes:
        family: a key of :data:`kiribench.surrogate.kernels.FAMILIES`.
        low, span: the input is scaled as ``(100 x - low) / span`` from a fraction x.
        length: length scale of the scaled and warped input.
        warp: extra end slopes, or None.
        nodes: (q,) scaled inputs.
    """

    family: str
    low: float
    span: float
    length: float
    warp: tuple[float, float] | None
    nodes: FloatArray

    @classmethod
    def of(
        cls, form: KernelForm, learnt: Hyperparameters, column: int, nodes: FloatArray
    ) -> Factor:
        """The factor of input ``column`` (0 is a, 1 is b) of a process."""
        return cls(
            form.design_family,
            learnt.input_low[column],
            learnt.input_span[column],
            learnt.length_scales[0 if form.shared_scale else column],
            learnt.warp[column] if form.warped else None,
            nodes,
        )

    def values(self, x: FloatArray) -> FloatArray:
        """(k, q) at k fractions."""
        return correlation_jet(self.family, self._distance(x)[0])[0]

    def jet(self, x: FloatArray) -> FloatArray:
        """(k, 3, q) value, first and second derivative by the fraction."""
        distance, first, second = self._distance(x)
        k, slope, curvature = correlation_jet(self.family, distance)
        by_x = slope * first[:, None]
        twice = curvature * first[:, None] ** 2 + slope * second[:, None]
        return np.stack([k, by_x, twice], axis=1)

    def _distance(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(k, q) signed distances over the length scale, and their derivatives by x, (k,)."""
        scaled = (100.0 * x - self.low) / self.span
        nodes = self.nodes
        first, second = np.ones_like(scaled), np.zeros_like(scaled)
        if self.warp is not None:
            nodes = warp_jet(nodes, self.warp)[0]
            scaled, first, second = warp_jet(scaled, self.warp)
        rate = 100.0 / self.span
        return (
            (scaled[:, None] - nodes[None, :]) / self.length,
            first * (rate / self.length),
            second * (rate * rate / self.length),
        )


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


def correlation_jet(family: str, d: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """One-dimensional correlation of a signed scaled distance, and two derivatives by it.

    Rasmussen & Williams 2006, eq. 4.9 (Gaussian) and 4.16 (Matern 3/2, 5/2, 7/2).
    """
    if family == "gaussian":
        k = np.exp(-0.5 * d * d)
        return k, -d * k, (d * d - 1.0) * k
    root = {"matern32": 3.0, "matern52": 5.0, "matern72": 7.0}[family]
    s = math.sqrt(root) * np.abs(d)
    decay = np.exp(-s)
    if family == "matern32":
        return (1.0 + s) * decay, -3.0 * d * decay, -3.0 * (1.0 - s) * decay
    if family == "matern52":
        return (
            (1.0 + s + s * s / 3.0) * decay,
            -5.0 / 3.0 * d * (1.0 + s) * decay,
            -5.0 / 3.0 * (1.0 + s - s * s) * decay,
        )
    cubic = 1.0 + s + s * s / 3.0
    return (
        (1.0 + s + 0.4 * s * s + s**3 / 15.0) * decay,
        -1.4 * d * cubic * decay,
        -1.4 * (cubic - s * s / 3.0 * (1.0 + s)) * decay,
    )
