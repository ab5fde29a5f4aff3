"""What keeps the cuts of a worn design off their bounds, and their neighbours alike."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: A cut within this share of the range of a bound counts as being at it.
NEAR = 0.01


@dataclass(frozen=True)
class Regularisation:
    """Barrier and smoothness of 2 R C cuts, mm^2.

    Attributes:
        shape: (R, C). low, high: bounds of the cuts. barrier, smoothness: weights, mm^2.
    """

    shape: tuple[int, int]
    low: float
    high: float
    barrier: float
    smoothness: float

    def at_bounds(self, p: FloatArray) -> int:
        """How many cuts (n,) end within :data:`NEAR` of the range of a bound."""
        near = NEAR * (self.high - self.low)
        return int(((p < self.low + near) | (p > self.high - near)).sum())

    def value(self, p: FloatArray) -> float:
        """Of cuts p (2 R C,) strictly within the bounds."""
        width = self.high - self.low
        to_bounds = -np.log((p - self.low) / width) - np.log((self.high - p) / width)
        rough = p @ self._roughness @ p
        return float(self.barrier * to_bounds.mean() + self.smoothness * rough)

    def jet(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (n,) and Hessian (n, n)."""
        count = len(p)
        near, far = 1.0 / (p - self.low), 1.0 / (self.high - p)
        rough = self._roughness
        gradient = self.barrier / count * (far - near) + 2 * self.smoothness * rough @ p
        hessian = np.diag(self.barrier / count * (near**2 + far**2)) + 2 * self.smoothness * rough
        return gradient, hessian

    @cached_property
    def _roughness(self) -> FloatArray:
        """(n, n) matrix of the mean square difference of neighbouring cells, per kind of cut."""
        rows, columns = self.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        pairs = np.concatenate(
            [
                np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2),
                np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2),
            ]
        )
        one = np.zeros((len(pairs), rows * columns))
        one[np.arange(len(pairs)), pairs[:, 0]] = -1.0
        one[np.arange(len(pairs)), pairs[:, 1]] = 1.0
        square = one.T @ one / max(1, 2 * len(pairs))
        return np.asarray(np.kron(np.eye(2), square))
