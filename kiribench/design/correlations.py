"""Compiled sums of a design kernel: correlations between points and a table's designs.

The kernel is a product over up to three coordinates, already divided by their length scales, of
one family: ``k = f(s) exp(-s)`` with ``s = root |d|`` and the polynomial f of a Matern kernel
(Rasmussen & Williams 2006, eq. 4.16), or the Gaussian one (eq. 4.9). So one exponential a pair is
enough. It is numpy's, which takes eight numbers at a time; everything around it is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

COORDINATES = 3
CHUNK = 256  # points at a time: 0.9 MB an array for the paper's table, what a cache holds
FARTHEST = 200.0  # exp(-200) = 1e-87; numbers so small that they are denormal cost a hundredfold

FAMILIES: dict[str, tuple[float, float, float]] = {
    "gaussian": (0.0, 0.0, 0.0),
    "matern32": (3.0, 0.0, 0.0),
    "matern52": (5.0, 1 / 3, 0.0),
    "matern72": (7.0, 0.4, 1 / 15),
}
"""Square of the root, and the factors of s^2 and s^3 in ``f = 1 + s + .. s^2 + .. s^3``."""

_SUMS = {"reassoc", "contract", "nsz"}  # sums in any order, so that they are vectorised


def correlations(family: str, at: FloatArray, nodes: FloatArray) -> FloatArray:
    """(k, p) correlations of (k, 3) points with (3, p) nodes."""
    kind = FAMILIES[family]
    terms = _exponentials(kind, at, nodes)
    _times_factors(*kind, at, nodes, terms)
    return terms


def weighted_jets(
    family: str, at: FloatArray, nodes: FloatArray, weights: FloatArray, cells: IntArray
) -> FloatArray:
    """Weighted sums of the correlations, with derivatives by the coordinates.

    Args:
        family: a key of :data:`FAMILIES`.
        at: (k, 3) points.
        nodes: (3, p).
        weights: (n, p).
        cells: (k,) which row of the weights each point takes.

    Returns:
        (k, 10): value, three first derivatives, and the second ones 00, 11, 22, 01, 02, 12.
    """
    sums = np.empty((len(at), 10))
    kind = FAMILIES[family]
    for start in range(0, len(at), CHUNK):
        part = slice(start, start + CHUNK)
        terms = _exponentials(kind, at[part], nodes)
        _sum_jets(*kind, at[part], nodes, terms, weights, cells[part], sums[part])
    return sums


def _exponentials(
    kind: tuple[float, float, float], at: FloatArray, nodes: FloatArray
) -> FloatArray:
    terms = np.empty((len(at), nodes.shape[1]))
    _exponents(kind[0], at, nodes, terms)
    return np.exp(terms, out=terms)


@njit(cache=True, fastmath=_SUMS)
def _exponents(square: float, at: FloatArray, nodes: FloatArray, out: FloatArray) -> None:
    root = math.sqrt(square)
    for k in range(at.shape[0]):
        x, y, z = at[k, 0], at[k, 1], at[k, 2]
        for j in range(nodes.shape[1]):
            d, e, f = x - nodes[0, j], y - nodes[1, j], z - nodes[2, j]
            if square == 0.0:
                sum_ = 0.5 * (d * d + e * e + f * f)
            else:
                sum_ = root * (abs(d) + abs(e) + abs(f))
            out[k, j] = -min(sum_, FARTHEST)


@njit(cache=True, fastmath=_SUMS)
def _times_factors(
    square: float, c2: float, c3: float, at: FloatArray, nodes: FloatArray, terms: FloatArray
) -> None:
    if square == 0.0:
        return
    root = math.sqrt(square)
    for k in range(at.shape[0]):
        x, y, z = at[k, 0], at[k, 1], at[k, 2]
        for j in range(nodes.shape[1]):
            s, t, u = (
                root * abs(x - nodes[0, j]),
                root * abs(y - nodes[1, j]),
                root * abs(z - nodes[2, j]),
            )
            terms[k, j] *= (
                (1.0 + s * (1.0 + s * (c2 + c3 * s)))
                * (1.0 + t * (1.0 + t * (c2 + c3 * t)))
                * (1.0 + u * (1.0 + u * (c2 + c3 * u)))
            )


@njit(inline="always")
def _parts(
    square: float, root: float, c2: float, c3: float, d: float
) -> tuple[float, float, float]:
    """Factor, and by the signed distance d its first and second derivative, over ``exp``.

    With ``k = f(s) e^-s``: ``k' = square d q(s) e^-s``, ``q = (f' - f) / s``, and
    ``k'' = square (q + s q' - s q) e^-s``: no division, and smooth through d = 0.
    """
    if square == 0.0:
        return 1.0, -d, d * d - 1.0
    s = root * abs(d)
    factor = 1.0 + s * (1.0 + s * (c2 + c3 * s))
    q = (2.0 * c2 - 1.0) + s * ((3.0 * c3 - c2) - c3 * s)
    bend = s * ((3.0 * c3 - c2) - 2.0 * c3 * s)
    return factor, square * d * q, square * (q + bend - s * q)


@njit(cache=True, fastmath=_SUMS)
def _sum_jets(
    square: float,
    c2: float,
    c3: float,
    at: FloatArray,
    nodes: FloatArray,
    terms: FloatArray,
    weights: FloatArray,
    cells: IntArray,
    out: FloatArray,
) -> None:
    root = math.sqrt(square)
    for k in range(at.shape[0]):
        x, y, z, cell = at[k, 0], at[k, 1], at[k, 2], cells[k]
        v = g0 = g1 = g2 = h00 = h11 = h22 = h01 = h02 = h12 = 0.0
        for j in range(nodes.shape[1]):
            w = weights[cell, j] * terms[k, j]
            f0, d0, c00 = _parts(square, root, c2, c3, x - nodes[0, j])
            f1, d1, c11 = _parts(square, root, c2, c3, y - nodes[1, j])
            f2, d2, c22 = _parts(square, root, c2, c3, z - nodes[2, j])
            w01, w2 = w * f0 * f1, w * f2
            v += w01 * f2
            g2 += w01 * d2
            h22 += w01 * c22
            g0 += w2 * d0 * f1
            g1 += w2 * f0 * d1
            h00 += w2 * c00 * f1
            h11 += w2 * f0 * c11
            h01 += w2 * d0 * d1
            h02 += w * d0 * f1 * d2
            h12 += w * f0 * d1 * d2
        row = out[k]
        row[0], row[1], row[2], row[3] = v, g0, g1, g2
        row[4], row[5], row[6] = h00, h11, h22
        row[7], row[8], row[9] = h01, h02, h12
