"""A kirigami patch as worn: strapped to the skin of the flexed limb and free to slide on it.

The unknown of every node is q = (u, v), the skin's material coordinates; its place is X(q) on a
smooth map of the skin. The patch is a membrane of incompressible neo-Hookean rubber in plane
stress; the skin is rigid in the pose and holds the patch by normal forces alone, by friction, or
fully. Bending, the lips of the cuts in contact, thickness and viscosity are not in it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.errors import DataError, NotConvergedError
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.surface_map import SurfaceMap
from kiribench.fem.wear_contact import face_overlap, facet_contact
from kiribench.fem.wear_friction import drag_along
from kiribench.fem.wear_measures import cell_measures, site_means, tip_state
from kiribench.fem.wear_mesh import PatchMesh, mesh_patch
from kiribench.fem.wear_rest import RestMap
from kiribench.fem.wear_sensitivities import corner_sensitivities
from kiribench.fem.wear_system import Equilibrium, WearSystem, relax
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]

Straps = Literal["rows", "hoops", "free"]
Element = Literal["nine-node", "four-node"]


@dataclass(frozen=True)
class WearSpec:
    """How a patch is put on, and how finely it is meshed.

    Attributes:
        elements_per_facet: divisions of a facet edge (half a cell) by nodes: a nine-node element
            takes two of them, so that 10 has the nodes of 10 x 10 four-node quads.
        element: ``"nine-node"`` quads with quarter points at the tips, or plain ``"four-node"``
            ones, which need many times as many for the same error.
        friction: Coulomb coefficient between patch and skin; 0 slides freely, infinity sticks.
        straps: ``"rows"`` the proximal and the distal edge are strapped, ``"hoops"`` only
            their outermost cells on either side, ``"free"`` the proximal edge only.
        strap_slip_mm: by how much the distal strap has slipped proximally (in q).
        offset_mm: displacement (u, v) of the whole patch on the skin when it is strapped.
        turn_deg: turn of the whole patch about its centre when strapped, from u towards v.
        thickness_mm: of the sheet; forces and pressures are proportional to it.
    """

    elements_per_facet: int = 10
    element: Element = "nine-node"
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
        contact_area_mm2: (2R, 2C) deformed area of the facets.
        tip_stress_mpa, tip_stretch: (k,) largest principal Cauchy stress and stretch on the
            ligament at ``TIP_DISTANCE_MM`` before the tip, half-cuts in the order of
            ``CutMap.half_cuts``, without cuts below ``wear_mesh.NO_CUT``; compare with
            ``BREAKING_STRETCH``.
        facet_overlap_mm: (2R, 2C) largest depth to which a crack face of the facet and the
            opposite one pass through each other.
        strap_force_n: pull along the limb on the distal (``free``: proximal) strap.
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
    contact_area_mm2: FloatArray
    tip_stress_mpa: FloatArray
    tip_stretch: FloatArray
    facet_overlap_mm: FloatArray
    strap_force_n: float
    energy_mj: float
    newton_iterations: int
    status: str
    reason: str | None
    cpu_seconds: float

    @property
    def face_overlap_mm(self) -> float:
        """The largest ``facet_overlap_mm``."""
        return float(self.facet_overlap_mm.max())


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


@dataclass(frozen=True, eq=False)
class Solution:
    """The discrete solution behind a ``WornPatch``: its system, nodes and forces."""

    system: WearSystem
    equilibrium: Equilibrium
    laid_q_mm: FloatArray
    held: tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]


def wear_patch(
    cut_map: CutMap,
    surface: SurfaceMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec | None = None,
    material: Material | None = None,
    *,
    rest: RestMap | None = None,
    path: Sequence[SurfaceMap] | None = None,
) -> WornPatch:
    """Equilibrium of a patch on the skin.

    Args:
        cut_map: the design; a cut shorter than ``wear_mesh.NO_CUT`` of the cell is none.
        surface: the skin in the pose.
        origin_q_mm: material coordinates that the patch's proximal lateral corner is laid on.
        spec: None is ``WearSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``; no other law so far.
        rest: where the flat patch is laid on skin that is not flat at rest; None is where the
            grid's material coordinates say.
        path: skins on the way from rest to the pose, which is the last (``skin_path``); needed
            with a friction other than 0 and infinity, of which the way decides.

    Raises:
        DataError: a mesh, straps or a law that cannot be modelled, or friction without a path.
    """
    began = time.process_time()
    chosen = spec or WearSpec()
    solution = solve_worn(cut_map, surface, origin_q_mm, chosen, material, rest, path)
    return read_worn(solution, surface, chosen, began)


def solve_worn(
    cut_map: CutMap,
    surface: SurfaceMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec,
    material: Material | None,
    rest: RestMap | None = None,
    path: Sequence[SurfaceMap] | None = None,
) -> Solution:
    """Mesh the patch, lay it on the skin and relax it; arguments as in ``wear_patch``."""
    law = material or NeoHookean()
    if not isinstance(law, NeoHookean):
        raise DataError(
            "wear-material",
            "The worn patch is modelled with the neo-Hookean law only.",
            remedy="Give NeoHookean(mu); positions do not depend on mu, forces do.",
            got=type(law).__name__,
        )
    order = 2 if spec.element == "nine-node" else 1
    if spec.elements_per_facet < 3 * order or spec.elements_per_facet % order:
        raise DataError(
            "wear-mesh",
            "The mesh cannot be built with this number of elements a facet edge.",
            remedy="Give an even number from 6 (nine-node), or any from 3 (four-node).",
            got=spec.elements_per_facet,
        )
    mesh = mesh_patch(cut_map, spec.elements_per_facet, order, hold=(True, spec.straps != "free"))
    held = strapped_nodes(mesh, spec.straps)
    laid = lay(mesh.points_mm, cut_map, origin_q_mm, spec, rest)
    fixed = np.repeat((held[0] | held[1])[:, None], 2, axis=1)
    system = WearSystem(mesh, surface, fixed, law.mu_mpa)
    if spec.friction == np.inf:
        jet = system.jet(laid)
        found = Equilibrium(laid, system.forces(jet), 0, system.energy(laid), None)
    elif spec.friction > 0:
        if not path:
            raise DataError(
                "wear-friction-path",
                "Friction depends on the way from rest to the pose, and none was given.",
                remedy="Give the skins on the way, such as skin_path(nodes000, nodes090, pitch).",
                got=f"friction {spec.friction:g}",
            )
        found = drag_along(system, path, laid, spec.friction)
    else:
        found = relax(system, laid)
    return Solution(system, found, laid, held)


def strapped_nodes(
    mesh: PatchMesh, straps: Straps
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """(U,) nodes held by the proximal and by the distal strap."""
    width, length = mesh.cut_map.size_mm
    x, y = mesh.points_mm.T
    near = 1e-9 * length
    proximal, distal = y < near, y > length - near
    if straps == "free":
        distal = np.zeros_like(distal)
    elif straps == "hoops":
        cell = mesh.cut_map.cell_mm
        outer = (x < cell + near) | (x > width - cell - near)
        proximal, distal = proximal & outer, distal & outer
    return proximal, distal


def lay(
    points_mm: FloatArray,
    cut_map: CutMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec,
    rest: RestMap | None = None,
) -> FloatArray:
    """Material coordinates (n, 2) that points of the patch (n, 2) are laid on, before they slide.

    The patch is turned about its centre and displaced; a slip of the distal strap is spread
    evenly along the patch.
    """
    width, length = cut_map.size_mm
    middle = np.array([[width / 2, length / 2]])
    if rest is None:
        q, centre = points_mm + origin_q_mm, middle + origin_q_mm
    else:
        q, centre = rest.at(points_mm), rest.at(middle)
    angle = np.deg2rad(spec.turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    q = (q - centre) @ turn.T + centre + spec.offset_mm
    q[:, 1] -= spec.strap_slip_mm * points_mm[:, 1] / length
    return np.asarray(q)


def read_worn(solution: Solution, surface: SurfaceMap, spec: WearSpec, began: float) -> WornPatch:
    """What is reported of a solution; ``began`` is the processor time at the start."""
    system, found = solution.system, solution.equilibrium
    mesh = system.mesh
    jet = system.jet(found.q)
    sites = site_means(mesh, found.q)
    corners = sites[::2, ::2]
    cells = cell_measures(surface, corners, mesh.cut_map.cell_mm)
    contact = facet_contact(mesh, jet, found.force, surface.outward, spec.thickness_mm)
    stretch, stress = tip_state(mesh, jet, system.mu_mpa)
    strap = solution.held[1] if solution.held[1].any() else solution.held[0]
    along = jet.first[strap, 1] / np.linalg.norm(jet.first[strap, 1], axis=1, keepdims=True)
    pull = abs(float(np.sum(along * found.force[strap])))
    rows, columns = sites.shape[:2]
    return WornPatch(
        corner_q_mm=corners,
        site_q_mm=sites,
        site_mm=surface.at(sites.reshape(-1, 2)).x.reshape(rows, columns, 3),
        longitudinal_stretch=cells.longitudinal_stretch,
        lateral_stretch=cells.lateral_stretch,
        shear=cells.shear,
        contact_pressure_mpa=contact.pressure_mpa,
        contact_area_mm2=contact.area_mm2,
        tip_stress_mpa=stress,
        tip_stretch=stretch,
        facet_overlap_mm=face_overlap(mesh, jet),
        strap_force_n=spec.thickness_mm * pull,
        energy_mj=spec.thickness_mm * found.energy,
        newton_iterations=found.iterations,
        status="ok" if found.reason is None else "not-converged",
        reason=found.reason,
        cpu_seconds=time.process_time() - began,
    )


def wear_sensitivities(
    cut_map: CutMap,
    surface: SurfaceMap,
    origin_q_mm: tuple[float, float],
    spec: WearSpec | None = None,
    material: Material | None = None,
    *,
    rest: RestMap | None = None,
) -> WearSensitivities:
    """Equilibrium and its derivatives by all cut lengths; arguments as in ``wear_patch``.

    A cut of no length (below ``wear_mesh.NO_CUT``) has derivative 0: the energy that a short cut
    sets free grows with the square of its length.

    Raises:
        DataError: as ``wear_patch``, and with friction.
        NotConvergedError: no equilibrium was found.
    """
    chosen = spec or WearSpec()
    if chosen.friction != 0:
        raise DataError(
            "wear-sensitivity-friction",
            "There are no sensitivities with friction.",
            remedy="Design without friction, and check the design with it.",
            got=chosen.friction,
        )
    began = time.process_time()
    solution = solve_worn(cut_map, surface, origin_q_mm, chosen, material, rest)
    worn = read_worn(solution, surface, chosen, began)
    if worn.reason is not None:
        raise NotConvergedError(
            "wear-not-converged",
            f"The worn patch has no equilibrium to differentiate: {worn.reason}.",
            remedy="Use shorter cuts or another mesh.",
        )
    began = time.process_time()
    corner_q = corner_sensitivities(solution.system, solution.equilibrium.q)
    return WearSensitivities(worn, corner_q, time.process_time() - began)
