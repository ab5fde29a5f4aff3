"""A design's simulated pull beside a measured one: how far apart, and what would explain it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from kiribench.reference.tensile_causes import Cause, Diagnosis, Explanation, Observed, diagnose
from kiribench.reference.tensile_noise import Distance, distance_of, scatter_of
from kiribench.reference.tensile_simulation import (
    Measured,
    Predicted,
    Response,
    Specimen,
    load_steps,
    measured_part,
    other_exponent,
    predict,
    respond,
    with_longer_cuts,
)
from kiribench.schema.patch_design import PatchDesign
from kiribench.strain.measures import strain_of
from kiribench.tensile.result import TensileTest

FloatArray = npt.NDArray[np.float64]

COARSER = 1.6
"""The effects of causes, and the error of the mesh, are from edges this many times as long."""
MOST_FRAMES = 40
"""Frames that are diagnosed, evenly over the strain; more say little that is new."""
CUT_STEP = 0.01
"""Change of the cut lengths (cells) for the finite differences."""
EXPONENT_STEP = 0.6
SLIP_STEP = 0.01
SLACK_STEP_MM = 0.2
FORCE_FLOOR = 0.003
"""Part of the largest force: what a load cell is trusted to."""


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
        return _verdict(self)

    @property
    def result(self) -> dict[str, Any]:
        """A JSON object."""
        return _object(self)

    @property
    def text(self) -> str:
        """The same for a person; the last line is the verdict."""
        return _text(self)


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
        options: None is ``TensileOptions()``.

    Raises:
        TableError: ``tensile-block-outside``, ``tensile-too-few-frames``.
        NotConvergedError: the simulation does not reach the test's strains.
    """
    settings = options or TensileOptions()
    specimen = settings.specimen
    measured = measured_part(design, test, specimen, settings.min_strain)
    steps = load_steps(design, specimen, measured)
    coarse_specimen = replace(specimen, mesh=specimen.mesh.scaled(COARSER))
    response = respond(design, specimen, measured, steps)
    coarse = respond(design, coarse_specimen, measured, steps)
    best, rough = predict(response, measured), predict(coarse, measured)
    curves = _curves(measured, best, rough, settings.strain_measure)
    diagnosis = explained = None
    if settings.explain:
        chosen = _thinned(measured)
        causes = _causes(design, coarse_specimen, chosen, steps, coarse)
        observed = _observed(chosen, predict(response, chosen), predict(coarse, chosen), test)
        diagnosis = diagnose(observed, causes, seed=settings.draws_seed)
        if diagnosis.kind in ("one", "together", "cannot-tell"):
            explained = _with_causes(design, specimen, measured, steps, diagnosis.best)
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


def _residual_cells(measured: Measured, predicted: Predicted) -> FloatArray:
    """(T, k) log strain across, measured less simulated at the cell's own strain along."""
    away = measured.along - predicted.along
    return np.asarray(measured.across - predicted.across - predicted.slope * away)


def _curves(measured: Measured, best: Predicted, rough: Predicted, measure: str) -> _Curves:
    from scipy.stats import t as student

    cells = _residual_cells(measured, best)
    along = strain_of(np.exp(measured.strain), measure)
    across = strain_of(np.exp(measured.mean(measured.across)), measure)
    # The state is that of the mean strain; the residual's mean is the difference across.
    predicted = measured.mean(measured.across) - measured.mean(cells)
    simulated = -strain_of(np.exp(predicted), measure) / along
    coarse = measured.mean(measured.across) - measured.mean(_residual_cells(measured, rough))
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
        distance_of(-across / along - simulated, covariance, along),
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


def _vector(measured: Measured, predicted: Predicted) -> tuple[FloatArray, FloatArray]:
    """Observations cell by cell (k, c), and the single ones (m - c,)."""
    parts = [_residual_cells(measured, predicted)]
    if predicted.along_by_travel is not None:
        parts.append(measured.along - predicted.along_by_travel)
    single = np.empty(0)
    if measured.force_n is not None:
        single = (measured.force_n - predicted.force_n) / np.abs(measured.force_n).max()
    return np.concatenate(parts).T, single


def _difference(measured: Measured, predicted: Predicted) -> FloatArray:
    cells, single = _vector(measured, predicted)
    return np.concatenate([np.nanmean(cells, axis=0), single])


def _observed(measured: Measured, best: Predicted, rough: Predicted, test: TensileTest) -> Observed:
    cells, single = _vector(measured, best)
    frames = len(measured.frame)
    noise = FORCE_FLOOR
    if len(single) >= 6:
        noise = max(noise, float(np.sqrt(np.mean(np.diff(single, 3) ** 2) / 20)))
    return Observed(
        cells,
        (frames,) * (cells.shape[1] // frames),
        single,
        noise,
        _difference(measured, best) - _difference(measured, rough),
        test.strain_sd,
    )


def _causes(
    design: PatchDesign,
    specimen: Specimen,
    measured: Measured,
    steps: FloatArray,
    response: Response,
) -> tuple[Cause, ...]:
    """Every cause that the test can see, with its effect by finite differences."""
    base = _difference(measured, predict(response, measured))

    def effect(other: Predicted, step: float) -> FloatArray:
        return (base - _difference(measured, other)) / step

    def simulated(changed: PatchDesign, other: Specimen, step: float) -> FloatArray:
        return effect(predict(respond(changed, other, measured, steps), measured), step)

    softer = replace(specimen, material=other_exponent(specimen.material, EXPONENT_STEP))
    other_ends = replace(specimen, ends="sliding" if specimen.ends == "held" else "held")
    found = [
        Cause(
            "exponent", "material", "Ogden exponent of the law larger by", "", 1.0,
            simulated(design, softer, EXPONENT_STEP),
        ),
        Cause(
            "ends", "boundary",
            "ends free to narrow instead of held (1 is wholly)" if specimen.ends == "held"
            else "ends held instead of free to narrow (1 is wholly)",
            "", 0.5, simulated(design, other_ends, 1.0),
        ),
        Cause(
            "cut-a", "cut length", "cuts across the pull longer by", "% of the cell", 3.0,
            simulated(with_longer_cuts(design, CUT_STEP, 0.0), specimen, 100 * CUT_STEP),
        ),
        Cause(
            "cut-b", "cut length", "cuts along the pull longer by", "% of the cell", 3.0,
            simulated(with_longer_cuts(design, 0.0, CUT_STEP), specimen, 100 * CUT_STEP),
        ),
    ]  # fmt: skip
    if measured.force_n is not None:
        stiff = predict(response, measured)
        found.insert(
            0,
            Cause(
                "stiffness", "material",
                "shear modulus (or thickness, or load cell: the same curve) larger by", "%", 30.0,
                effect(replace(stiff, force_n=1.01 * stiff.force_n), 1.0),
            ),
        )  # fmt: skip
    if measured.displacement_mm is not None:
        found += [
            Cause(
                "slip", "boundary", "displacement lost in the grips, in proportion", "%", 5.0,
                effect(predict(response, measured, slip=SLIP_STEP), 100 * SLIP_STEP),
            ),
            Cause(
                "slack", "boundary", "displacement before the sample is taut", "mm", 1.0,
                effect(predict(response, measured, slack_mm=SLACK_STEP_MM), SLACK_STEP_MM),
            ),
        ]  # fmt: skip
    return tuple(found)


def _with_causes(
    design: PatchDesign,
    specimen: Specimen,
    measured: Measured,
    steps: FloatArray,
    found: Explanation,
) -> Distance:
    """Distance of a simulation with the amounts of an explanation (not of its linear model)."""
    amount = {one.name: one.value for one in found.amounts}
    changed = with_longer_cuts(
        design, amount.get("cut-a", 0.0) / 100, amount.get("cut-b", 0.0) / 100
    )
    part = float(np.clip(amount.get("ends", 0.0), 0.0, 1.0))
    law = other_exponent(specimen.material, amount.get("exponent", 0.0))
    own = replace(specimen, material=law)
    response = respond(changed, own, measured, steps)
    if part > 0:
        other = replace(own, ends="sliding" if specimen.ends == "held" else "held")
        free = respond(changed, other, measured, steps)
        if len(free.displacement_mm) == len(response.displacement_mm):
            response = replace(
                response,
                along=(1 - part) * response.along + part * free.along,
                across=(1 - part) * response.across + part * free.across,
            )
    predicted = predict(response, measured)
    return _curves(measured, predicted, predicted, "log").distance


def _notes(
    design: PatchDesign, specimen: Specimen, measured: Measured, response: Response
) -> tuple[str, ...]:
    rows, columns = design.shape
    placed = "is taken to begin" if specimen.row is not None else "is taken to lie in the middle"
    notes = [
        f"The followed block {placed} of the {rows} x {columns} cells: rows "
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


def _amounts(found: Explanation) -> str:
    clear = [one for one in found.amounts if abs(one.value) > 2 * one.sd]
    shown = clear or list(found.amounts)
    return "; ".join(
        f"{one.words} {one.value:+.3g} ± {1.96 * one.sd:.2g} {one.unit}".strip() for one in shown
    )


def _verdict(comparison: TensileComparison) -> str:
    found = comparison.diagnosis
    if found is None:
        return "Causes were not looked for."
    if found.kind == "noise":
        return "Noise explains it: the scatter of the cells is enough, no cause is needed."
    if found.kind == "one":
        return f"{found.best.name.capitalize()} explains it: {_amounts(found.best)}."
    if found.kind == "cannot-tell":
        names = " or ".join(one.name for one in found.tied)
        return f"Cannot tell: {names} would explain it equally well."
    if found.kind == "together":
        return (
            f"No single cause explains it; {found.best.name} together would: "
            f"{_amounts(found.best)}."
        )
    return (
        "Neither material, boundary, cut length nor noise explains it within plausible amounts; "
        f"{found.best.name} comes nearest."
    )


def _list(values: FloatArray | None) -> list[float | None] | None:
    if values is None:
        return None
    return [float(value) if np.isfinite(value) else None for value in values]


def _object(comparison: TensileComparison) -> dict[str, Any]:
    found = comparison.diagnosis
    return {
        "strain_measure": comparison.measure,
        "frames": list(comparison.frame),
        "curve": {
            "longitudinal_strain": _list(comparison.strain),
            "poisson_ratio": _list(comparison.poisson),
            "poisson_ratio_sd_over_cells": _list(comparison.poisson_cells_sd),
            "poisson_ratio_simulated": _list(comparison.poisson_simulated),
            "difference": _list(comparison.difference),
            "difference_half_width": _list(comparison.half_width),
            "mesh_change": _list(comparison.mesh_poisson),
            "displacement_mm": _list(comparison.displacement_mm),
            "longitudinal_strain_simulated": _list(comparison.strain_simulated),
            "force_n": _list(comparison.force_n),
            "force_simulated_n": _list(comparison.force_simulated_n),
        },
        "distance_poisson_ratio": asdict(comparison.distance),
        "distance_force": comparison.distance_force,
        "explanations": None
        if found is None
        else [
            {
                "families": list(one.families) or ["noise"],
                "log_evidence": one.log_evidence,
                "misfit": one.misfit,
                "probability": one.probability,
                "amounts": [asdict(amount) for amount in one.amounts],
            }
            for one in found.all
        ],
        "alike": None if found is None else [list(one) for one in found.alike],
        "diagnosis": None if found is None else found.kind,
        "named": None if found is None else [one.name for one in found.tied],
        "distance_explained": None
        if comparison.distance_explained is None
        else asdict(comparison.distance_explained),
        "verdict": comparison.verdict,
        "notes": list(comparison.notes),
    }


def _text(comparison: TensileComparison) -> str:
    distance = comparison.distance
    worst = int(np.abs(comparison.difference).argmax())
    lines = [
        f"{len(comparison.frame)} frames, {comparison.measure} strain "
        f"{comparison.strain[0]:.3f} to {comparison.strain[-1]:.3f}",
        f"Poisson's ratio, measured less simulated: {distance.value:.4f} rms without scatter "
        f"(95 % interval {distance.low:.4f} to {distance.high:.4f}; {distance.rms:.4f} with it, "
        f"scatter alone {distance.scatter_rms:.4f}); largest "
        f"{comparison.difference[worst]:+.4f} ± {comparison.half_width[worst]:.4f} at strain "
        f"{comparison.strain[worst]:.3f}",
    ]
    if comparison.distance_force is not None:
        lines.append(f"Force: {100 * comparison.distance_force:.1f} % rms of the largest force")
    found = comparison.diagnosis
    if found is not None:
        top = max(one.log_evidence for one in found.all)
        for one in found.all:
            lines.append(
                f"  {one.name}: evidence {one.log_evidence - top:+.1f}, probability of a larger "
                f"misfit {one.probability:.3f}" + (f"; {_amounts(one)}" if one.amounts else "")
            )
    if comparison.distance_explained is not None:
        lines.append(
            f"With that in the simulation {comparison.distance_explained.value:.4f} are left."
        )
    lines += [*comparison.notes, comparison.verdict]
    return "\n".join(lines)
