"""The periodic cell: one facet stands for an infinite sheet, by mirror symmetry.

Every lattice line of a uniform cut map is a mirror line, so a ligament on it keeps to it and a
cut face on it is free. The lines along the pull move together: no force acts across.
"""

from __future__ import annotations

import time
from dataclasses import fields, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from kiribench.fem.assembly import AssembledSystem
from kiribench.fem.equilibrium import MOST_WORK, LoadStepper
from kiribench.fem.loadpath import LoadPath
from kiribench.fem.material import Material, NeoHookean
from kiribench.fem.mesh import FacetGrid, MeshSpec, SheetMesh, mesh_sheet
from kiribench.fem.recorder import Recorder, State, with_mesh_error

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


CELL_MESH = MeshSpec().scaled(0.5)
"""The mesh of a periodic cell unless told otherwise."""


def simulate_cell(
    a: float,
    b: float,
    longitudinal_stretches: npt.ArrayLike,
    *,
    cell_mm: float = 10.0,
    mesh: MeshSpec | None = None,
    material: Material | None = None,
    estimate_error: bool = True,
    most_work: int = MOST_WORK,
) -> LoadPath:
    """Stretch the periodic cell of a uniform cut map; lateral contraction is free.

    Args:
        a, b: cut lengths as fractions of the cell, across and along the pull, 0 <= a, b < 1.
        longitudinal_stretches: (n,) monotonic, away from 1, length ratios.
        cell_mm: cell edge, mm.
        mesh: None is ``CELL_MESH``, twice as fine as the default of a sheet.
        material: None is the paper's ``NeoHookean(0.207)``.
        estimate_error: also solve on a mesh twice as coarse, for ``mesh_error_poisson``.
        most_work: Newton iterations after which a path ends, not converged.
    """
    began = time.process_time()
    spec = mesh or CELL_MESH
    law = material or NeoHookean()
    stretches = np.atleast_1d(np.asarray(longitudinal_stretches, dtype=np.float64))
    path = _follow(a, b, stretches, cell_mm, spec, law, most_work)
    coarse = None
    if estimate_error:
        coarse = _follow(a, b, stretches[path.converged], cell_mm, spec.scaled(2.0), law, most_work)
    return with_mesh_error(path, _part(path), coarse, time.process_time() - began)


def _part(path: LoadPath) -> LoadPath:
    """The converged steps alone."""
    kept = path.converged
    columns = {
        field.name: getattr(path, field.name)[kept]
        for field in fields(path)
        if isinstance(getattr(path, field.name), np.ndarray)
    }
    return replace(path, **columns, status=("ok",) * int(kept.sum()), reason=None)


def cell_mesh(a: float, b: float, cell_mm: float, spec: MeshSpec) -> SheetMesh:
    """The facet that stands for the periodic cell, in [0, cell/2] x [0, cell/2]."""
    line = np.array([0.0, cell_mm / 2])
    cuts = np.array([[[a, b, a, b]]])
    return mesh_sheet(FacetGrid(cuts, np.array([[False]]), line, line), spec)


def cell_equations(mesh: SheetMesh) -> tuple[IntArray, FloatArray, dict[str, IntArray]]:
    """Equations (n, 2), displacement (n, 2) per unit stretch, and the ligaments by side.

    The right ligament's displacement across is one unknown, the last.
    """
    sides = {
        side: mesh.boundary_nodes(side, ligaments_only=True)
        for side in ("left", "right", "bottom", "top")
    }
    equation = np.zeros(mesh.points_mm.shape, dtype=np.int64)
    equation[sides["bottom"], 1] = -1
    equation[sides["top"], 1] = -1
    equation[sides["left"], 0] = -1
    equation[sides["right"], 0] = -2
    free = equation == 0
    equation[free] = np.arange(free.sum())
    equation[equation == -2] = free.sum()
    pattern = np.zeros_like(mesh.points_mm)
    pattern[sides["top"], 1] = mesh.y_mm[-1]
    return equation, pattern, sides


def _follow(
    a: float,
    b: float,
    stretches: FloatArray,
    cell_mm: float,
    spec: MeshSpec,
    law: Material,
    most_work: int = MOST_WORK,
) -> LoadPath:
    mesh = cell_mesh(a, b, cell_mm, spec)
    equation, pattern, sides = cell_equations(mesh)
    system = AssembledSystem(mesh.points_mm, mesh.triangles(), equation, law)
    stepper = LoadStepper(system, pattern, most_work=most_work)
    half = cell_mm / 2
    below, above = (
        mesh.boundary_nodes("bottom", ligaments_only=False),
        mesh.boundary_nodes("top", ligaments_only=False),
    )
    before, behind = (
        mesh.boundary_nodes("left", ligaments_only=False),
        mesh.boundary_nodes("right", ligaments_only=False),
    )

    def read(stretch: float, x: FloatArray) -> State:
        width = float(x[sides["right"][0], 0])
        depth = max(
            0.0,
            -float(x[below, 1].min()),
            float(x[above, 1].max()) - stretch * half,
            -float(x[before, 0].min()),
            float(x[behind, 0].max()) - width,
        )
        pull = float(system.forces(x)[sides["top"], 1].sum())
        return State(
            displacement_mm=(stretch - 1) * cell_mm,
            longitudinal_stretch=stretch,
            lateral_stretch=width / half,
            nominal_stress_mpa=pull / half,
            energy_mpa=system.energy(x) / system.area_mm2,
            face_overlap_mm=2 * depth,
        )

    recorder = Recorder(len(stretches), system.size)
    for stretch in stretches:
        if not recorder.record(stepper.advance(float(stretch) - 1), partial(read, float(stretch))):
            break
    return recorder.path()
