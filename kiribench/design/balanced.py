"""All cells at once: targets, equal force in series, neighbours that go together.

Nothing in a target of Poisson's ratio makes a cell reach its strain. Cells of one column of the
pull are in series: they carry the same force, so each one's nominal stress at its own target
strain must be the same (all cells have the same undeformed width and thickness). The sum of

- ``((nu - target) / poisson_sd)^2`` in every cell with a target,
- ``((ln stress - ln force of the column) / force_sd)^2`` in every cell with a strain,
- ``((a - a') / neighbour_sd)^2`` and the same of b for every two cells with a common side,
- ``(a / 10)^2 + (b / 10)^2``, which makes the answer unique where nothing else does,

is minimised within the limits, over all cuts and the columns' forces. The start is global in
each column: for every force of a ladder the best cuts of every cell on a grid. Then follow
Levenberg-Marquardt steps with exact derivatives, the bounds as an active set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from kiribench.design.cells import Cells, held_in_data
from kiribench.design.reachable import Reachable
from kiribench.design.response import KernelResponse
from kiribench.errors import UsageError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LADDER = 32  # forces tried in each column
COARSE = 0.03  # step of the start's grid, fraction of the cell edge
BLOCK = 250  # cells at a time
LEAST_STRAIN = 0.005  # below it a cell has no force to speak of
ITERATIONS = 200
SMALL = 1e-4  # relative decrease; two such steps in a row end the iteration
UNIQUE_SD = 10.0


@dataclass(frozen=True, eq=False)
class Balanced:
    """The answer.

    Attributes:
        cuts: (N, 2) a, b of all R C cells, fractions.
        log_stress: (N,) ln of the nominal stress in MPa at the target strain; NaN without one.
        log_force: (C,) ln of the nominal stress that each column settles on.
        objective: after each iteration.
    """

    cuts: FloatArray
    log_stress: FloatArray
    log_force: FloatArray
    objective: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Terms:
    """The parts of the sum: cells with a target, cells in series, pairs of neighbours."""

    nu: KernelResponse
    nu_cell: IntArray
    target: FloatArray
    stress: KernelResponse
    stress_cell: IntArray
    log_strain: FloatArray
    column: IntArray
    pairs: IntArray
    cells: int
    columns: int
    poisson_sd: float
    force_sd: float
    neighbour_sd: float

    def force_of(self, log_stress: FloatArray) -> FloatArray:
        """(C,) means of ln stress over the cells of each column."""
        count = np.bincount(self.column, minlength=self.columns)
        total = np.bincount(self.column, log_stress, self.columns)
        return np.asarray(total / np.maximum(count, 1))


def balance(cells: Cells, span: Reachable) -> Balanced:
    """Solve for the whole patch.

    Args:
        cells: with targets.
        span: their reachable ranges; a target out of reach is replaced by the nearest in it.

    Raises:
        UsageError: the surrogate has no stress.
    """
    terms = terms_of(cells, span)
    x = _start(terms, cells.high)
    x, objective = _descend(terms, x, cells.high)
    log_stress = terms.log_strain + terms.stress.gradient(x[terms.stress_cell]).value
    full = np.full(terms.cells, np.nan)
    full[terms.stress_cell] = log_stress
    return Balanced(x, full, terms.force_of(log_stress), tuple(objective))


def terms_of(cells: Cells, span: Reachable) -> Terms:
    """The sum's parts; raises where the surrogate has no stress."""
    problem, options = cells.problem, cells.options
    model = cells.surrogates.poisson.stress
    if model is None:
        raise UsageError(
            "surrogate-without-stress",
            "The method balanced needs the nominal stress, and the surrogate knows Poisson's "
            "ratio only.",
            remedy="Fit a Gaussian process (kiribench fit) to a table with the column "
            "nominal_stress_mpa, such as kiribench simulate writes, or use --method exact.",
            file=cells.surrogates.file,
        )
    strain = problem.longitudinal_strain.ravel()
    with np.errstate(invalid="ignore"):
        loaded = np.flatnonzero(strain > LEAST_STRAIN)
    rows, columns = problem.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    pairs = np.concatenate(
        [
            np.column_stack([index[:-1].ravel(), index[1:].ravel()]),
            np.column_stack([index[:, :-1].ravel(), index[:, 1:].ravel()]),
        ]
    )
    return Terms(
        nu=cells.poisson,
        nu_cell=cells.place,
        target=span.nearest(cells.target),
        stress=KernelResponse.of(model, held_in_data(strain[loaded], cells.surrogates)),
        stress_cell=loaded,
        # The secant modulus of the nearest strain in the data times the strain itself.
        log_strain=np.log(strain[loaded]),
        column=loaded % columns,
        pairs=pairs,
        cells=rows * columns,
        columns=columns,
        poisson_sd=options.poisson_sd,
        force_sd=options.force_sd,
        neighbour_sd=options.neighbour_sd,
    )


def _start(terms: Terms, high: float) -> FloatArray:
    """(N, 2): in each column the force, and for it the cuts, that cost least on a grid."""
    ticks = np.linspace(0.0, high, 1 + max(2, round(high / COARSE)))
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    # What half a step of the grid makes of either quantity is no error yet.
    nu_sd, force_sd = np.hypot(terms.poisson_sd, COARSE), np.hypot(terms.force_sd, 4 * COARSE)
    position = np.full(terms.cells, -1)
    position[terms.nu_cell] = np.arange(len(terms.nu_cell))
    force: FloatArray | None = None
    costs = np.zeros((terms.columns, LADDER))
    choice = np.zeros((terms.cells, LADDER), dtype=np.int64)
    least, most = np.inf, -np.inf
    for stage in ("range", "cost"):
        if stage == "cost":
            force = np.linspace(least, most, LADDER)
        for start in range(0, len(terms.stress_cell), BLOCK):
            some = np.arange(start, min(start + BLOCK, len(terms.stress_cell)))
            cell = terms.stress_cell[some]
            stress = terms.stress.on_grid(ticks, ticks, some).reshape(len(some), -1)
            stress += terms.log_strain[some, None]
            if force is None:
                least, most = min(least, float(stress.min())), max(most, float(stress.max()))
                continue
            wish = 1e-3 * (grid**2).sum(axis=1) + np.zeros_like(stress)
            aimed = np.flatnonzero(position[cell] >= 0)
            if len(aimed):
                nu = position[cell[aimed]]
                values = terms.nu.on_grid(ticks, ticks, nu).reshape(len(nu), -1)
                wish[aimed] += ((values - terms.target[nu, None]) / nu_sd) ** 2
            for k, level in enumerate(force):
                cost = wish + ((stress - level) / force_sd) ** 2
                choice[cell, k] = cost.argmin(axis=1)
                np.add.at(costs[:, k], terms.column[some], cost.min(axis=1))
    x = np.full((terms.cells, 2), high / 2)
    best = costs.argmin(axis=1)
    column = np.arange(terms.cells) % terms.columns
    known = terms.stress_cell
    x[known] = grid[choice[known, best[column[known]]]]
    return x


def _descend(terms: Terms, x: FloatArray, high: float) -> tuple[FloatArray, list[float]]:
    """Levenberg-Marquardt within the box; the objective after each accepted step."""
    damping = 1e-2
    value, slope, matrix = quadratic(terms, x)
    history = [value]
    idle = 0
    for _ in range(ITERATIONS):
        flat = x.ravel()
        held = ((flat <= 0.0) & (slope > 0.0)) | ((flat >= high) & (slope < 0.0))
        free = np.flatnonzero(~held)
        if not len(free) or np.abs(slope[free]).max() < 1e-9:
            break
        step = np.zeros_like(flat)
        step[free] = _solve(matrix, slope, free, len(flat), damping)
        trial = np.clip(flat + np.clip(step, -0.1, 0.1), 0.0, high).reshape(-1, 2)
        new = quadratic(terms, trial)
        if new[0] < value:
            gained = value - new[0]
            x, (value, slope, matrix) = trial, new
            history.append(value)
            damping = max(damping / 4, 1e-9)
            idle = idle + 1 if gained < SMALL * (1.0 + value) else 0
            if idle == 2:
                break
        else:
            damping *= 8
            if damping > 1e8:
                break
    return x, history


def quadratic(terms: Terms, x: FloatArray) -> tuple[float, FloatArray, csc_array]:
    """The sum, its slope by the cuts, and half its Gauss-Newton matrix.

    The columns' forces are at their best (means) in the sum and the slope; in the matrix they
    are further unknowns behind the cuts, which keeps it sparse.
    """
    n, c = 2 * terms.cells, terms.columns
    nu = terms.nu.gradient(x[terms.nu_cell])
    stress = terms.stress.gradient(x[terms.stress_cell])
    miss = (nu.value - terms.target) / terms.poisson_sd
    log_stress = terms.log_strain + stress.value
    uneven = (log_stress - terms.force_of(log_stress)[terms.column]) / terms.force_sd
    apart = (x[terms.pairs[:, 0]] - x[terms.pairs[:, 1]]) / terms.neighbour_sd
    by_nu, by_stress = nu.slope / terms.poisson_sd, stress.slope / terms.force_sd
    k, s, m = len(miss), len(uneven), len(terms.pairs)
    at_nu, at_stress = 2 * terms.nu_cell, 2 * terms.stress_cell
    first, second = 2 * terms.pairs[:, 0], 2 * terms.pairs[:, 1]
    unit = np.full(m, 1.0 / terms.neighbour_sd)
    row = [np.arange(k)] * 2 + [k + np.arange(s)] * 3
    column = [at_nu, at_nu + 1, at_stress, at_stress + 1, n + terms.column]
    entry = [*by_nu.T, *by_stress.T, np.full(s, -1.0 / terms.force_sd)]
    for side in range(2):
        here = k + s + side * m + np.arange(m)
        row += [here, here]
        column += [first + side, second + side]
        entry += [unit, -unit]
    rows = k + s + 2 * m
    jacobian = coo_array(
        (np.concatenate(entry), (np.concatenate(row), np.concatenate(column))),
        shape=(rows, n + c),
    ).tocsr()
    residual = np.concatenate([miss, uneven, apart[:, 0], apart[:, 1]])
    flat = x.ravel() / UNIQUE_SD
    value = float(residual @ residual + flat @ flat)
    slope = np.asarray(jacobian.T @ residual)[:n] + flat / UNIQUE_SD
    matrix = (jacobian.T @ jacobian + diags_array(_unique(n, c))).tocsc()
    return value, 2.0 * slope, matrix


def _unique(n: int, c: int) -> FloatArray:
    # A column without any force has an unknown that nothing holds.
    return np.concatenate([np.full(n, UNIQUE_SD**-2), np.full(c, 1e-9)])


def _solve(
    matrix: csc_array, slope: FloatArray, free: IntArray, n: int, damping: float
) -> FloatArray:
    """The step of the free cuts; the forces follow them."""
    c = matrix.shape[0] - n
    every = np.concatenate([free, n + np.arange(c)])
    part = matrix[every][:, every]
    extra = np.concatenate([damping * (1.0 + part.diagonal()[: len(free)]), np.zeros(c)])
    right = np.concatenate([-0.5 * slope[free], np.zeros(c)])
    factor = splu((part + diags_array(extra)).tocsc())
    return np.asarray(factor.solve(right)[: len(free)])
