"""Incompressible hyperelastic laws in plane stress, as energies of the principal stretches.

The energy per undeformed area and unit thickness depends on the in-plane deformation alone:
incompressibility gives the thickness stretch, plane stress the pressure.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NeoHookean:
    """W = mu/2 (tr C + 1/det C - 3), C the 2-D right Cauchy-Green tensor.

    Attributes:
        mu_mpa: shear modulus, MPa; the paper's Dragon Skin 20 is 0.207.
    """

    mu_mpa: float = 0.207


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
