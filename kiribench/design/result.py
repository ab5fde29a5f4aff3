"""What a design method returns: the table, and what its figures are drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.limits import Limits
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.schema.patch_design import PatchDesign

FloatArray = NDArray[np.float64]

#: Reason codes of a designed cell, with the sentence that a report prints.
REASONS = {
    "target-missing": "The cell has no target; its cuts are filled in from its neighbours.",
    "strain-below-data": "The target strain is smaller than any that the surrogate has seen; "
    "its smallest is used instead.",
    "strain-beyond-data": "The target strain is larger than any that the surrogate has seen; "
    "its largest is used instead.",
    "target-above-reachable": "No allowed cuts have so large a Poisson's ratio at this strain; "
    "the nearest that there is was taken.",
    "target-below-reachable": "No allowed cuts have so small a Poisson's ratio at this strain; "
    "the nearest that there is was taken.",
    "method-compromise": "The target can be reached, but the method gave it up in part for "
    "another aim (one cut for all cells, equal force, less cutting).",
}


@dataclass(frozen=True, eq=False)
class Generations:
    """The course of CMA-ES in n cells.

    Attributes:
        population: (g, n, p, 2) a, b that were tried, fractions; NaN after a cell has stopped.
        objective: (g, n, p) the paper's objective there; NaN likewise.
        stopped: (n,) number of generations that each cell took.
    """

    population: FloatArray
    objective: FloatArray
    stopped: NDArray[np.int64]

    @property
    def best(self) -> FloatArray:
        """(g, n) smallest objective so far; kept after a cell has stopped."""
        return np.asarray(
            np.fmin.accumulate(
                np.nanmin(np.where(np.isnan(self.objective), np.inf, self.objective), axis=2),
                axis=0,
            )
        )


@dataclass(frozen=True, eq=False)
class EquivalentDesigns:
    """Designs of one cell that have one and the same Poisson's ratio at its strain.

    Attributes:
        cell: (row, column).
        pieces: polylines (k, 2) of a, b, fractions, each point on the curve to rounding.
    """

    cell: tuple[int, int]
    pieces: tuple[FloatArray, ...]


@dataclass(frozen=True)
class OnSkin:
    """What a design on the skin is judged by: where its corners lie when it is worn, simulated.

    Attributes:
        elements: elements a facet edge of the mesh that says so; the design has not seen it.
        equilibrium: whether an equilibrium was found on it; without one the distances are those
            of the last attempt.
        start: method of the start.
        start_rms_mm: rms distance of the start's corners from their nodes, on the design's mesh.
        rms_mm, worst_mm: the same of the result, on the finer mesh.
        overlap_mean, overlap_least: of the cells with the skin's, by fast charts; None where
            nobody asked.
        cells_good, cells_scored: how many of the cells are graded good; None likewise.
        posed_start_rms_mm, posed_rms_mm: of ``robust``: rms distance of the corners from their
            nodes over its errors of placement, before and after; None of ``worn``.
    """

    elements: int
    equilibrium: bool
    start: str
    start_rms_mm: float
    rms_mm: float
    worst_mm: float
    overlap_mean: float | None = None
    overlap_least: float | None = None
    cells_good: int | None = None
    cells_scored: int | None = None
    posed_start_rms_mm: float | None = None
    posed_rms_mm: float | None = None


@dataclass(frozen=True, eq=False)
class Designed:
    """A designed patch.

    Attributes:
        design: the table that is written, exported and checked.
        problem, limits, options: what it was made from.
        strain: (R, C) strain at which the surrogate was asked: the target's, held within the
            surrogate's data; NaN where there is no target.
        error: (R, C) predicted minus target Poisson's ratio; NaN where there is no target.
        nominal_stress_mpa: (R, C) at the target strain, NaN without a surrogate of stress.
        generations: of CMA-ES, or None.
        curves: one a cell with a target, or none where they were not asked for.
        cpu_seconds: process time of the method.
        notes: facts that a reader needs, as sentences.
        on_skin: of the methods that wear the patch; None of those that ask the surrogate.
    """

    design: PatchDesign
    problem: DesignProblem
    limits: Limits
    options: DesignOptions
    strain: FloatArray
    error: FloatArray
    nominal_stress_mpa: FloatArray
    generations: Generations | None = None
    curves: tuple[EquivalentDesigns, ...] = ()
    cpu_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    on_skin: OnSkin | None = None
