"""A design judged by simulation: every cell's stretches, its overlap, and what the mesh adds.

The same worn model serves both surfaces: the subject's flexed skin (`worn`), and the skin laid
flat or a plain pull (`flat`). Positions that the patch is to take are nodes of the surface, so
overlaps, grades, regions and causes come from the code that scores a worn patch.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.result import Conformability
from kiribench.conformability.score import ScoreOptions
from kiribench.errors import NotConvergedError, UsageError
from kiribench.fem.material import Material
from kiribench.fem.wear import WearSpec, WornPatch, wear_patch
from kiribench.fem.wear_contact import weight_mpa
from kiribench.fem.wear_measures import cell_measures
from kiribench.lattice import CutMap
from kiribench.reference.ground import Ground
from kiribench.schema.patch_design import PatchDesign
from kiribench.strain.measures import strain_of, stretch_of

FloatArray = NDArray[np.float64]

#: The mesh that the mesh error is judged by has about so many elements less.
COARSER = 0.6


@dataclass(frozen=True)
class CheckOptions:
    """How a design is checked.

    Attributes:
        elements: elements a facet edge of the reported mesh.
        spec: how the patch is put on (friction, straps, offsets); its mesh is replaced.
        score: of the overlap.
    """

    elements: int = 10
    spec: WearSpec = field(default_factory=WearSpec)
    score: ScoreOptions = field(default_factory=ScoreOptions)

    @property
    def coarser(self) -> int:
        """Elements of the mesh that the mesh error is judged by: even, as the mesh wants."""
        return max(6, 2 * round(COARSER * self.elements / 2))


@dataclass(frozen=True, eq=False)
class CheckedDesign:
    """What a design is predicted to do; cell arrays are (R, C).

    Attributes:
        design: as given. ground: what it was put on. options: how.
        worn: at ``options.elements``; coarse: at ``options.coarser``, None if both are one.
        conformability: of ``worn``.
        mesh_shift_mm: (R+1, C+1) distance of the corners between the two meshes, in q.
        mesh_overlap: (R, C) estimate of the error of the graded overlap by the mesh: its change
            when the corners are extrapolated from the two meshes (first order in the mesh,
            which is the slowest that it converges).
        target_longitudinal, target_lateral: stretches asked for: of the table, else of the skin.
        target_source: ``design`` or ``skin``.
        cpu_seconds: of all.
    """

    design: PatchDesign
    ground: Ground
    options: CheckOptions
    worn: WornPatch
    coarse: WornPatch | None
    conformability: Conformability
    mesh_shift_mm: FloatArray
    mesh_overlap: FloatArray
    target_longitudinal: FloatArray
    target_lateral: FloatArray
    target_source: str
    cpu_seconds: float

    @property
    def longitudinal_strain(self) -> FloatArray:
        """(R, C) in the design's measure."""
        return strain_of(self.worn.longitudinal_stretch, self.design.strain_measure)

    @property
    def poisson_ratio(self) -> FloatArray:
        """(R, C) in the design's measure; NaN where the strain is below ``LEAST_STRAIN``."""
        return _poisson(
            self.worn.longitudinal_stretch, self.worn.lateral_stretch, self.design.strain_measure
        )

    @property
    def target_poisson(self) -> FloatArray:
        """(R, C) asked for, in the design's measure."""
        return _poisson(self.target_longitudinal, self.target_lateral, self.design.strain_measure)

    @property
    def strain_error(self) -> FloatArray:
        """(R, C) longitudinal strain minus target."""
        wanted = strain_of(self.target_longitudinal, self.design.strain_measure)
        return np.asarray(self.longitudinal_strain - wanted)

    @property
    def poisson_error(self) -> FloatArray:
        """(R, C) Poisson's ratio minus target."""
        return np.asarray(self.poisson_ratio - self.target_poisson)

    @property
    def lift_off(self) -> NDArray[np.bool_]:
        """(2R, 2C) facets on which the skin would have to pull, by more than they weigh."""
        return np.asarray(self.worn.contact_pressure_mpa < -weight_mpa(self.design.thickness_mm))

    @property
    def overlapping_mm(self) -> FloatArray:
        """(R, C) largest depth to which cut faces of the cell pass through others."""
        rows, columns = self.design.shape
        return np.asarray(self.worn.facet_overlap_mm.reshape(rows, 2, columns, 2).max(axis=(1, 3)))


#: Below this strain a ratio of strains says nothing.
LEAST_STRAIN = 0.03


def _poisson(longitudinal: FloatArray, lateral: FloatArray, measure: str) -> FloatArray:
    along, across = strain_of(longitudinal, measure), strain_of(lateral, measure)
    enough = np.abs(along) >= LEAST_STRAIN
    return np.where(enough, -across / np.where(enough, along, 1.0), np.nan)


def check_design(
    design: PatchDesign,
    ground: Ground,
    options: CheckOptions | None = None,
    material: Material | None = None,
) -> CheckedDesign:
    """Put a design on and judge it.

    Raises:
        UsageError: ``check-shape``; design and layout have not the same cells.
        NotConvergedError: ``check-not-converged``; with the reason.
    """
    options = options or CheckOptions()
    began = time.process_time()
    target = ground.target_q_mm
    if target.shape[:2] != (design.shape[0] + 1, design.shape[1] + 1):
        raise UsageError(
            "check-shape",
            "The design and the subject's patch have not the same rows and columns.",
            remedy="Check the design with the subject (and the layout) that it was made for.",
            got=f"design {design.shape[0]} x {design.shape[1]}",
            expected=f"{target.shape[0] - 1} x {target.shape[1] - 1}",
        )
    pitch = float(np.linalg.norm(target[0, 1] - target[0, 0]))
    if abs(pitch - design.cell_mm) > 1e-6 * pitch:
        raise UsageError(
            "check-cell",
            "The design's cells and the drawn grid's have not the same size.",
            remedy="Draw the grid with the pitch of the cells, or design for it.",
            got=f"cells of {design.cell_mm:g} mm",
            expected=f"{pitch:g} mm",
        )
    worn = put_on(design, ground, options, options.elements, material)
    coarse = None
    if options.coarser != options.elements:
        coarse = put_on(design, ground, options, options.coarser, material)
    score = ground.score(worn.corner_q_mm, design, options.score)
    shift = np.zeros(target.shape[:2])
    error = np.zeros(design.shape)
    if coarse is not None:
        apart = worn.corner_q_mm - coarse.corner_q_mm
        shift = np.linalg.norm(apart, axis=-1)
        onward = options.coarser / (options.elements - options.coarser)
        limit = ground.score(worn.corner_q_mm + onward * apart, design, options.score)
        error = np.abs(score.overlap - limit.overlap)
    longitudinal, lateral, source = targets_of(design, ground)
    return CheckedDesign(
        design=design,
        ground=ground,
        options=options,
        worn=worn,
        coarse=coarse,
        conformability=score,
        mesh_shift_mm=shift,
        mesh_overlap=error,
        target_longitudinal=longitudinal,
        target_lateral=lateral,
        target_source=source,
        cpu_seconds=time.process_time() - began,
    )


def put_on(
    design: PatchDesign,
    ground: Ground,
    options: CheckOptions,
    elements: int,
    material: Material | None = None,
    **pose: Any,
) -> WornPatch:
    """The design in equilibrium; ``pose`` overrides fields of the spec.

    Raises:
        NotConvergedError: ``check-not-converged``.
    """
    spec = replace(
        options.spec, elements_per_facet=elements, thickness_mm=design.thickness_mm, **pose
    )
    cut_map = CutMap(design.a, design.b, design.cell_mm)
    slides = 0 < spec.friction < np.inf
    path = ground.path if slides else None
    worn = wear_patch(
        cut_map, ground.surface, ground.origin_q_mm, spec, material, rest=ground.rest, path=path
    )
    if worn.status != "ok":
        raise NotConvergedError(
            "check-not-converged",
            f"The patch of the design '{design.method}', {ground.kind}, has no equilibrium: "
            f"{worn.reason}.",
            remedy="Try another mesh (--elements-per-facet) or shorter cuts."
            if ground.kind == "worn"
            else "Look for targets that no neighbours can follow together; --pull RATIO pulls the "
            "patch evenly instead. Or try another mesh (--elements-per-facet) or shorter cuts.",
            file=design.file,
        )
    return worn


def targets_of(design: PatchDesign, ground: Ground) -> tuple[FloatArray, FloatArray, str]:
    """Stretches asked for (longitudinal, lateral), and where they come from.

    The design table's strain and Poisson's ratio; a table without any is judged by what the
    skin does: the lengths of the cells' edges on the surface.
    """
    strain = design.quantity("target_longitudinal_strain")
    nu = design.quantity("target_poisson_ratio")
    if np.isfinite(strain).any():
        return (
            stretch_of(strain, design.strain_measure),
            stretch_of(-nu * strain, design.strain_measure),
            "design",
        )
    cells = cell_measures(ground.surface, ground.target_q_mm, design.cell_mm)
    return cells.longitudinal_stretch, cells.lateral_stretch, "skin"
