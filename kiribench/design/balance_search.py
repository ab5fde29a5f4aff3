"""Newton's method on the sum of ``balanced``, all cells at once and each cell by itself.

Targets and forces weigh so much more than neighbours that good cuts lie in narrow curved valleys,
where a straight step of the whole patch is good only while it is short. So after a step that
disappoints each cell goes back to the floor of its own valley (two unknowns a cell, the forces
fixed) before the step is judged. And when all cells together have come to rest, each one looks
over its whole square whether it were better off elsewhere, its neighbours and forces fixed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from kiribench.design.balance_terms import At, Terms
from kiribench.design.box_newton import minimise_in_box
from kiribench.design.reachable import starts_of
from kiribench.design.response import Jet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ITERATIONS = 200
CONVERGED = 1e-8  # decrease that the next step promises, relative to 1 + the sum
GOOD = 0.5  # of the promised decrease: no need to look further
WHOLE = 1e-9  # by which the limits may shorten the last step
LONGEST = 0.1  # step of a cut, fraction of the cell edge
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e10
HOLD = 16.0  # what holds a cell to the step while it returns to its valley: as four neighbours
COARSE = 0.03  # step of the grid on which a cell looks around
PLACES = 4  # that it looks at more closely
BLOCK = 2_000  # cells at a time there
BETTER = 1e-6  # relative gain for which a cell moves


@dataclass(frozen=True, eq=False)
class Descent:
    """Where Newton's method ended.

    Attributes:
        at: the place.
        values: of the sum at the start and after each accepted step.
        converged: whether the next step promised next to nothing.
    """

    at: At
    values: tuple[float, ...]
    converged: bool


def descend(terms: Terms, x: FloatArray) -> Descent:
    """From (N, 2) cuts to a local minimum within the limits."""
    at = terms.at(x)
    values = [at.value]
    damping = FIRST_DAMPING
    for _ in range(ITERATIONS):
        wish, force, damping = _step(terms, at, damping)
        step = np.clip(at.x + wish, 0.0, terms.high) - at.x
        move = np.append(step.ravel(), force)
        promised = -float(at.slope @ step.ravel() + 0.5 * move @ (at.matrix @ move))
        small = CONVERGED * (1.0 + at.value)
        new = terms.at(at.x + step)
        if promised > small and at.value - new.value < GOOD * promised:
            back = terms.at(_to_valley(terms, new.x, at.force + force))
            new = back if back.value < new.value else new
        lower = new.value < at.value
        if lower:
            at = new
            values.append(at.value)
        whole = bool(np.abs(step - wish).max() <= WHOLE and damping <= FIRST_DAMPING)
        if whole and promised <= small:
            return Descent(at, tuple(values), converged=True)
        damping = max(damping / 8, LEAST_DAMPING) if lower else max(8 * damping, FIRST_DAMPING)
        if damping > MOST_DAMPING:
            break
    return Descent(at, tuple(values), converged=False)


def _step(terms: Terms, at: At, damping: float) -> tuple[FloatArray, FloatArray, float]:
    """(N, 2) step of the cuts, (C,) of the forces, and the damping that made it a descent."""
    flat, slope = at.x.ravel(), at.slope
    held = ((flat <= 0.0) & (slope > 0.0)) | ((flat >= terms.high) & (slope < 0.0))
    while True:
        free = np.flatnonzero(~held)
        kept = np.concatenate([free, np.arange(len(flat), at.matrix.shape[0])])
        part = at.matrix[kept][:, kept]
        cuts = np.concatenate([np.ones(len(free)), np.zeros(len(at.force))])
        while (factor := _positive_factor((part + diags_array(damping * cuts)).tocsc())) is None:
            damping = max(4 * damping, FIRST_DAMPING)
        found = factor.solve(np.concatenate([-slope[free], np.zeros(len(at.force))]))
        step = np.zeros_like(flat)
        step[free] = np.clip(found[: len(free)], -LONGEST, LONGEST)
        # The others may push a cut out of its limits against its own slope.
        out = ((flat <= 0.0) & (step < 0.0)) | ((flat >= terms.high) & (step > 0.0))
        if not out.any():
            return step.reshape(-1, 2), found[len(free) :], damping
        held |= out


def _positive_factor(matrix: csc_array) -> SuperLU | None:
    """Factors of a symmetric matrix in an order that keeps them sparse; None if not positive.

    Without pivoting U is D L^T, so that the signs on its diagonal are those of the eigenvalues.
    """
    try:
        factor = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return None
    straight = np.array_equal(factor.perm_r, factor.perm_c)
    return factor if straight and factor.U.diagonal().min() > 0.0 else None


def _to_valley(terms: Terms, x: FloatArray, force: FloatArray) -> FloatArray:
    """(N, 2): each cell near x where its own squares are small, the (C,) forces given."""
    every = np.arange(len(x))

    def objective(points: FloatArray, which: IntArray) -> Jet:
        own = terms.own(points, every[which], force)
        return _with_bowl(own, points, HOLD, -HOLD * x[which])

    return minimise_in_box(objective, x, terms.high)


def _with_bowl(own: Jet, points: FloatArray, weight: FloatArray | float, pull: FloatArray) -> Jet:
    """Plus ``weight |p|^2 + 2 pull . p``."""
    weights = np.broadcast_to(weight, len(points))
    bowl = weights * (points**2).sum(axis=1) + 2.0 * (pull * points).sum(axis=1)
    curvature = own.curvature + 2.0 * weights[:, None, None] * np.eye(2)
    return Jet(own.value + bowl, own.slope + 2.0 * (weights[:, None] * points + pull), curvature)


def look_around(terms: Terms, x: FloatArray) -> tuple[FloatArray, int]:
    """Each cell's best cuts in its whole square, neighbours and forces fixed.

    Cells of one colour of a chessboard at a time, so that the sum never rises.

    Returns:
        (N, 2) cuts and how many cells moved.
    """
    x = x.copy()
    force = terms.force_of(terms.log_stress(x))
    row, column = np.divmod(np.arange(len(x)), terms.shape[1])
    moved = 0
    for colour in range(2):
        cells = np.flatnonzero((row + column) % 2 == colour)
        weight = terms.smooth.diagonal()
        pull = terms.smooth @ x - weight[:, None] * x
        for start in range(0, len(cells), BLOCK):
            some = cells[start : start + BLOCK]
            places, of = _elsewhere(terms, x, some, force, weight, pull)
            if not len(of):
                continue

            def objective(points: FloatArray, which: IntArray) -> Jet:
                cell = of[which]  # noqa: B023 (used before the next turn)
                own = terms.own(points, cell, force)
                return _with_bowl(own, points, weight[cell], pull[cell])  # noqa: B023

            places = minimise_in_box(objective, places, terms.high)
            value = objective(places, np.arange(len(of))).value
            order = np.lexsort((value, of))
            best = order[np.concatenate(([True], np.diff(of[order]) > 0))]
            of, places, value = of[best], places[best], value[best]
            now = _with_bowl(terms.own(x[of], of, force), x[of], weight[of], pull[of]).value
            better = value < now - BETTER * (1.0 + np.abs(now))
            x[of[better]] = places[better]
            moved += int(better.sum())
    return x, moved


def _elsewhere(
    terms: Terms,
    x: FloatArray,
    cells: IntArray,
    force: FloatArray,
    weight: FloatArray,
    pull: FloatArray,
) -> tuple[FloatArray, IntArray]:
    """(k, 2) places of a grid where a cell might be better off than at x, and (k,) the cells."""
    ticks = np.linspace(0.0, terms.high, 1 + max(4, round(terms.high / COARSE)))
    grid = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1)
    square = (grid**2).sum(axis=-1)
    nu = terms.nu.on_grid(ticks, ticks, cells) - terms.target[cells, None, None]
    level = terms.log_strain[cells] - force[cells % terms.shape[1]]
    uneven = terms.stress.on_grid(ticks, ticks, cells) + level[:, None, None]
    # What half a step of the grid makes of either quantity is no error yet.
    cost = nu**2 * _softened(terms.nu_weight[cells], 2 * COARSE)[:, None, None]
    cost += uneven**2 * _softened(terms.force_weight[cells], 4 * COARSE)[:, None, None]
    cost += weight[cells, None, None] * square + 2.0 * np.einsum("kc,abc->kab", pull[cells], grid)
    here = _with_bowl(terms.own(x[cells], cells, force), x[cells], weight[cells], pull[cells])
    places, of = starts_of(cost, ticks, PLACES)
    i, j = (np.rint(places[:, side] / ticks[1]).astype(np.int64) for side in range(2))
    far = np.abs(places - x[cells[of]]).max(axis=1) > COARSE
    hopeful = far & (cost[of, i, j] < here.value[of])
    return places[hopeful], cells[of[hopeful]]


def _softened(weight: FloatArray, sd: float) -> FloatArray:
    """(k,) 1 / (1 / weight^2 + sd^2); 0 where the weight is."""
    return np.asarray(weight**2 / (1.0 + (sd * weight) ** 2))
