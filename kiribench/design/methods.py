"""The methods of design: from the targets of a patch to its cuts."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kiribench.design.balanced import balance
from kiribench.design.cells import Cells, cells_of
from kiribench.design.curves import equivalent_designs
from kiribench.design.exact import Exact, least_cuts, least_penalised
from kiribench.design.judge import designed
from kiribench.design.limits import Limits
from kiribench.design.options import DesignOptions
from kiribench.design.paper import PENALTY, search
from kiribench.design.problem import DesignProblem
from kiribench.design.reachable import reachable_in_blocks
from kiribench.design.response import KernelResponse
from kiribench.design.result import Designed, EquivalentDesigns
from kiribench.design.sensitivity import least_sensitive
from kiribench.design.surrogates import Surrogates
from kiribench.design.uniform import best_single
from kiribench.errors import UsageError

FloatArray = NDArray[np.float64]

MOST_CURVES = 600  # cells whose curves of equivalent designs are all kept

METHODS: dict[str, str] = {
    "paper": "the paper's objective, cell by cell, by CMA-ES",
    "exact": "the least cuts that meet each cell's target, found with certainty",
    "balanced": "all cells at once: targets, equal force in series, smooth neighbours",
    "uniform": "the best single pair of cut lengths: the control",
}


def design_patch(
    method: str,
    problem: DesignProblem,
    surrogates: Surrogates,
    limits: Limits | None = None,
    options: DesignOptions | None = None,
) -> Designed:
    """Design the cuts of a patch.

    Args:
        method: a key of :data:`METHODS`.
        problem: the targets, in the surrogate's strain measure.
        surrogates: of Poisson's ratio, and for ``balanced`` of the nominal stress.
        limits: of laser and sheet.
        options: tolerances and settings of the methods.

    Raises:
        UsageError: the method is unknown, the strain measures differ, no cell has a target, the
            surrogate has no derivatives, or no stress where ``balanced`` asks for it.
    """
    if method not in _SOLVERS:
        raise UsageError(
            "method-unknown",
            "There is no such method of design.",
            remedy="Choose one of the methods named.",
            got=method,
            expected=", ".join(METHODS),
        )
    cells = cells_of(problem, surrogates, limits or Limits(), options or DesignOptions())
    return _SOLVERS[method](cells)


def _paper(cells: Cells) -> Designed:
    start = time.process_time()
    cuts, generations = search(cells)
    seconds = time.process_time() - start
    penalty = PENALTY if cells.options.penalty is None else cells.options.penalty
    optimum = least_penalised(cells.poisson, cells.target, cells.high, penalty)
    reached = int(
        np.sum(_objective(cells, cuts, penalty) <= _objective(cells, optimum.cuts, penalty) + 1e-8)
    )
    options = cells.options
    return designed(
        "paper",
        cells,
        _on_patch(cells, cuts),
        optimum.reachable,
        settings={
            "Penalty": penalty,
            "PenaltyUnit": "Poisson's ratio squared per (fraction of the cell edge) squared",
            "Seed": options.seed,
            "Population": int(generations.objective.shape[2]),
            "FirstStep": options.sigma,
            "MostGenerations": options.max_generations,
            "GenerationsMedian": float(np.median(generations.stopped)),
            "AtGlobalOptimum": reached,
        },
        generations=generations,
        curves=_curves(cells),
        cpu_seconds=seconds,
        notes=(
            f"CMA-ES ended at the global optimum of the paper's objective in {reached} of "
            f"{len(cells)} cells.",
        ),
    )


def _objective(cells: Cells, cuts: FloatArray, penalty: float) -> FloatArray:
    error = cells.poisson.jet(cuts).value - cells.target
    return np.asarray(error**2 + penalty * (cuts**2).sum(axis=1))


def _exact(cells: Cells) -> Designed:
    options = cells.options
    start = time.process_time()
    if options.penalty is None:
        found = least_cuts(cells.poisson, cells.target, cells.high, options.tolerance)
    else:
        found = least_penalised(cells.poisson, cells.target, cells.high, options.penalty)
    cuts = found.cuts
    if options.prefer == "insensitive":
        cuts = _insensitive(cells, found)
    seconds = time.process_time() - start
    return designed(
        "exact",
        cells,
        _on_patch(cells, cuts),
        found.reachable,
        settings={
            "Tolerance": options.tolerance,
            "Penalty": options.penalty,
            "Prefer": options.prefer,
            "CutError": options.cut_error,
            "KerfErrorMm": options.kerf_error_mm,
        },
        curves=_curves(cells),
        cpu_seconds=seconds,
    )


def _insensitive(cells: Cells, found: Exact) -> FloatArray:
    options = cells.options
    steady = least_sensitive(
        cells.poisson,
        found.reachable.nearest(cells.target),
        cells.high,
        options.cut_error,
        options.kerf_error_mm / cells.problem.cell_mm,
    )
    return np.where(np.isfinite(steady), steady, found.cuts)


def _balanced(cells: Cells) -> Designed:
    start = time.process_time()
    span = reachable_in_blocks(cells.poisson, cells.high)
    found = balance(cells, span)
    seconds = time.process_time() - start
    rows, columns = cells.problem.shape
    uneven = found.log_stress.reshape(rows, columns) - found.log_force
    known = np.isfinite(uneven)
    rms = float(np.sqrt(np.mean(uneven[known] ** 2))) if known.any() else 0.0
    options = cells.options
    notes = []
    if not found.converged:
        notes.append(
            f"The search did not come to rest in {found.steps} steps: targets, forces and "
            "neighbours may go together better than here."
        )
    return designed(
        "balanced",
        cells,
        found.cuts.reshape(rows, columns, 2),
        span,
        settings={
            "PoissonSd": options.poisson_sd,
            "ForceSd": options.force_sd,
            "NeighbourSd": options.neighbour_sd,
            "ColumnStressMpa": [
                float(np.exp(force)) if np.isfinite(force) else None for force in found.log_force
            ],
            "ForceDifferenceRms": rms,
            "Iterations": found.steps,
            "CellsMoved": found.moved,
            "Converged": found.converged,
            "Objective": found.objective,
        },
        curves=_curves(cells),
        cpu_seconds=seconds,
        notes=tuple(notes),
    )


def _uniform(cells: Cells) -> Designed:
    start = time.process_time()
    best = best_single(cells)
    seconds = time.process_time() - start
    rows, columns = cells.problem.shape
    return designed(
        "uniform",
        cells,
        np.broadcast_to(best, (rows, columns, 2)).copy(),
        reachable_in_blocks(cells.poisson, cells.high),
        curves=_curves(cells),
        cpu_seconds=seconds,
    )


def _on_patch(cells: Cells, cuts: FloatArray) -> FloatArray:
    return np.stack([cells.on_patch(cuts[:, side]) for side in range(2)], axis=-1)


def _curves(cells: Cells) -> tuple[EquivalentDesigns, ...]:
    """Of every cell; of a large patch only of the smallest, the middle and the largest target."""
    if not cells.options.curves:
        return ()
    columns = cells.problem.shape[1]
    which = np.arange(len(cells))
    if len(cells) > MOST_CURVES:
        which = np.sort(np.argsort(cells.target)[[0, len(cells) // 2, -1]])
    response = KernelResponse.of(cells.surrogates.poisson, cells.strain[which])
    return tuple(
        EquivalentDesigns((int(place) // columns, int(place) % columns), pieces)
        for place, pieces in zip(
            cells.place[which],
            equivalent_designs(response, cells.target[which], cells.high),
            strict=True,
        )
    )


_SOLVERS: dict[str, Callable[[Cells], Designed]] = {
    "paper": _paper,
    "exact": _exact,
    "balanced": _balanced,
    "uniform": _uniform,
}
