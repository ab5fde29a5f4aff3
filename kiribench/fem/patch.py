"""Any patch: a heterogeneous cut map with free edges, pulled at its two ends."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.fem.assembly import AssembledSystem
from kiribench.fem.batches import LANES
from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import LoadStepper
from kiribench.fem.facet import MeshSpec
from kiribench.fem.gauge import FacePairs, cell_stretches, site_positions
from kiribench.fem.loadpath import LoadPath
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import FacetGrid, SheetMesh, mesh_sheet
from kiribench.fem.recorder import Recorder, State, with_mesh_error
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Ends = Literal["held", "sliding"]


@dataclass(frozen=True, eq=False)
class PatchPath:
    """What a patch and each of its cells do at n load steps.

    Attributes:
        path: the patch as a whole; its stretches are the means over all cells.
        longitudinal_stretch, lateral_stretch: (n, R, C) length ratios of the cells, from both
            faces of every corner; NaN where the step was not reached.
        site_mm: (n, 2R + 1, 2C + 1, 2) deformed lattice sites, x across and y along, mm.
    """

    path: LoadPath
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    site_mm: FloatArray


def patch_mesh(cut_map: CutMap, spec: MeshSpec, *, grip_mm: float = 0.0) -> SheetMesh:
    """The whole patch, with an uncut band of ``grip_mm`` at either end; y from the lower band."""
    cuts, mirrored = cut_map.facet_half_cuts()
    half = cut_map.cell_mm / 2
    rows, columns = mirrored.shape
    bands = max(1, round(grip_mm / half)) if grip_mm > 0 else 0
    uncut = np.zeros((bands, columns, 4))
    parity = np.arange(-bands, rows + bands)[:, None] + np.arange(columns)[None, :]
    band = grip_mm * np.arange(bands) / max(bands, 1)
    y = grip_mm + half * np.arange(rows + 1)
    far = y[-1] + grip_mm - band[::-1]
    grid = FacetGrid(
        np.concatenate([uncut, cuts, uncut]),
        parity % 2 == 1,
        half * np.arange(columns + 1, dtype=np.float64),
        np.concatenate([band, y, far]),
    )
    return mesh_sheet(grid, spec)


def simulate_patch(
    cut_map: CutMap,
    displacements_mm: npt.ArrayLike,
    *,
    grip_mm: float = 0.0,
    ends: Ends = "held",
    mesh: MeshSpec | None = None,
    material: Material | None = None,
) -> PatchPath:
    """Pull a patch of any cut map along its rows; its long edges are free.

    Args:
        cut_map: the design.
        displacements_mm: (n,) of the distal end against the proximal one, monotonic from 0.
        grip_mm: uncut band beyond the cells at either end, mm.
        ends: ``"held"``: the outer edges of the bands keep their width, ``"sliding"``: they are
            free to narrow (one node is held against drifting).
        mesh: None is ``MeshSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.
    """
    began = time.process_time()
    displacements = np.atleast_1d(np.asarray(displacements_mm, dtype=np.float64))
    sheet = patch_mesh(cut_map, mesh or MeshSpec(), grip_mm=grip_mm)
    fixed = sheet.boundary_nodes("bottom", ligaments_only=False)
    moved = sheet.boundary_nodes("top", ligaments_only=False)
    equation = np.zeros(sheet.points_mm.shape, dtype=np.int64)
    equation[fixed, 1] = equation[moved, 1] = -1
    if ends == "held":
        equation[fixed, 0] = equation[moved, 0] = -1
    else:
        equation[fixed[0], 0] = -1
    free = equation == 0
    equation[free] = np.arange(free.sum())
    pattern = np.zeros_like(sheet.points_mm)
    pattern[moved, 1] = 1.0

    facets = sum(len(block.nodes) for block in sheet.blocks)
    system: AssembledSystem | CondensedSystem
    # Facets of one kind are eliminated in batches; facets that all differ are not.
    if facets >= LANES // 2 * len(sheet.blocks):
        system = CondensedSystem(sheet, equation, material or NeoHookean())
    else:
        system = AssembledSystem(
            sheet.points_mm, sheet.triangles(), equation, material or NeoHookean()
        )
    pairs = FacePairs.of(sheet)
    bands = (len(sheet.y_mm) - 1 - 2 * cut_map.rows) // 2
    shape = (len(displacements), cut_map.rows, cut_map.columns)
    along, across = np.full(shape, np.nan), np.full(shape, np.nan)
    sites = np.full((len(displacements), 2 * cut_map.rows + 1, 2 * cut_map.columns + 1, 2), np.nan)

    def read(step: int, x: FloatArray) -> State:
        inner = site_positions(sheet, x)[bands : bands + 2 * cut_map.rows + 1]
        cells = cell_stretches(inner[::2, ::2], cut_map.cell_mm)
        sites[step], along[step], across[step] = inner, cells.longitudinal, cells.lateral
        pull = float(system.forces(x)[moved, 1].sum())
        return State(
            displacement_mm=float(displacements[step]),
            longitudinal_stretch=float(cells.longitudinal.mean()),
            lateral_stretch=float(cells.lateral.mean()),
            nominal_stress_mpa=pull / float(sheet.x_mm[-1]),
            energy_mpa=system.energy(x) / system.area_mm2,
            face_overlap_mm=pairs.overlap_mm(x),
        )

    stepper = LoadStepper(system, pattern)
    recorder = Recorder(len(displacements), system.size)
    for step, displacement in enumerate(displacements):
        if not recorder.record(stepper.advance(float(displacement)), partial(read, step)):
            break
    path = with_mesh_error(recorder.path(), None, None, time.process_time() - began)
    return PatchPath(path, along, across, sites)
