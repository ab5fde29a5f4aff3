"""A design's simulated pull beside a measured one: how far apart, and what would explain it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from kiribench.reference.tensile_causes import Cause, Diagnosis, Explanation, Observed, diagnose
from kiribench.reference.tensile_noise import Distance, distance_of, scatter_of
from kiribench.reference.tensile_sensitivities import (
    amounts_of,
    causes_of,
    difference,
    kinds_of,
    observed_of,
    residual_cells,
)
from kiribench.reference.tensile_simulation import (
    Amounts,
    Measured,
    Predicted,
    Response,
    Simulator,
    Specimen,
    load_steps,
    measured_part,
    predict,
)
from kiribench.reference.tensile_specimen import stated_specimen
from kiribench.reference.tensile_words import object_of, text_of, verdict_of
from kiribench.schema.patch_design import PatchDesign
from kiribench.strain.measures import strain_of
from kiribench.tensile.result import TensileTest

FloatArray = npt.NDArray[np.float64]

COARSER = 1.6
"""The effects of causes, and the error of the mesh, are from edges this many times as long."""
MOST_FRAMES = 40
"""Frames that are diagnosed, evenly over the strain; more say little that is new."""


@dataclass(frozen=True)
class TensileOptions:
    """How a comparison is done.

    Attributes:
        specimen: what is believed to be pulled.
        strain_measure: of the curves; the causes are fitted in log strain.
        min_strain: frames below this mean log strain are left out.
        draws_seed: of the draws that calibrate misfits.
        explain: whether causes are looked for (some five further simulations).
    """

    specimen: Specimen = field(default_factory=Specimen)
    strain_measure: str = "log"
    min_strain: float = 0.02
    draws_seed: int = 0
    explain: bool = True


@dataclass(frozen=True, eq=False)
class TensileComparison:
    """Simulation and measurement; T frames that are compared.

    Attributes:
        measure: of every strain and ratio here.
        frame: names of the frames.
        strain: (T,) mean longitudinal strain over the followed cells.
        poisson: (T,) measured Poisson's ratio: of the mean strains.
        poisson_cells_sd: (T,) standard deviation over cells; NaN for one cell.
        poisson_simulated: (T,) simulated at the same mean strain.
        difference, half_width: (T,) measured less simulated, and the half-width of its 95 %
            interval by the scatter of the cells.
        mesh_poisson: (T,) change by a mesh with edges 1.6 times as long.
        curve_strain, curve_poisson: (n,) the simulated curve.
        displacement_mm, strain_simulated: (T,) where the displacement is known, else None: the
            simulated mean strain at that displacement.
        force_n, force_simulated_n: (T,) or None.
        distance: of Poisson's ratio over the strain.
        distance_force: root mean square error of the force over the largest force, or None.
        diagnosis: what explains the difference, or None where it was not asked for.
        distance_explained: distance of a simulation with the causes that were found, or None.
        notes: what was assumed.
    """

    measure: str
    frame: tuple[str, ...]
    strain: FloatArray
    poisson: FloatArray
    poisson_cells_sd: FloatArray
    poisson_simulated: FloatArray
    difference: FloatArray
    half_width: FloatArray
    mesh_poisson: FloatArray
    curve_strain: FloatArray
    curve_poisson: FloatArray
    displacement_mm: FloatArray | None
    strain_simulated: FloatArray | None
    force_n: FloatArray | None
    force_simulated_n: FloatArray | None
    distance: Distance
    distance_force: float | None
    diagnosis: Diagnosis | None
    distance_explained: Distance | None
    notes: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """What explains the difference, in one sentence."""
        return verdict_of(self)

    @property
    def result(self) -> dict[str, Any]:
        """A JSON object."""
        return object_of(self)

    @property
    def text(self) -> str:
        """The same for a person; the last line is the verdict."""
        return text_of(self)


def compare_tensile(
    design: PatchDesign, test: TensileTest, *, options: TensileOptions | None = None
) -> TensileComparison:
    """Simulate the pull of a design and compare it with a measured one.

    Frames are matched by the mean longitudinal strain of the followed cells, so that the curve of
    Poisson's ratio needs no load data; displacement and force, where they are known, are compared
    as well and tell causes apart that leave that curve alone.

    Args:
        design: the cuts of the whole sample; rows along the pull.
        test: what the camera saw.
        options: None takes the specimen from the sidecars, see :func:`stated_specimen`.

    Raises:
        TableError: ``tensile-block-outside``, ``tensile-too-few-frames``, ``tensile-specimen``.
        NotConvergedError: the simulation does not reach the test's strains.
    """
    settings = options or TensileOptions(specimen=stated_specimen(design, test))
    specimen = settings.specimen
    measured = measured_part(design, test, specimen, settings.min_strain)
    steps = load_steps(design, specimen, measured)
    fine = Simulator(design, specimen, measured, steps)
    rough = Simulator(
        design, replace(specimen, mesh=specimen.mesh.scaled(COARSER)), measured, steps
    )
    response = fine.response()
    best = predict(response, measured)
    curves = _curves(measured, best, rough.predict(measured), settings.strain_measure)
    diagnosis = explained = None
    if settings.explain:
        chosen, kinds = _thinned(measured), kinds_of(specimen, measured)
        named = {kind.name: kind for kind in kinds}
        mesh = difference(chosen, fine.predict(chosen)) - difference(chosen, rough.predict(chosen))

        def again(found: Explanation) -> tuple[Observed, tuple[Cause, ...]]:
            at = amounts_of(found, kinds)
            causes = causes_of(rough, specimen, chosen, at, found.families)
            moved = np.zeros(len(mesh))
            for cause in causes:
                kind = named[cause.name]
                moved = moved + cause.effect * getattr(at, kind.field) * kind.scale
            return observed_of(chosen, fine.predict(chosen, at), mesh, test, moved), causes

        diagnosis = diagnose(
            observed_of(chosen, fine.predict(chosen), mesh, test, np.zeros(len(mesh))),
            causes_of(rough, specimen, chosen, Amounts()),
            seed=settings.draws_seed,
            again=again,
        )
        if diagnosis.kind in ("one", "together", "cannot-tell"):
            changed = fine.predict(measured, amounts_of(diagnosis.best, kinds))
            explained = _curves(measured, changed, changed, settings.strain_measure).distance
    dense = np.linspace(response.displacement_mm[1] * 0.2, response.displacement_mm[-1], 120)
    curve = _simulated_curve(response, dense, settings.strain_measure)
    return TensileComparison(
        measure=settings.strain_measure,
        frame=tuple(test.frame[t] for t in measured.frame),
        strain=curves.strain,
        poisson=curves.poisson,
        poisson_cells_sd=curves.cells_sd,
        poisson_simulated=curves.simulated,
        difference=curves.poisson - curves.simulated,
        half_width=curves.half_width,
        mesh_poisson=curves.mesh,
        curve_strain=curve[0],
        curve_poisson=curve[1],
        displacement_mm=measured.displacement_mm,
        strain_simulated=None
        if best.along_by_travel is None
        else strain_of(np.exp(measured.mean(best.along_by_travel)), settings.strain_measure),
        force_n=measured.force_n,
        force_simulated_n=None if measured.force_n is None else best.force_n,
        distance=curves.distance,
        distance_force=None
        if measured.force_n is None
        else float(
            np.sqrt(np.mean((measured.force_n - best.force_n) ** 2))
            / np.abs(measured.force_n).max()
        ),
        diagnosis=diagnosis,
        distance_explained=explained,
        notes=_notes(design, specimen, measured, response),
    )


def uniform_design(
    a: float, b: float, rows: int, columns: int, cell_mm: float, thickness_mm: float = 2.0
) -> PatchDesign:
    """A sheet of uniform cuts as a design; a and b are parts of the cell."""
    shape = (rows, columns)
    words = np.full(shape, "", dtype="<U64")
    return PatchDesign(
        "", "given", "", cell_mm, thickness_mm, "log", np.full(shape, a), np.full(shape, b),
        words, words.copy(),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Curves:
    strain: FloatArray
    poisson: FloatArray
    cells_sd: FloatArray
    simulated: FloatArray
    half_width: FloatArray
    mesh: FloatArray
    distance: Distance


def _curves(measured: Measured, best: Predicted, rough: Predicted, measure: str) -> _Curves:
    from scipy.stats import t as student

    cells = residual_cells(measured, best)
    along = strain_of(np.exp(measured.strain), measure)
    across = strain_of(np.exp(measured.mean(measured.across)), measure)
    # The state is that of the mean strain; the residual's mean is the difference across.
    predicted = measured.mean(measured.across) - measured.mean(cells)
    simulated = -strain_of(np.exp(predicted), measure) / along
    coarse = measured.mean(measured.across) - measured.mean(residual_cells(measured, rough))
    # d(strain)/d(log strain), for the scatter in another measure.
    rate = {"log": 1.0, "engineering": 1.0, "green": 2.0}[measure]
    scale = np.exp(rate * predicted) if measure != "log" else np.ones_like(predicted)
    per_nu = scale / along
    count = measured.seen.sum(axis=1)
    scatter = scatter_of(cells.T, (len(along),), np.nan)
    covariance = per_nu[:, None] * scatter.of_mean * per_nu[None, :]
    spread = np.array([np.nanstd(row, ddof=1) if n > 1 else np.nan for row, n in zip(
        measured.across / measured.along, count, strict=True)])  # fmt: skip
    quantile = student.ppf(0.975, np.maximum(count - 1, 1))
    return _Curves(
        along,
        -across / along,
        spread,
        simulated,
        quantile * np.sqrt(np.diag(covariance)),
        -strain_of(np.exp(coarse), measure) / along - simulated,
        distance_of(-across / along - simulated, covariance, along, scatter.freedom),
    )


def _simulated_curve(
    response: Response, displacements_mm: FloatArray, measure: str
) -> tuple[FloatArray, FloatArray]:
    from scipy.interpolate import CubicSpline

    along = CubicSpline(response.displacement_mm, response.along)(displacements_mm).mean(axis=1)
    across = CubicSpline(response.displacement_mm, response.across)(displacements_mm).mean(axis=1)
    strain = strain_of(np.exp(along), measure)
    return strain, -strain_of(np.exp(across), measure) / strain


def _thinned(measured: Measured) -> Measured:
    count = len(measured.frame)
    if count <= MOST_FRAMES:
        return measured
    kept = np.unique(np.linspace(0, count - 1, MOST_FRAMES).round().astype(int))
    return replace(
        measured,
        frame=measured.frame[kept],
        along=measured.along[kept],
        across=measured.across[kept],
        displacement_mm=None
        if measured.displacement_mm is None
        else measured.displacement_mm[kept],
        force_n=None if measured.force_n is None else measured.force_n[kept],
    )


def _notes(
    design: PatchDesign, specimen: Specimen, measured: Measured, response: Response
) -> tuple[str, ...]:
    rows, columns = design.shape
    stated = specimen.row is not None or specimen.column is not None
    placed = "lies where it was stated in" if stated else "is taken to lie in the middle of"
    notes = [
        f"The followed block {placed} the {rows} x {columns} cells: rows "
        f"{measured.row.min()} to {measured.row.max()}, columns {measured.col.min()} to "
        f"{measured.col.max()}.",
        f"Simulated as {specimen.material} with {specimen.ends} ends and uncut bands of "
        f"{specimen.grip_mm:g} mm; plane stress, flat.",
        "Cells are taken as independent repeats. What all cells share (lens, a sample that "
        "bulges towards the camera, buckling) is not in the intervals and is no cause here.",
    ]
    if response.face_overlap_mm > 0.1:
        notes.append(
            f"Crack faces interpenetrate by up to {response.face_overlap_mm:.2f} mm in the "
            "simulation: contact is not modelled."
        )
    if measured.displacement_mm is None:
        notes.append("No displacement: slip in the grips cannot be seen.")
    if measured.force_n is None:
        notes.append("No force: the material's stiffness cannot be seen.")
    return tuple(notes)
