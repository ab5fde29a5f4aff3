"""The periodic cell: one facet stands for an infinite sheet, by mirror symmetry."""

from __future__ import annotations

import numpy.typing as npt

from kiribench.fem.loadpath import LoadPath
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import MeshSpec


def simulate_cell(
    a: float,
    b: float,
    longitudinal_stretches: npt.ArrayLike,
    *,
    cell_mm: float = 10.0,
    mesh: MeshSpec | None = None,
    material: Material | None = None,
    estimate_error: bool = True,
) -> LoadPath:
    """Stretch the periodic cell of a uniform cut map; lateral contraction is free.

    Args:
        a, b: cut lengths as fractions of the cell, across and along the pull, 0 < a, b < 1.
        longitudinal_stretches: (n,) increasing (or decreasing) from 1, length ratios.
        mesh: None is ``MeshSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.
        estimate_error: also solve on ``mesh.coarser()`` for ``mesh_error_poisson``.
    """
    raise NotImplementedError
