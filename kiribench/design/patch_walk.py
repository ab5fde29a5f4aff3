"""Walks on the bicubic patches of one cell: down to a minimum, along a level, to the origin."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.design.box_newton import CONVERGED, NOTICED, SMALL_STEP, box_step
from kiribench.design.level import level_step
from kiribench.design.patchwork import patch_jet

FloatArray = NDArray[np.float64]

_ITERATIONS = 40
_SETTLED = 1e-6  # of the cell edge: a step that ends a walk
_LONGEST_STEP = 0.05


@njit(cache=True, error_model="numpy")
def descend(
    nodes: FloatArray, step: float, sign: float, x: float, y: float
) -> tuple[float, float, float]:
    """A local minimum of ``sign * response`` on the patches, and its value; projected Newton."""
    high = step * (nodes.shape[0] - 1)
    radius = _LONGEST_STEP
    f, gx, gy, hxx, hxy, hyy = patch_jet(nodes, step, x, y)
    for _ in range(_ITERATIONS):
        dx, dy, pull = box_step(
            x, y, sign * gx, sign * gy, sign * hxx, sign * hxy, sign * hyy, high
        )
        length = math.hypot(dx, dy)
        if pull <= CONVERGED or pull * length <= NOTICED:
            break
        share = min(1.0, radius / length)
        p = min(max(x + share * dx, 0.0), high)
        q = min(max(y + share * dy, 0.0), high)
        new = patch_jet(nodes, step, p, q)
        if sign * new[0] < sign * f:
            x, y = p, q
            f, gx, gy, hxx, hxy, hyy = new
            radius = min(2.0 * radius, _LONGEST_STEP)
            if length <= SMALL_STEP:
                break
        else:
            radius /= 4.0
            if radius <= SMALL_STEP:
                break
    return x, y, sign * f


@njit(cache=True, error_model="numpy")
def walk(
    nodes: FloatArray, step: float, level: float, x: float, y: float
) -> tuple[float, float, float]:
    """The nearest point of a level curve on the patches, and by how much it misses the level."""
    high = step * (nodes.shape[0] - 1)
    for _ in range(_ITERATIONS):
        f, gx, gy, hxx, hxy, hyy = patch_jet(nodes, step, x, y)
        x, y, moved = level_step(x, y, f - level, gx, gy, hxx, hxy, hyy, high)
        if moved <= _SETTLED:
            break
    return x, y, abs(patch_jet(nodes, step, x, y)[0] - level)


@njit(cache=True, error_model="numpy")
def towards_origin(
    nodes: FloatArray, step: float, level: float, side: float, x: float, y: float
) -> tuple[float, float]:
    """From a point beyond its level straight towards the origin, to just before the level."""
    far = math.hypot(x, y)
    inside, outside = 1.0, 0.0
    share = 1.0
    while share > 0.0:  # to the first crossing: no farther than an island is wide
        share -= 0.1 * step / far
        if side * (patch_jet(nodes, step, share * x, share * y)[0] - level) < 0.0:
            outside = share
            break
        inside = share
    for _ in range(30):
        middle = 0.5 * (inside + outside)
        if side * (patch_jet(nodes, step, middle * x, middle * y)[0] - level) < 0.0:
            outside = middle
        else:
            inside = middle
    return inside * x, inside * y
