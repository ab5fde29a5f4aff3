"""Every node of a pulled patch at each load step, for pictures of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import NotConvergedError
from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import Failed, LoadStepper
from kiribench.fem.gauge import site_positions
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import MeshSpec
from kiribench.fem.patch import patch_mesh
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SheetSteps:
    """A pulled patch; s load steps, frame as in :mod:`kiribench.lattice`.

    Attributes:
        rest_mm: (n, 2) nodes at rest; y counts from the fixed end of the lower band.
        place_mm: (s, n, 2) nodes at the load steps.
        triangles: (m, 3) node numbers, four for each six-node triangle.
        corner_mm: (s, R + 1, C + 1, 2) the corners of the cells, mean of both faces of a cut.
        force_n_per_mm: (s,) pulling force for each mm of thickness, N/mm.
    """

    rest_mm: FloatArray
    place_mm: FloatArray
    triangles: IntArray
    corner_mm: FloatArray
    force_n_per_mm: FloatArray


def follow_sheet(
    cut_map: CutMap,
    displacements_mm: npt.ArrayLike,
    *,
    grip_mm: float,
    mesh: MeshSpec | None = None,
    material: Material | None = None,
) -> SheetSteps:
    """Pull a patch between two held ends and keep all nodes.

    Args:
        cut_map: the design. displacements_mm: (s,) of the distal end, monotonic from 0.
        grip_mm: uncut band at either end, mm. mesh: None is ``MeshSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.

    Raises:
        NotConvergedError: ``fem-not-converged``; ask for smaller steps.
    """
    sheet = patch_mesh(cut_map, mesh or MeshSpec(), grip_mm=grip_mm)
    fixed = sheet.boundary_nodes("bottom", ligaments_only=False)
    moved = sheet.boundary_nodes("top", ligaments_only=False)
    equation = np.zeros(sheet.points_mm.shape, dtype=np.int64)
    equation[fixed] = equation[moved] = -1
    free = equation == 0
    equation[free] = np.arange(free.sum())
    pattern = np.zeros_like(sheet.points_mm)
    pattern[moved, 1] = 1.0
    system = CondensedSystem(sheet, equation, material or NeoHookean())
    stepper = LoadStepper(system, pattern)
    bands = (len(sheet.y_mm) - 1 - 2 * cut_map.rows) // 2
    place, corner, force = [], [], []
    for displacement in np.atleast_1d(np.asarray(displacements_mm, dtype=np.float64)):
        x = sheet.points_mm
        if displacement != 0:
            solved = stepper.advance(float(displacement))
            if isinstance(solved, Failed):
                raise NotConvergedError(
                    "fem-not-converged",
                    f"The sheet was not found at {displacement:g} mm.",
                    remedy="Ask for smaller steps.",
                )
            x = solved.x
        place.append(x.copy())
        sites = site_positions(sheet, x)[bands : bands + 2 * cut_map.rows + 1]
        corner.append(sites[::2, ::2])
        force.append(float(system.forces(x)[moved, 1].sum()))
    return SheetSteps(
        sheet.points_mm,
        np.array(place),
        linear_triangles(sheet.triangles()),
        np.array(corner),
        np.array(force),
    )


def linear_triangles(six_node: IntArray) -> IntArray:
    """(4 m, 3) triangles between the corners and mid-side nodes of six-node ones (m, 6)."""
    parts = [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]
    return np.concatenate([six_node[:, part] for part in parts])
