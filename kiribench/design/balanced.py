"""All cells at once: targets, equal force in series, neighbours that go together.

Nothing in a target of Poisson's ratio makes a cell reach its strain. Cells of one column of the
pull are in series: they carry the same force, so each one's nominal stress at its own target
strain must be the same (all cells have the same undeformed width and thickness). The sum of

- ``((nu - target) / poisson_sd)^2`` in every cell with a target,
- ``((ln stress - ln force of the column) / force_sd)^2`` in every cell with a strain,
- ``((a - a') / neighbour_sd)^2`` and the same of b for every two cells with a common side,
- ``(a / 10)^2 + (b / 10)^2``, which makes the answer unique where nothing else does,

is minimised within the limits, over all cuts and the columns' forces: on a table of the surrogate
from cuts of half the longest in all cells, until no cell would be better off anywhere else in its
square; then on the surrogate itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kiribench.design.balance_search import descend, look_around
from kiribench.design.balance_terms import Terms, smoothness
from kiribench.design.cells import Cells, held_in_data
from kiribench.design.reachable import Reachable
from kiribench.design.response import KernelResponse
from kiribench.design.strain_table import StrainTable
from kiribench.errors import UsageError
from kiribench.surrogate.kept_model import KeptModel

FloatArray = NDArray[np.float64]

LEAST_STRAIN = 0.005  # below it a cell has no force to speak of
ROUNDS = 10  # of all cells together, then each by itself


@dataclass(frozen=True, eq=False)
class Balanced:
    """The answer.

    Attributes:
        cuts: (N, 2) a, b of all R C cells, fractions.
        log_stress: (N,) ln of the nominal stress in MPa at the target strain; NaN without one.
        log_force: (C,) ln of the nominal stress that each column settles on; NaN where no cell
            of it is pulled.
        objective: the sum.
        steps: of all cells together.
        moved: cells that were better off elsewhere after the first descent.
        converged: whether the last step promised next to nothing and no cell would move.
    """

    cuts: FloatArray
    log_stress: FloatArray
    log_force: FloatArray
    objective: float
    steps: int
    moved: int
    converged: bool


def balance(cells: Cells, span: Reachable) -> Balanced:
    """Solve for the whole patch.

    Args:
        cells: with targets.
        span: their reachable ranges; a target out of reach is replaced by the nearest in it.

    Raises:
        UsageError: the surrogate has no stress.
    """
    terms = terms_of(cells, span)
    rough = tabulated(terms, cells)
    x = np.full((len(terms.target), 2), 0.5 * cells.high)
    steps = moved = 0
    settled = False
    for _ in range(ROUNDS):
        found = descend(rough, x)
        steps += len(found.values) - 1
        x, better = look_around(rough, found.at.x)
        moved += better
        settled = not better
        if settled:
            break
    last = descend(terms, x)
    steps += len(last.values) - 1
    pulled = terms.force_weight > 0
    columns = np.bincount(terms.column, pulled, cells.problem.shape[1]) > 0
    return Balanced(
        cuts=last.at.x,
        log_stress=np.where(pulled, terms.log_stress(last.at.x), np.nan),
        log_force=np.where(columns, last.at.force, np.nan),
        objective=last.at.value,
        steps=steps,
        moved=moved,
        converged=last.converged and settled,
    )


def terms_of(cells: Cells, span: Reachable) -> Terms:
    """The sum's parts on the surrogate itself; raises where it has no stress."""
    problem, options = cells.problem, cells.options
    model = _stress(cells)
    strain = problem.longitudinal_strain.ravel()
    with np.errstate(invalid="ignore"):
        pulled = strain > LEAST_STRAIN
    target = np.zeros(strain.size)
    target[cells.place] = span.nearest(cells.target)
    wanted = np.zeros(strain.size, dtype=bool)
    wanted[cells.place] = True
    held = _strain(cells)
    return Terms(
        nu=KernelResponse.of(cells.surrogates.poisson, held),
        stress=KernelResponse.of(model, held),
        target=target,
        # The secant modulus of the nearest strain in the data times the strain itself.
        log_strain=np.log(np.where(pulled, strain, 1.0)),
        nu_weight=wanted / options.poisson_sd,
        force_weight=pulled / options.force_sd,
        smooth=smoothness(problem.shape, options.neighbour_sd),
        shape=problem.shape,
        high=cells.high,
    )


def tabulated(terms: Terms, cells: Cells) -> Terms:
    """The same sum on tables of the surrogate."""
    strain = _strain(cells)
    return replace(
        terms,
        nu=StrainTable.of(cells.surrogates.poisson, strain, cells.high),
        stress=StrainTable.of(_stress(cells), strain, cells.high),
    )


def _stress(cells: Cells) -> KeptModel:
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
    return model


def _strain(cells: Cells) -> FloatArray:
    """(N,) strains within the data; the smallest where a cell has none, and no weight either."""
    strain = cells.problem.longitudinal_strain.ravel()
    known = np.where(np.isfinite(strain), strain, -np.inf)
    return held_in_data(known, cells.surrogates)
