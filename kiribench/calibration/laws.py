"""Laws that a tension test is fitted with: stress of a bar, energy, and where they are stable.

All are incompressible. Neo-Hookean and one-term Ogden are those of :mod:`kiribench.fem.material`,
which the finite elements take; Ogden laws of more terms and Yeoh's exist here only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.material import NeoHookean, Ogden

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OgdenSum:
    """W = sum of 2 mu_i/alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), several terms.

    Attributes:
        mu_mpa: shear moduli of the terms, MPa; their sum is the initial shear modulus.
        alpha: exponents, not 0.
    """

    mu_mpa: tuple[float, ...]
    alpha: tuple[float, ...]


@dataclass(frozen=True)
class Yeoh:
    """W = c1 (I1 - 3) + c2 (I1 - 3)^2 + c3 (I1 - 3)^3 (Rubber Chem. Technol. 66, 1993).

    Attributes:
        c1_mpa, c2_mpa, c3_mpa: coefficients, MPa; the initial shear modulus is 2 c1.
    """

    c1_mpa: float
    c2_mpa: float
    c3_mpa: float


Law = NeoHookean | Ogden | OgdenSum | Yeoh


def terms_of(law: NeoHookean | Ogden | OgdenSum) -> tuple[FloatArray, FloatArray]:
    """Shear moduli (k,), MPa, and exponents (k,) of a law that is a sum of Ogden terms."""
    if isinstance(law, OgdenSum):
        return np.array(law.mu_mpa), np.array(law.alpha)
    return np.array([law.mu_mpa]), np.array([float(law.alpha)])


def initial_shear_modulus(law: Law) -> float:
    """Shear modulus at small strain, MPa; Young's modulus is three times that."""
    return 2 * law.c1_mpa if isinstance(law, Yeoh) else float(terms_of(law)[0].sum())


def ogden_columns(stretch: FloatArray, alpha: FloatArray) -> FloatArray:
    """Nominal stress (n, k) of a bar per unit of each shear modulus; stretch (n,), alpha (k,).

    2/alpha (l^(alpha - 1) - l^(-alpha/2 - 1)), which at alpha = 0 is 3 log(l)/l.
    """
    logs = np.log(stretch)[:, None]
    small = np.abs(alpha) < 1e-9
    safe = np.where(small, 1.0, alpha)
    grown = np.where(small, 1.5 * logs, np.expm1(1.5 * safe * logs) / safe)
    return np.asarray(2 * np.exp((-0.5 * alpha - 1) * logs) * grown)


def ogden_slopes(stretch: FloatArray, alpha: FloatArray) -> FloatArray:
    """Derivative (n, k) of :func:`ogden_columns` by the exponents; stretch (n,), alpha (k,)."""
    logs = np.log(stretch)[:, None]
    upper, lower = np.exp((alpha - 1) * logs), np.exp((-0.5 * alpha - 1) * logs)
    return np.asarray(2 / alpha * (upper + 0.5 * lower) * logs - 2 / alpha**2 * (upper - lower))


def yeoh_columns(stretch: FloatArray) -> FloatArray:
    """Nominal stress (n, 3) of a bar per unit of c1, c2, c3; stretch (n,)."""
    excess = stretch**2 + 2 / stretch - 3
    shape = 2 * (stretch - stretch**-2)
    return np.stack([shape, 2 * shape * excess, 3 * shape * excess**2], axis=1)


def bar_stress(law: Law, stretch: FloatArray) -> FloatArray:
    """Nominal stress (n,), MPa, of a bar with free sides at stretches (n,)."""
    if isinstance(law, Yeoh):
        own = np.array([law.c1_mpa, law.c2_mpa, law.c3_mpa])
        return np.asarray(yeoh_columns(stretch) @ own)
    mu, alpha = terms_of(law)
    return np.asarray(ogden_columns(stretch, alpha) @ mu)


def log_strain_hessian(law: Law, first: FloatArray, second: FloatArray) -> FloatArray:
    """Hessian (n, 2, 2), MPa, of the energy of a sheet by its two principal log strains.

    Args:
        law: the law.
        first, second: (n,) principal stretches in the plane; the thickness follows.
    """
    result = np.zeros((len(first), 2, 2))
    third = 1 / (first * second)
    if isinstance(law, Yeoh):
        squares = np.stack([first**2, second**2, third**2], axis=1)
        excess = squares.sum(axis=1) - 3
        slope = law.c1_mpa + 2 * law.c2_mpa * excess + 3 * law.c3_mpa * excess**2
        curve = 2 * law.c2_mpa + 6 * law.c3_mpa * excess
        by = 2 * (squares[:, :2] - squares[:, 2:])
        result += curve[:, None, None] * by[:, :, None] * by[:, None, :]
        for i in range(2):
            for j in range(2):
                own = squares[:, i] if i == j else 0.0
                result[:, i, j] += slope * 4 * (own + squares[:, 2])
        return result
    for mu, alpha in zip(*terms_of(law), strict=True):
        powers = [first**alpha, second**alpha, third**alpha]
        for i in range(2):
            for j in range(2):
                result[:, i, j] += 2 * mu * ((powers[i] if i == j else 0.0) + powers[2])
    return result


@dataclass(frozen=True)
class Stability:
    """Up to which strain a law is stable in Drucker's sense, by kind of loading.

    Attributes:
        largest_strain: the engineering strain that was looked at (along the pull).
        first_unstable: kind of loading -> engineering strain of the first instability, or None
            where there is none up to ``largest_strain``.
    """

    largest_strain: float
    first_unstable: dict[str, float | None]

    @property
    def stable(self) -> bool:
        """Whether no kind of loading is unstable."""
        return all(strain is None for strain in self.first_unstable.values())


def stability_of(law: Law, largest_strain: float, *, points: int = 400) -> Stability:
    """Drucker's condition along uniaxial, planar and equibiaxial tension of a sheet.

    Incompressible and in plane stress it says that true stress works against every change of
    log strain: the Hessian of the energy by the two log strains is positive definite.

    Args:
        law: the law.
        largest_strain: engineering strain along the pull up to which it is checked.
        points: stretches looked at.
    """
    stretch = 1 + largest_strain * np.arange(1, points + 1) / points
    found: dict[str, float | None] = {}
    for name, across in (
        ("uniaxial", stretch**-0.5),
        ("planar", np.ones_like(stretch)),
        ("equibiaxial", stretch),
    ):
        lowest = np.linalg.eigvalsh(log_strain_hessian(law, stretch, across))[:, 0]
        bad = np.flatnonzero(lowest <= 0)
        found[name] = float(stretch[bad[0]] - 1) if len(bad) else None
    return Stability(largest_strain, found)
