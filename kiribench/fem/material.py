"""Incompressible hyperelastic laws in plane stress.

The energy per undeformed area and unit thickness depends on the in-plane deformation alone:
incompressibility gives the thickness stretch 1 / (l1 l2), plane stress the pressure. Both laws
are one-term Ogden laws; neo-Hookean is alpha = 2 and has a shorter way through the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, log

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class NeoHookean:
    """W = mu/2 (tr C + 1/det C - 3), C the 2-D right Cauchy-Green tensor.

    Attributes:
        mu_mpa: shear modulus, MPa; the paper's Dragon Skin 20 is 0.207.
    """

    mu_mpa: float = 0.207

    @property
    def alpha(self) -> float:
        """Ogden's exponent, 2."""
        return 2.0


@dataclass(frozen=True)
class Ogden:
    """W = 2 mu/alpha^2 (l1^alpha + l2^alpha + (l1 l2)^-alpha - 3), one term.

    Attributes:
        mu_mpa: initial shear modulus, MPa.
        alpha: exponent; 2 is neo-Hookean.
    """

    mu_mpa: float
    alpha: float


Material = NeoHookean | Ogden


def uniaxial_stress(material: Material, stretch: FloatArray) -> FloatArray:
    """Nominal stress (MPa, any shape) of a bar at a stretch (same shape), free sides.

    2 mu / alpha (l^(alpha - 1) - l^(-alpha/2 - 1)); neo-Hookean mu (l - l^-2).
    """
    alpha = material.alpha
    return np.asarray(
        2 * material.mu_mpa / alpha * (stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1))
    )


@njit(cache=True, inline="always", error_model="numpy")
def energy_density(a: float, b: float, c: float, d: float, mu: float, alpha: float) -> float:
    """W (MPa) of the deformation gradient [[a, b], [c, d]]; infinite where it is not a map."""
    det = a * d - b * c
    if not det > 1e-9:
        return inf
    if alpha == 2.0:
        return 0.5 * mu * (a * a + b * b + c * c + d * d + 1.0 / (det * det) - 3.0)
    mean = 0.5 * hypot(a + d, c - b)
    half = 0.5 * hypot(a - d, c + b)
    l1 = mean + half
    l2 = det / l1
    powers: float = l1**alpha + l2**alpha + det**-alpha
    return 2.0 * mu / (alpha * alpha) * (powers - 3.0)


@njit(cache=True, error_model="numpy")
def ogden_response(
    a: float,
    b: float,
    c: float,
    d: float,
    mu: float,
    alpha: float,
    projected: float,
    out: FloatArray,
) -> None:
    """Nominal stress and tangent of the one-term Ogden law at F = [[a, b], [c, d]].

    ``out`` (14,): P11, P12, P21, P22 (MPa), then the upper triangle of dP/dF, row by row.
    In the frame of the principal directions dP/dF has four blocks: the Hessian of W(l1, l2),
    the flip (W1 - W2)/(l1 - l2) and the twist (W1 + W2)/(l1 + l2). ``projected`` is the part of
    their negative eigenvalues that is taken away: at 1 they are zero (Teran et al., Symposium on
    Computer Animation 2005), so that a Newton step far from equilibrium goes downhill.
    """
    e, h = 0.5 * (a + d), 0.5 * (c - b)
    f, g = 0.5 * (a - d), 0.5 * (c + b)
    q, r = hypot(e, h), hypot(f, g)
    l1 = q + r
    l2 = (a * d - b * c) / l1
    turn = np.arctan2(h, e)
    shear = np.arctan2(g, f) if r > 0.0 else 0.0
    left, right = 0.5 * (shear + turn), 0.5 * (shear - turn)
    u = np.array([[np.cos(left), -np.sin(left)], [np.sin(left), np.cos(left)]])
    v = np.array([[np.cos(right), -np.sin(right)], [np.sin(right), np.cos(right)]])
    k = 2.0 * mu / alpha
    squeeze = (l1 * l2) ** -alpha
    p1, p2 = l1**alpha, l2**alpha
    w1, w2 = k * (p1 - squeeze) / l1, k * (p2 - squeeze) / l2
    w11 = k * ((alpha - 1.0) * p1 + (alpha + 1.0) * squeeze) / (l1 * l1)
    w22 = k * ((alpha - 1.0) * p2 + (alpha + 1.0) * squeeze) / (l2 * l2)
    w12 = k * alpha * squeeze / (l1 * l2)
    # (W1 - W2)/(l1 - l2): as x = log(l1/l2) -> 0 the quotient of the powers needs expm1.
    flip = k * squeeze / (l1 * l2)
    x = log(l1 / l2)
    if x > 1e-9:
        flip += k * l2 ** (alpha - 2.0) * np.expm1((alpha - 1.0) * x) / np.expm1(x)
    else:
        flip += k * l2 ** (alpha - 2.0) * (alpha - 1.0)
    twist = (w1 + w2) / (l1 + l2)
    if projected > 0.0:
        left_over = 1.0 - projected
        flip, twist = max(flip, left_over * flip), max(twist, left_over * twist)
        middle, gap = 0.5 * (w11 + w22), hypot(0.5 * (w11 - w22), w12)
        if middle - gap < 0.0:
            # The eigenvalues of [[w11, w12], [w12, w22]] change, its eigenvectors stay.
            low, high = left_over * (middle - gap), max(middle + gap, left_over * (middle + gap))
            scale = 0.5 * (high - low) / gap if gap > 0.0 else 0.0
            middle = 0.5 * (high + low)
            half = 0.5 * scale * (w11 - w22)
            w11, w12, w22 = middle + half, scale * w12, middle - half
    modes = np.empty((4, 4))
    for i in range(2):
        for j in range(2):
            n11, n22 = u[i, 0] * v[j, 0], u[i, 1] * v[j, 1]
            n12, n21 = u[i, 0] * v[j, 1], u[i, 1] * v[j, 0]
            row = 2 * i + j
            modes[0, row] = n11
            modes[1, row] = n22
            modes[2, row] = np.sqrt(0.5) * (n12 + n21)
            modes[3, row] = np.sqrt(0.5) * (n12 - n21)
            out[row] = w1 * n11 + w2 * n22
    at = 4
    for i in range(4):
        for j in range(i, 4):
            out[at] = (
                w11 * modes[0, i] * modes[0, j]
                + w22 * modes[1, i] * modes[1, j]
                + w12 * (modes[0, i] * modes[1, j] + modes[1, i] * modes[0, j])
                + flip * modes[2, i] * modes[2, j]
                + twist * modes[3, i] * modes[3, j]
            )
            at += 1


@njit(cache=True, error_model="numpy")
def response(
    a: float,
    b: float,
    c: float,
    d: float,
    mu: float,
    alpha: float,
    projected: float,
    out: FloatArray,
) -> None:
    """Nominal stress and tangent at F = [[a, b], [c, d]]; arguments as in ``ogden_response``.

    Neo-Hookean: P = mu (F - J^-3 cof F), dP/dF = mu (I + 3 J^-4 cof F (x) cof F - J^-3 d cof F).
    Of its eigenvalues only that of the twist can be negative, mu (1 - J^-3) where J < 1: flip is
    mu (1 + J^-3), and the Hessian of W(l1, l2) / mu has the determinant
    1 + 3 J^-4 (l1^2 + l2^2) + 5 J^-6. The twist's direction is R [[0, -1], [1, 0]] / sqrt(2), R the
    rotation of F, so that it is raised without a singular value decomposition.
    """
    if alpha != 2.0:
        ogden_response(a, b, c, d, mu, alpha, projected, out)
        return
    det = a * d - b * c
    j3 = 1.0 / (det * det * det)
    j4 = 3.0 * j3 / det
    out[0] = mu * (a - j3 * d)
    out[1] = mu * (b + j3 * c)
    out[2] = mu * (c + j3 * b)
    out[3] = mu * (d - j3 * a)
    out[4] = mu * (1.0 + j4 * d * d)
    out[5] = -mu * j4 * d * c
    out[6] = -mu * j4 * d * b
    out[7] = mu * (j4 * a * d - j3)
    out[8] = mu * (1.0 + j4 * c * c)
    out[9] = mu * (j4 * b * c + j3)
    out[10] = -mu * j4 * a * c
    out[11] = mu * (1.0 + j4 * b * b)
    out[12] = -mu * j4 * a * b
    out[13] = mu * (1.0 + j4 * a * a)
    if projected > 0.0 and j3 > 1.0:
        e, h = 0.5 * (a + d), 0.5 * (c - b)
        k = 0.5 * projected * mu * (j3 - 1.0) / (e * e + h * h)
        ee, eh, hh = k * e * e, k * e * h, k * h * h
        out[4] += hh
        out[5] += eh
        out[6] -= eh
        out[7] += hh
        out[8] += ee
        out[9] -= ee
        out[10] += eh
        out[11] += ee
        out[12] -= eh
        out[13] += hh
