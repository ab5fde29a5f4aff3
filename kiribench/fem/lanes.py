"""The neo-Hookean law for many facets at once.

Arrays hold one value of ``LANES`` facets side by side in their last axis; the loops over it become
vector instructions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

LANES = 16
"""Facets in one batch: two vector registers of eight doubles."""


@njit(cache=True, error_model="numpy")
def neo_hookean_lanes(f: FloatArray, mu: float, out: FloatArray, inv: FloatArray) -> None:
    """``material.response`` for neo-Hookean, lane by lane: f (4, L) to out (14, L)."""
    j3, j4 = inv[0], inv[1]
    for s in range(LANES):
        j3[s] = mu / (f[0, s] * f[3, s] - f[1, s] * f[2, s]) ** 3
    for s in range(LANES):
        j4[s] = 3.0 * j3[s] / (f[0, s] * f[3, s] - f[1, s] * f[2, s])
    for s in range(LANES):
        out[0, s] = mu * f[0, s] - j3[s] * f[3, s]
    for s in range(LANES):
        out[1, s] = mu * f[1, s] + j3[s] * f[2, s]
    for s in range(LANES):
        out[2, s] = mu * f[2, s] + j3[s] * f[1, s]
    for s in range(LANES):
        out[3, s] = mu * f[3, s] - j3[s] * f[0, s]
    for s in range(LANES):
        out[4, s] = mu + j4[s] * f[3, s] * f[3, s]
    for s in range(LANES):
        out[5, s] = -j4[s] * f[3, s] * f[2, s]
    for s in range(LANES):
        out[6, s] = -j4[s] * f[3, s] * f[1, s]
    for s in range(LANES):
        out[7, s] = j4[s] * f[0, s] * f[3, s] - j3[s]
    for s in range(LANES):
        out[8, s] = mu + j4[s] * f[2, s] * f[2, s]
    for s in range(LANES):
        out[9, s] = j4[s] * f[1, s] * f[2, s] + j3[s]
    for s in range(LANES):
        out[10, s] = -j4[s] * f[0, s] * f[2, s]
    for s in range(LANES):
        out[11, s] = mu + j4[s] * f[1, s] * f[1, s]
    for s in range(LANES):
        out[12, s] = -j4[s] * f[0, s] * f[1, s]
    for s in range(LANES):
        out[13, s] = mu + j4[s] * f[0, s] * f[0, s]


@njit(cache=True, error_model="numpy")
def raise_lanes(f: FloatArray, part: float, out: FloatArray, spare: FloatArray) -> None:
    """Takes away ``part`` / mu of the negative eigenvalue (see ``material.response``): out (14, L).

    Args:
        f: (4, L) deformation gradients.
        part: projected * mu, MPa.
        out: (14, L) stress and tangent, changed.
        spare: (2, L) room to work in.
    """
    e, h = spare[0], spare[1]
    for s in range(LANES):
        e[s] = 0.5 * (f[0, s] + f[3, s])
    for s in range(LANES):
        h[s] = 0.5 * (f[2, s] - f[1, s])
    for s in range(LANES):
        j = f[0, s] * f[3, s] - f[1, s] * f[2, s]
        k = 0.5 * part * max(0.0, 1.0 / (j * j * j) - 1.0) / (e[s] * e[s] + h[s] * h[s])
        ee, eh, hh = k * e[s] * e[s], k * e[s] * h[s], k * h[s] * h[s]
        out[4, s] += hh
        out[5, s] += eh
        out[6, s] -= eh
        out[7, s] += hh
        out[8, s] += ee
        out[9, s] -= ee
        out[10, s] += eh
        out[11, s] += ee
        out[12, s] -= eh
        out[13, s] += hh
