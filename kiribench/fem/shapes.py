"""The deformed outlines of a sheet's facets, to be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import Failed, LoadStepper
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import NeoHookean
from kiribench.fem.mesh import SheetMesh
from kiribench.fem.sheet import SheetSpec, quarter_equations, quarter_mesh

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SheetShape:
    """A whole sheet at one displacement, facet by facet.

    Attributes:
        displacement_mm: of the pulled end against the fixed one.
        outlines_mm: one (k, 2) closed walk a facet, x across from the middle, y along from the
            fixed end, mm; the gaps between them are open cuts.
    """

    displacement_mm: float
    outlines_mm: tuple[FloatArray, ...]


def sheet_shapes(
    a: float,
    b: float,
    displacements_mm: tuple[float, ...],
    *,
    sheet: SheetSpec | None = None,
    mesh: MeshSpec | None = None,
) -> tuple[SheetShape, ...]:
    """Shapes of a sheet of uniform cuts at growing displacements, as far as they are reached.

    Args:
        a, b: cut lengths as fractions of the cell, across and along the pull.
        displacements_mm: growing; 0 is the sheet at rest.
        sheet: None is the paper's.
        mesh: None is a coarse one, good for drawings.
    """
    specimen = sheet or SheetSpec()
    quarter = quarter_mesh(a, b, specimen, mesh or MeshSpec(1.0, 1.0, 0.6))
    equation, pattern, _ = quarter_equations(quarter)
    stepper = LoadStepper(CondensedSystem(quarter, equation, NeoHookean()), pattern)
    walks = _walks(quarter)
    shapes = []
    for displacement in displacements_mm:
        x = quarter.points_mm
        if displacement != 0:
            solved = stepper.advance(displacement / 2)
            if isinstance(solved, Failed):
                break
            x = solved.x
        shapes.append(SheetShape(displacement, _whole(x, walks)))
    return tuple(shapes)


def _walks(mesh: SheetMesh) -> list[IntArray]:
    """The nodes around every facet of the quarter."""
    walks = []
    for block in mesh.blocks:
        around = np.concatenate([edge[:-1] for edge in block.template.edges])
        walks += list(block.nodes[:, around])
    return walks


def _whole(x: FloatArray, walks: list[IntArray]) -> tuple[FloatArray, ...]:
    """The quarter and its three mirror images, the fixed end at y = 0."""
    half = float(x[:, 1].max())
    return tuple(
        x[walk] * np.array([across, along]) + np.array([0.0, half])
        for across in (1.0, -1.0)
        for along in (1.0, -1.0)
        for walk in walks
    )
