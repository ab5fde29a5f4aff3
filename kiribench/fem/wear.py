"""A kirigami patch as worn: strapped to the skin of the flexed limb and free to slide on it.

The unknown of every node is q = (u, v), the skin's material coordinates; its place is X(q) on a
smooth map of the skin. The patch is a membrane of incompressible neo-Hookean rubber in plane
stress; the skin is rigid in the pose and holds the patch by normal forces alone, by friction, or
fully. Bending, the lips of the cuts in contact, thickness and viscosity are not in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.fem.material import Material
from kiribench.fem.surface_map import SurfaceMap
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]

Straps = Literal["rows", "hoops", "free"]


@dataclass(frozen=True)
class WearSpec:
    """How a patch is put on, and how finely it is meshed.

    Attributes:
        elements_per_facet: elements along a facet edge (half a cell).
        friction: Coulomb coefficient between patch and skin; 0 slides freely, infinity sticks.
        straps: ``"rows"`` the proximal and the distal edge are strapped, ``"hoops"`` only
            their outermost cells on either side, ``"free"`` the proximal edge only.
        strap_slip_mm: by how much the distal strap has slipped proximally (in q).
        offset_mm: displacement (u, v) of the whole patch on the skin when it is strapped.
        turn_deg: turn of the whole patch about its centre when strapped, from u towards v.
        thickness_mm: of the sheet; forces and pressures are proportional to it.
    """

    elements_per_facet: int = 10
    friction: float = 0.0
    straps: Straps = "rows"
    strap_slip_mm: float = 0.0
    offset_mm: tuple[float, float] = (0.0, 0.0)
    turn_deg: float = 0.0
    thickness_mm: float = 2.0


@dataclass(frozen=True, eq=False)
class WornPatch:
    """A patch of R x C cells in equilibrium on the skin.

    Attributes:
        corner_q_mm: (R + 1, C + 1, 2) corners of the cells in skin material coordinates, the
            mean of all faces at each.
        site_q_mm: (2R + 1, 2C + 1, 2) the same of all lattice sites.
        site_mm: (2R + 1, 2C + 1, 3) places of these.
        longitudinal_stretch, lateral_stretch: (R, C) length of the cells' edges on the skin /
            cell edge, mean of two opposite ones.
        shear: (R, C) tangent of the closing of the right angle, as in `measure`.
        contact_pressure_mpa: (2R, 2C) by facet; negative is lift-off (it cannot be held).
        tip_stress_mpa, tip_stretch: (k,) largest principal Cauchy stress and stretch about the
            tips of the half-cuts, in the order of ``CutMap.half_cuts``.
        face_overlap_mm: largest depth to which two crack faces pass through each other.
        strap_force_n: force along the limb that the distal (``free``: proximal) strap carries.
        energy_mj: elastic energy of the patch.
        newton_iterations: spent.
        status: ``"ok"`` or ``"not-converged"``.
        reason: why it is not converged; None where it is.
        cpu_seconds: processor time of the call.
    """

    corner_q_mm: FloatArray
    site_q_mm: FloatArray
    site_mm: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    shear: FloatArray
    contact_pressure_mpa: FloatArray
    tip_stress_mpa: FloatArray
    tip_stretch: FloatArray
    face_overlap_mm: float
    strap_force_n: float
    energy_mj: float
    newton_iterations: int
    status: str
    reason: str | None
    cpu_seconds: float


@dataclass(frozen=True, eq=False)
class WearSensitivities:
    """A worn patch with the exact derivatives of the discrete model.

    Attributes:
        worn: the solution that was differentiated.
        corner_q: ((R + 1) (C + 1) 2, 2 R C) d corner_q_mm / d (a, b), mm; rows as
            ``corner_q_mm.ravel()``, columns ``a.ravel()`` then ``b.ravel()`` (fractions).
        cpu_seconds: processor time of the derivatives alone.
    """

    worn: WornPatch
    corner_q: FloatArray
    cpu_seconds: float


def wear_patch(
    cut_map: CutMap,
    surface: SurfaceMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec | None = None,
    material: Material | None = None,
) -> WornPatch:
    """Equilibrium of a patch on the skin.

    Args:
        cut_map: the design.
        surface: the skin in the pose.
        origin_q_mm: material coordinates that the patch's proximal lateral corner is laid on.
        spec: None is ``WearSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.
    """
    raise NotImplementedError


def wear_sensitivities(
    cut_map: CutMap,
    surface: SurfaceMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec | None = None,
    material: Material | None = None,
) -> WearSensitivities:
    """Equilibrium and its derivatives by all cut lengths; arguments as in ``wear_patch``."""
    raise NotImplementedError
