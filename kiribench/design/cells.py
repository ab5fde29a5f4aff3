"""The cells of a problem, ready for a search: strains, targets and responses side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.limits import Limits
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.design.response import KernelResponse
from kiribench.design.surrogates import Surrogates
from kiribench.errors import UsageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cells:
    """The n cells of a problem that have a target, in row-major order.

    Attributes:
        problem, surrogates, limits, options: as given to the method.
        high: longest cut, fraction of the cell edge.
        place: (n,) flat index of each cell in the patch.
        strain: (n,) target strain, held within the surrogate's data.
        target: (n,) target Poisson's ratio.
        poisson: response of the n cells.
    """

    problem: DesignProblem
    surrogates: Surrogates
    limits: Limits
    options: DesignOptions
    high: float
    place: NDArray[np.int64]
    strain: FloatArray
    target: FloatArray
    poisson: KernelResponse

    def __len__(self) -> int:
        return len(self.place)

    def on_patch(self, values: FloatArray) -> FloatArray:
        """(R, C) of n values, NaN where a cell has no target."""
        full = np.full(self.problem.shape, np.nan)
        full.ravel()[self.place] = values
        return full


def cells_of(
    problem: DesignProblem, surrogates: Surrogates, limits: Limits, options: DesignOptions
) -> Cells:
    """Check that problem and surrogate speak of the same strain, and make the responses.

    Raises:
        UsageError: the strain measures differ, no cell has a target, or the surrogate is no
            exact Gaussian process.
    """
    surrogates.check_measure(problem)
    if not problem.wanted.any():
        raise UsageError(
            "targets-empty",
            "No cell of the patch has a target.",
            remedy="Look at the reasons in the table of kiribench measure.",
        )
    place = np.flatnonzero(problem.wanted)
    kept = surrogates.poisson
    strain = held_in_data(problem.longitudinal_strain.ravel()[place], surrogates)
    return Cells(
        problem=problem,
        surrogates=surrogates,
        limits=limits,
        options=options,
        high=limits.longest(problem.cell_mm),
        place=place,
        strain=strain,
        target=problem.poisson_ratio.ravel()[place],
        poisson=KernelResponse.of(kept, strain),
    )


def held_in_data(strain: FloatArray, surrogates: Surrogates) -> FloatArray:
    """Strains held within those of the surrogate's data: a surrogate never extrapolates."""
    low, high = surrogates.poisson.low[2], surrogates.poisson.high[2]
    return np.asarray(np.clip(strain, low, high))
