"""From cuts to the design table: predicted, error, reachable, reason, sensitivity, force."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.design.cells import Cells, held_in_data
from kiribench.design.fill import filled_from_neighbours
from kiribench.design.reachable import Reachable
from kiribench.design.result import Designed, EquivalentDesigns, Generations
from kiribench.design.sensitivity import cutting_error
from kiribench.schema.patch_design import PatchDesign

FloatArray = NDArray[np.float64]

OUT_OF_REACH = 1e-6  # of Poisson's ratio; less is rounding
SLACK = 1e-9


def designed(
    method: str,
    cells: Cells,
    cuts: FloatArray,
    span: Reachable,
    *,
    settings: dict[str, Any] | None = None,
    generations: Generations | None = None,
    curves: tuple[EquivalentDesigns, ...] = (),
    cpu_seconds: float = 0.0,
    notes: tuple[str, ...] = (),
) -> Designed:
    """The result of a method from its cuts.

    Args:
        method: its name.
        cells: what it was asked.
        cuts: (R, C, 2) a, b; NaN where cuts are to be filled in from the neighbours.
        span: the reachable ranges of the cells with a target.
        settings: of the method, for the sidecar.
        generations, curves: for the figures.
        cpu_seconds: process time of the search.
        notes: for the reader.
    """
    problem, surrogates, options = cells.problem, cells.surrogates, cells.options
    a, b = (filled_from_neighbours(cuts[:, :, side]) for side in range(2))
    flat = np.column_stack([a.ravel(), b.ravel()])[cells.place]
    at = cells.poisson.jet(flat)
    error = at.value - cells.target
    predicted = surrogates.poisson.predict(100 * flat[:, 0], 100 * flat[:, 1], cells.strain)
    sd = np.full(len(cells), np.nan) if predicted.sd is None else predicted.sd
    distance = span.distance(cells.target)
    stress = nominal_stress(cells, a, b)
    quantities = {
        "target_longitudinal_strain": problem.longitudinal_strain,
        "target_poisson_ratio": problem.poisson_ratio,
        "predicted_poisson_ratio": cells.on_patch(at.value),
        "predicted_poisson_ratio_sd": cells.on_patch(sd),
        "error": cells.on_patch(error),
        "reachable_low": cells.on_patch(span.low),
        "reachable_high": cells.on_patch(span.high),
        "distance": cells.on_patch(distance),
        "cutting_error": cells.on_patch(
            cutting_error(at.slope, options.cut_error, options.kerf_error_mm / problem.cell_mm)
        ),
        "nominal_stress_mpa": stress,
    }
    design = PatchDesign(
        participant=problem.participant,
        method=method,
        side=problem.side,
        cell_mm=problem.cell_mm,
        thickness_mm=problem.thickness_mm,
        strain_measure=problem.strain_measure,
        a=a,
        b=b,
        region=problem.region,
        reason=_reasons(cells, error, distance),
        quantities=quantities,
        settings={
            "Limits": cells.limits.as_dict(problem.cell_mm),
            "MethodSettings": settings or {},
            "Targets": [path.name for path in problem.files],
            "Surrogate": surrogates.as_dict(),
        },
    )
    return Designed(
        design=design,
        problem=problem,
        limits=cells.limits,
        options=options,
        strain=cells.on_patch(cells.strain),
        error=cells.on_patch(error),
        nominal_stress_mpa=stress,
        generations=generations,
        curves=curves,
        cpu_seconds=cpu_seconds,
        notes=(*problem.notes, *notes),
    )


def nominal_stress(cells: Cells, a: FloatArray, b: FloatArray) -> FloatArray:
    """(R, C) nominal stress in MPa at the target strain; NaN without strain or surrogate.

    Below the surrogate's data the secant modulus is that of its smallest strain.
    """
    kept = cells.surrogates.poisson
    strain = cells.problem.longitudinal_strain
    stress = np.full(cells.problem.shape, np.nan)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(strain) & (strain > 0)
    if kept.stress is None or not known.any():
        return stress
    held = held_in_data(strain[known], cells.surrogates)
    modulus = kept.stress.predict(100 * a[known], 100 * b[known], held).mean
    stress[known] = strain[known] * np.exp(modulus)
    return stress


def _reasons(cells: Cells, error: FloatArray, distance: FloatArray) -> NDArray[np.str_]:
    problem, kept = cells.problem, cells.surrogates.poisson
    reason = np.full(problem.shape, "", dtype="<U64")
    missing = ~problem.wanted
    reason[missing] = np.where(
        problem.reason[missing] != "", problem.reason[missing], "target-missing"
    )
    wanted = problem.longitudinal_strain.ravel()[cells.place]
    tolerance = cells.options.tolerance + SLACK
    code = np.select(
        [
            wanted < kept.low[2] - SLACK,
            wanted > kept.high[2] + SLACK,
            (distance > OUT_OF_REACH) & (error < 0),
            distance > OUT_OF_REACH,
            np.abs(error) > tolerance,
        ],
        [
            "strain-below-data",
            "strain-beyond-data",
            "target-above-reachable",
            "target-below-reachable",
            "method-compromise",
        ],
        "",
    )
    reason.ravel()[cells.place] = code
    return reason
