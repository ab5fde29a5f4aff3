"""Where a flat patch comes to lie on skin that is not flat at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import NodesError, NotConvergedError
from kiribench.fem.material import NeoHookean
from kiribench.fem.surface_map import NodeSpline
from kiribench.fem.wear_measures import site_means
from kiribench.fem.wear_mesh import mesh_patch
from kiribench.fem.wear_skin import Flatness, flatness
from kiribench.fem.wear_system import WearSystem, relax
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]

MOST_DISTORTION = 0.15
"""Mismatch of a skin beyond which a flat patch is not modelled at all (``Flatness.mismatch``)."""

_INTERVALS = 4


@dataclass(frozen=True, eq=False)
class RestMap:
    """Material coordinates of the points of a patch as it is laid on the skin at rest.

    Attributes:
        sites_q_mm: (2R + 1, 2C + 1, 2) of the lattice sites.
        half_cell_mm: distance of the sites on the flat patch.
        largest_strain: of an uncut sheet that is laid so, as the largest stretch - 1 in size.
        flatness: of the skin under it.
    """

    sites_q_mm: FloatArray
    half_cell_mm: float
    largest_strain: float
    flatness: Flatness

    def at(self, points_mm: FloatArray) -> FloatArray:
        """Material coordinates (n, 2) of patch points (n, 2), by a spline through the sites."""
        rows, columns = self.sites_q_mm.shape[:2]
        nodes = np.zeros((rows, columns, 3))
        nodes[..., :2] = self.sites_q_mm
        return NodeSpline.of(nodes, self.half_cell_mm).at(points_mm).x[:, :2]


def rest_map(surface: NodeSpline, cut_map: CutMap, origin_q_mm: tuple[float, float]) -> RestMap:
    """Lay the patch, uncut and free to slide, on the skin at rest: the least elastic energy.

    Its centre and the direction of its middle column stay where the grid says.

    Raises:
        NotConvergedError: it cannot be laid.
    """
    whole = CutMap.uniform(0.0, 0.0, cut_map.rows, cut_map.columns, cut_map.cell_mm)
    mesh = mesh_patch(whole, _INTERVALS, 1, hold=(False, False))
    half = cut_map.cell_mm / 2
    middle = half * np.array([cut_map.columns, cut_map.rows])
    distance = np.linalg.norm(mesh.points_mm - middle, axis=1)
    below = np.linalg.norm(mesh.points_mm - middle - [0, half], axis=1)
    fixed = np.zeros(mesh.points_mm.shape, dtype=bool)
    fixed[np.argmin(distance)] = True
    fixed[np.argmin(below), 0] = True
    system = WearSystem(mesh, surface, fixed, NeoHookean().mu_mpa)
    found = relax(system, mesh.points_mm + origin_q_mm)
    if found.reason is not None:
        raise NotConvergedError(
            "rest-map",
            f"The patch cannot be laid on the skin at rest: {found.reason}.",
            remedy="Check the nodes of the 0-degree scan.",
        )
    gradients, _ = mesh.gradients()
    x = surface.at(found.q).x[mesh.nodes][:, mesh.template.elements]
    deformation = np.einsum("fmad,fmqai->fmqdi", x, gradients, optimize=True)
    stretch = np.linalg.svd(deformation, compute_uv=False)
    return RestMap(
        site_means(mesh, found.q),
        half,
        float(np.abs(stretch - 1).max()),
        _flatness_under(surface, cut_map, origin_q_mm),
    )


def rest_of_skin(
    rest_xyz_mm: FloatArray, pitch_mm: float, cut_map: CutMap, origin_q_mm: tuple[float, float]
) -> RestMap | None:
    """None where the skin at rest, nodes (R + 1, C + 1, 3), is flat enough under the patch; else
    its rest map.

    Raises:
        NodesError: no flat patch can be laid on it without strain beyond ``MOST_DISTORTION``.
        NotConvergedError: see ``rest_map``.
    """
    surface = NodeSpline.of(rest_xyz_mm, pitch_mm)
    found = _flatness_under(surface, cut_map, origin_q_mm)
    if found.flat:
        return None
    if found.mismatch > MOST_DISTORTION:
        worst = float(np.abs(found.gauss_curvature).max(initial=0.0))
        raise NodesError(
            "skin-not-flat",
            "The skin at 0 degrees is too far from flat for a patch of flat cells: its total "
            f"Gauss curvature under the patch is {found.total_curvature:.2f} rad, at most "
            f"{worst:.1e} 1/mm^2 in size.",
            remedy="Take a smaller part of the body, or check pitch and nodes of the scan.",
            got=f"{found.mismatch:.1%} rms mismatch of the grid with its pitch",
            expected=f"at most {MOST_DISTORTION:.0%}",
        )
    return rest_map(surface, cut_map, origin_q_mm)


def _flatness_under(
    surface: NodeSpline, cut_map: CutMap, origin_q_mm: tuple[float, float]
) -> Flatness:
    """Of the skin under the patch, at the corners of its cells."""
    steps = np.meshgrid(np.arange(cut_map.columns + 1), np.arange(cut_map.rows + 1))
    corners = cut_map.cell_mm * np.stack(steps, axis=-1) + np.array(origin_q_mm)
    places = surface.at(corners.reshape(-1, 2)).x.reshape(*corners.shape[:2], 3)
    return flatness(places, cut_map.cell_mm)
