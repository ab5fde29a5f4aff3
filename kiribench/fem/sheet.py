"""The tensile sheet: uniform cuts between two grips, a quarter of it by symmetry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy.typing as npt

from kiribench.fem.loadpath import LoadPath
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import MeshSpec


@dataclass(frozen=True)
class SheetSpec:
    """The tensile specimen: the paper's 220 x 120 mm sheet of 18 x 12 cells by default.

    Attributes:
        rows, columns: cells along and across the pull; even numbers.
        cell_mm: cell edge, mm.
        grip_mm: uncut band at either end, mm; its outer edge is held in both directions.
    """

    rows: int = 18
    columns: int = 12
    cell_mm: float = 10.0
    grip_mm: float = 20.0


def simulate_sheet(
    a: float,
    b: float,
    displacements_mm: npt.ArrayLike,
    *,
    sheet: SheetSpec | None = None,
    mesh: MeshSpec | None = None,
    material: Material | None = None,
    estimate_error: bool = True,
) -> LoadPath:
    """Pull a sheet of uniform cuts; the middle four cells are the gauge.

    Args:
        a, b: cut lengths as fractions of the cell, across and along the pull, 0 < a, b < 1.
        displacements_mm: (n,) of the moving end against the fixed one, increasing from 0, mm.
        sheet: None is ``SheetSpec()``.
        mesh: None is ``MeshSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.
        estimate_error: fill ``mesh_error_poisson``.
    """
    raise NotImplementedError
