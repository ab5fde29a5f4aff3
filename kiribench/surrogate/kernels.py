"""Correlation functions of the Gaussian processes, on torch in float64.

All are products over the inputs, so that a kernel over (a, b, strain) is the Kronecker
product of one over designs and one over strains wherever the rows are a grid.
Signal variance and noise are not part of a correlation.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import torch

Correlation = Callable[[torch.Tensor], torch.Tensor]


def _gaussian(distance: torch.Tensor) -> torch.Tensor:
    # exp(-r^2 / 2): the paper's eq. 3 without its sigma.
    return torch.exp(-0.5 * distance.square())


def _matern32(distance: torch.Tensor) -> torch.Tensor:
    # Rasmussen & Williams 2006, eq. 4.17, nu = 3/2.
    scaled = math.sqrt(3.0) * distance
    return (1.0 + scaled) * torch.exp(-scaled)


def _matern52(distance: torch.Tensor) -> torch.Tensor:
    # Rasmussen & Williams 2006, eq. 4.17, nu = 5/2.
    scaled = math.sqrt(5.0) * distance
    return (1.0 + scaled + scaled.square() / 3.0) * torch.exp(-scaled)


def _matern72(distance: torch.Tensor) -> torch.Tensor:
    # Rasmussen & Williams 2006, eq. 4.16 with p = 3.
    scaled = math.sqrt(7.0) * distance
    return (1.0 + scaled + 0.4 * scaled.square() + scaled**3 / 15.0) * torch.exp(-scaled)


FAMILIES: dict[str, Correlation] = {
    "gaussian": _gaussian,
    "matern72": _matern72,
    "matern52": _matern52,
    "matern32": _matern32,
}


def correlation(
    family: str, left: torch.Tensor, right: torch.Tensor, length_scales: torch.Tensor
) -> torch.Tensor:
    """The correlation matrix of two sets of points.

    Args:
        family: a key of :data:`FAMILIES`.
        left: (p, d) points, inputs in the units of ``length_scales``.
        right: (q, d) points.
        length_scales: (d,) positive, or (1,) for one scale over all inputs.

    Returns:
        (p, q), the product over the d inputs of the family's one-dimensional correlation.
    """
    one_dimensional = FAMILIES[family]
    scales = length_scales.expand(left.shape[1])
    if family == "gaussian":
        # The product of Gaussians is one Gaussian of the summed squares: one exponential.
        return torch.exp(-0.5 * _squared_distances(left / scales, right / scales))
    result = torch.ones((left.shape[0], right.shape[0]), dtype=left.dtype, device=left.device)
    for column in range(left.shape[1]):
        gap = (left[:, None, column] - right[None, :, column]).abs() / scales[column]
        result = result * one_dimensional(gap)
    return result


def _squared_distances(left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
    # Summed differences, not the expanded square: no cancellation for close points.
    total = torch.zeros((left.shape[0], right.shape[0]), dtype=left.dtype, device=left.device)
    for column in range(left.shape[1]):
        total = total + (left[:, None, column] - right[None, :, column]).square()
    return total
