"""What an exact Gaussian process learns: scalings and kernel parameters of maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.errors import NotConvergedError
from kiribench.surrogate import likelihood
from kiribench.surrogate.grid import DesignGrid
from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters, scaling_of
from kiribench.surrogate.kernel_form import KernelForm, start_parameters
from kiribench.surrogate.strain_path import Path

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]
Objective = Callable[[Parameters], tuple[float, Parameters]]
COARSE_DESIGNS = 128  # designs of the first, cheap search
COARSE_ROWS = 400  # scattered rows on which starts are compared
NEARLY_ALL, MOST = 0.85, 0.6  # of the observed entries
FEW_HOLES = 2e7  # multiplications that are not worth losing a row of the likelihood
CHEAP_HOLES = 1e9  # multiplications that the holes may add to one likelihood
START_LENGTHS = (0.5, 1.0, 2.0, 4.0)  # times the usual start
START_NOISE = (1e-4, 1e-2, 1.0)  # over the signal variance
COARSE_GAIN = 1e-4  # see likelihood.maximise: the fine search goes on from there


@dataclass(frozen=True, eq=False)
class Problem:
    """Rows to learn from, scaled, and where their parameters go.

    Attributes:
        X, y: (n, d) and (n,) in their own units, the strain along its path where there is one.
        grid: the rows as a grid, or ``None``.
        scaled: scalings of inputs and targets; its kernel parameters are empty.
        raw: whether the inputs are left in their own units.
        place: the device of the computation.
        seed: of the choice of designs or rows where not all take part.
        max_evaluations: limit on the likelihoods of one search.
        gain: with which a search ends, see :func:`likelihood.maximise`.
    """

    X: FloatArray
    y: FloatArray
    grid: DesignGrid | None
    scaled: Hyperparameters
    raw: bool
    place: torch.device
    seed: int | None
    max_evaluations: int
    gain: float

    @classmethod
    def of(
        cls,
        X: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        *,
        scaling: tuple[str, bool],
        path: Path,
        place: torch.device,
        seed: int | None,
        max_evaluations: int,
        gain: float,
    ) -> Problem:
        """Scale as ``scaling`` says, see :func:`scaling_of`."""
        low, span, mean, scale = scaling_of(X, y, inputs=scaling[0], centre=scaling[1])
        scaled = Hyperparameters(
            tuple(low.tolist()),
            tuple(span.tolist()),
            mean,
            scale,
            length_scales=(),
            warp=(),
            signal_variance=float("nan"),
            noise_ratio=1.0,
            path=path,
        )
        return cls(X, y, grid, scaled, scaling[0] == "none", place, seed, max_evaluations, gain)


def learn(
    problem: Problem, form: KernelForm, start: Parameters | None
) -> tuple[Hyperparameters, int]:
    """Maximise the marginal likelihood.

    Args:
        problem: the rows.
        form: which parameters are free.
        start: where to begin; ``None`` compares several starts on a part of the rows.

    Returns:
        What was learnt, its signal variance NaN (it follows from conditioning on all rows), and
        the number of likelihoods of all rows (those of a part are cheap).
    """
    if problem.grid is None:
        rows = len(problem.y)
        objective, coarse = _dense_objective(problem, form, slice(None)), None
        coarse_rows = 0
    else:
        whole = _for_likelihood(problem.grid, problem.seed)
        rows = int(whole.observed.sum())
        objective = _grid_objective(problem, form, whole)
        coarse, coarse_rows = objective, 0
        if len(whole.designs) > 2 * COARSE_DESIGNS:
            # A few designs tell nearly as much about the kernel, at a hundredth of the cost.
            few = _some_designs(whole, COARSE_DESIGNS, problem.seed)
            coarse, coarse_rows = _grid_objective(problem, form, few), int(few.observed.sum())
    first = start
    if first is None:
        starts = starts_of(form)
        first = likelihood.likeliest(coarse or coarse_objective(problem, form), starts)
        if coarse is not None and coarse_rows:
            near = _maximise(
                form, coarse, first, coarse_rows, problem.max_evaluations, gain=COARSE_GAIN
            )
            first = near.parameters
    fine = {"gain": problem.gain}
    best = _maximise(form, objective, first, rows, problem.max_evaluations, **fine)
    used = best.evaluations
    if problem.raw and start is None:
        # One length scale over inputs of different units has several optima: also
        # start from the widest input's range, and keep the likelier.
        reach = 0.5 * np.ptp(problem.X, axis=0).max(keepdims=True)
        wide = replace(start_parameters(form), length_scales=reach)
        other = _maximise(form, objective, wide, rows, problem.max_evaluations, **fine)
        used += other.evaluations
        if other.negative_log_likelihood < best.negative_log_likelihood:
            best = other
    found = best.parameters
    learnt = replace(
        problem.scaled,
        length_scales=tuple(found.length_scales.tolist()),
        warp=tuple((low, high) for low, high in found.warp.tolist()) if form.warped else (),
        corner=tuple(found.corner.tolist()) if form.cornered else (),
        noise_ratio=found.noise_ratio,
        curve_noise=found.curve_noise,
    )
    return learnt, used


def starts_of(form: KernelForm) -> list[Parameters]:
    """Where a search may start: from a poor place it ends where everything is noise."""
    usual = start_parameters(form)
    noises = START_NOISE if form.free_noise else (usual.noise_ratio,)
    return [
        replace(usual, length_scales=usual.length_scales * factor, noise_ratio=noise)
        for factor in START_LENGTHS
        for noise in noises
    ]


def _maximise(
    form: KernelForm,
    objective: Objective,
    start: Parameters,
    rows: int,
    limit: int,
    **settings: Any,
) -> likelihood.Maximum:
    try:
        return likelihood.maximise(
            form, objective, start, rows=rows, max_evaluations=limit, **settings
        )
    except torch.linalg.LinAlgError as error:  # type: ignore[attr-defined]
        raise NotConvergedError(
            "gp-not-positive-definite",
            f"The covariance of the rows is not positive definite ({error}).",
            remedy="Remove rows that are nearly equal, or give a larger start for the noise.",
        ) from error


def coarse_objective(problem: Problem, form: KernelForm) -> Objective:
    """The likelihood of a few scattered rows, on which starts are compared."""
    some = np.random.default_rng(problem.seed).permutation(len(problem.y))[:COARSE_ROWS]
    return _dense_objective(problem, form, np.sort(some))


def _dense_objective(problem: Problem, form: KernelForm, rows: Any) -> Objective:
    return likelihood.dense_objective(
        form,
        tensor(problem.scaled.scale_inputs(problem.X[rows]), problem.place),
        tensor(problem.scaled.scale_targets(problem.y[rows]), problem.place),
    )


def _for_likelihood(grid: DesignGrid, seed: int | None) -> DesignGrid:
    """The part of a grid on which the kernel parameters are learnt.

    All of it where next to nothing is missing. Else the complete part that is left after
    dropping the emptiest strains and designs where that is nearly all; or all of it with more
    holes; or a complete part that is most of it; or, where holes are everywhere, a random choice
    of designs with so few holes that the exact likelihood stays cheap. The process itself is
    always conditioned on every row.
    """
    missing = len(grid.missing)
    if missing * missing * grid.values.size <= FEW_HOLES:
        return grid
    complete = _complete_part(grid)
    share = complete.observed.sum() / grid.observed.sum()
    if share >= NEARLY_ALL:
        return complete
    if missing * missing * grid.values.size <= CHEAP_HOLES:
        return grid
    if share >= MOST:
        return complete
    # Holes grow with the designs: n designs cost n^3.
    part = (CHEAP_HOLES / (missing * missing * grid.values.size)) ** (1.0 / 3.0)
    return _some_designs(grid, max(20, int(part * len(grid.designs))), seed)


def _complete_part(grid: DesignGrid) -> DesignGrid:
    """What is left when the emptiest strains and designs are dropped until nothing is missing."""
    rows = np.ones(len(grid.designs), dtype=bool)
    columns = np.ones(len(grid.curve), dtype=bool)
    while not grid.observed[np.ix_(rows, columns)].all():
        kept = grid.observed[np.ix_(rows, columns)]
        by_row, by_column = 1.0 - kept.mean(axis=1), 1.0 - kept.mean(axis=0)
        if by_row.max() >= by_column.max():
            rows[np.flatnonzero(rows)[by_row.argmax()]] = False
        else:
            columns[np.flatnonzero(columns)[by_column.argmax()]] = False
    return _part(grid, rows, columns)


def _some_designs(grid: DesignGrid, count: int, seed: int | None) -> DesignGrid:
    chosen = np.random.default_rng(seed).permutation(len(grid.designs))[:count]
    some = np.zeros(len(grid.designs), dtype=bool)
    some[chosen] = True
    return _part(grid, some, np.ones(len(grid.curve), dtype=bool))


def _grid_objective(problem: Problem, form: KernelForm, grid: DesignGrid) -> Objective:
    designs, strains = scaled_axes(grid, problem.scaled, problem.place)
    return likelihood.grid_objective(
        form,
        designs,
        strains,
        tensor(problem.scaled.scale_targets(grid.values), problem.place),
        torch.as_tensor(grid.missing, device=problem.place),
    )


def _part(grid: DesignGrid, rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> DesignGrid:
    return replace(
        grid,
        designs=grid.designs[rows],
        curve=grid.curve[columns],
        values=grid.values[np.ix_(rows, columns)],
        observed=grid.observed[np.ix_(rows, columns)],
    )


def scaled_axes(
    grid: DesignGrid, scaling: Hyperparameters, place: torch.device
) -> tuple[Tensor, Tensor]:
    """(p, d - 1) designs and (m, 1) strains of a grid, in the kernel's units."""
    low, span = np.array(scaling.input_low), np.array(scaling.input_span)
    designs = (grid.designs - low[:-1]) / span[:-1]
    strains = (grid.curve[:, None] - low[-1]) / span[-1]
    return tensor(designs, place), tensor(strains, place)


def tensor(array: FloatArray, place: torch.device) -> Tensor:
    """A float64 tensor on the device."""
    return torch.as_tensor(np.ascontiguousarray(array, dtype=np.float64), device=place)
