"""The tensile sheet: uniform cuts between two grips, a quarter of it by symmetry."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from kiribench.errors import DataError
from kiribench.fem.cell import simulate_cell
from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import MOST_WORK, LoadStepper
from kiribench.fem.gauge import FacePairs, cell_stretches, site_positions
from kiribench.fem.loadpath import LoadPath
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import FacetGrid, MeshSpec, SheetMesh, mesh_sheet
from kiribench.fem.recorder import Recorder, State, with_mesh_error
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class SheetSpec:
    """The tensile specimen: the paper's 220 x 120 mm sheet of 18 x 12 cells by default.

    Attributes:
        rows, columns: cells along and across the pull; even numbers.
        cell_mm: cell edge, mm.
        grip_mm: uncut band at either end, mm; its outer edge is held in both directions.

    Raises:
        DataError: odd or too few cells, or lengths that are not positive.
    """

    rows: int = 18
    columns: int = 12
    cell_mm: float = 10.0
    grip_mm: float = 20.0

    def __post_init__(self) -> None:
        even = self.rows % 2 == 0 and self.columns % 2 == 0
        if not even or min(self.rows, self.columns) < 2 or self.cell_mm <= 0 or self.grip_mm < 0:
            raise DataError(
                "sheet-shape",
                "The quarter model needs even numbers of rows and columns and positive lengths.",
                remedy="Give at least 2 x 2 cells, both numbers even.",
                got=f"{self.rows} x {self.columns} cells of {self.cell_mm} mm",
            )


def simulate_sheet(
    a: float,
    b: float,
    displacements_mm: npt.ArrayLike,
    *,
    sheet: SheetSpec | None = None,
    mesh: MeshSpec | None = None,
    material: Material | None = None,
    estimate_error: bool = True,
    most_work: int = MOST_WORK,
) -> LoadPath:
    """Pull a sheet of uniform cuts; the middle four cells are the gauge.

    Args:
        a, b: cut lengths as fractions of the cell, across and along the pull, 0 <= a, b < 1.
        displacements_mm: (n,) of the moving end against the fixed one, monotonic from 0, mm.
        sheet: None is ``SheetSpec()``.
        mesh: None is ``MeshSpec()``.
        material: None is the paper's ``NeoHookean(0.207)``.
        estimate_error: fill ``mesh_error_poisson`` from the periodic cell at the gauge's
            longitudinal stretches: on the sheet's facet mesh against one 2.5 times as fine.
        most_work: Newton iterations after which the path ends, not converged.
    """
    began = time.process_time()
    specimen = sheet or SheetSpec()
    spec = mesh or MeshSpec()
    law = material or NeoHookean()
    displacements = np.atleast_1d(np.asarray(displacements_mm, dtype=np.float64))
    path = _follow(a, b, displacements, specimen, spec, law, most_work)
    same = finer = None
    if estimate_error:
        gauge = path.longitudinal_stretch[path.converged]
        same, finer = (
            simulate_cell(
                a,
                b,
                gauge,
                cell_mm=specimen.cell_mm,
                mesh=facet_mesh,
                material=law,
                estimate_error=False,
            )
            for facet_mesh in (spec, spec.scaled(0.4))
        )
    return with_mesh_error(path, same, finer, time.process_time() - began)


def quarter_mesh(a: float, b: float, sheet: SheetSpec, spec: MeshSpec) -> SheetMesh:
    """The quarter of the sheet at x >= 0, y >= 0 from its middle; the held end is its top."""
    cuts, mirrored = CutMap.uniform(
        a, b, sheet.rows, sheet.columns, sheet.cell_mm
    ).facet_half_cuts()
    cuts = cuts[sheet.rows :, sheet.columns :]
    half = sheet.cell_mm / 2
    bands = max(1, round(sheet.grip_mm / half)) if sheet.grip_mm > 0 else 0
    cuts = np.concatenate([cuts, np.zeros((bands, sheet.columns, 4))])
    parity = np.arange(sheet.rows + bands)[:, None] + np.arange(sheet.columns)[None, :]
    mirrored = (parity + sheet.rows + sheet.columns) % 2 == 1
    y = half * np.arange(sheet.rows + 1)
    band = y[-1] + sheet.grip_mm * np.arange(1, bands + 1) / max(bands, 1)
    return mesh_sheet(
        FacetGrid(
            cuts,
            mirrored,
            half * np.arange(sheet.columns + 1, dtype=np.float64),
            np.concatenate([y, band]),
        ),
        spec,
    )


def quarter_equations(mesh: SheetMesh) -> tuple[IntArray, FloatArray, IntArray]:
    """Equations (n, 2), displacement (n, 2) per mm of the held end, and its nodes."""
    equation = np.zeros(mesh.points_mm.shape, dtype=np.int64)
    equation[mesh.boundary_nodes("left", ligaments_only=True), 0] = -1
    equation[mesh.boundary_nodes("bottom", ligaments_only=True), 1] = -1
    held = mesh.boundary_nodes("top", ligaments_only=False)
    equation[held] = -1
    free = equation == 0
    equation[free] = np.arange(free.sum())
    pattern = np.zeros_like(mesh.points_mm)
    pattern[held, 1] = 1.0
    return equation, pattern, held


def _follow(
    a: float,
    b: float,
    displacements: FloatArray,
    sheet: SheetSpec,
    spec: MeshSpec,
    law: Material,
    most_work: int = MOST_WORK,
) -> LoadPath:
    mesh = quarter_mesh(a, b, sheet, spec)
    equation, pattern, held = quarter_equations(mesh)
    system = CondensedSystem(mesh, equation, law)
    stepper = LoadStepper(system, pattern, most_work=most_work)
    pairs = FacePairs.of(mesh)
    left = mesh.boundary_nodes("left", ligaments_only=False)
    bottom = mesh.boundary_nodes("bottom", ligaments_only=False)

    def read(displacement: float, x: FloatArray) -> State:
        corners = site_positions(mesh, x)[:3:2, :3:2]
        # The other face of a cut on a mirror line is the mirror image.
        corners[:, 0, 0] = 0.0
        corners[0, :, 1] = 0.0
        gauge = cell_stretches(corners, sheet.cell_mm)
        mirror = max(0.0, -2 * float(x[left, 0].min()), -2 * float(x[bottom, 1].min()))
        return State(
            displacement_mm=displacement,
            longitudinal_stretch=float(gauge.longitudinal.mean()),
            lateral_stretch=float(gauge.lateral.mean()),
            nominal_stress_mpa=float(system.forces(x)[held, 1].sum()) / float(mesh.x_mm[-1]),
            energy_mpa=system.energy(x) / system.area_mm2,
            face_overlap_mm=max(mirror, pairs.overlap_mm(x)),
        )

    recorder = Recorder(len(displacements), system.size)
    for displacement in displacements:
        at = float(displacement)
        if not recorder.record(stepper.advance(at / 2), partial(read, at)):
            break
    return recorder.path()
