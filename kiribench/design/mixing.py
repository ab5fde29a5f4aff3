"""What happens when targets in one strain measure meet a surrogate in another.

Nothing fails when it happens: the numbers look alike. So the size of the mistake is worth a figure.
A surrogate in log strain knows its own answer in engineering strain: at the engineering strain E
the log strain is ln(1 + E), the lateral stretch is exp(-nu ln(1 + E)), and Poisson's ratio in
engineering strain is (1 - lateral stretch) / E. Targets in log strain, read as engineering ones,
are designed on that response; the cuts are then judged by the true one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.design.cells import Cells, held_in_data
from kiribench.design.exact import least_cuts
from kiribench.design.response import Jet, KernelResponse, Response

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: measure of the surrogate -> the one that its targets are mistaken for.
MISTAKEN = {"log": "engineering", "engineering": "log", "green": "log"}


@dataclass(frozen=True, eq=False)
class Misread:
    """A response in a strain measure that is not the surrogate's.

    Attributes:
        base: Poisson's ratio in the surrogate's measure.
        strain: (n,) in the surrogate's measure.
        number: (n,) the same strain in the other measure.
        other: lateral strain in the surrogate's measure to the other one, with two derivatives.
    """

    base: Response
    strain: FloatArray
    number: FloatArray
    other: Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]

    @property
    def count(self) -> int:
        """Number of cells, n."""
        return self.base.count

    def on_grid(self, a: FloatArray, b: FloatArray, cells: IntArray | None = None) -> FloatArray:
        """(n, A, B) values on the product of two axes, for some cells or for all."""
        which = np.arange(self.count) if cells is None else cells
        lateral = -self.base.on_grid(a, b, which) * self.strain[which, None, None]
        return np.asarray(-self.other(lateral)[0] / self.number[which, None, None])

    def jet(self, points: FloatArray, cells: IntArray | None = None) -> Jet:
        """Value and derivatives at (k, 2) points, each of its own cell (k,) or of all in order."""
        which = np.arange(len(points)) if cells is None else cells
        at = self.base.jet(points, which)
        e, number = self.strain[which], self.number[which]
        value, first, second = self.other(-at.value * e)
        rate, bend = first * e / number, -second * e * e / number
        outer = at.slope[:, :, None] * at.slope[:, None, :]
        return Jet(
            -value / number,
            rate[:, None] * at.slope,
            rate[:, None, None] * at.curvature + bend[:, None, None] * outer,
        )


@dataclass(frozen=True, eq=False)
class Mixed:
    """Designs of targets that were read in the wrong measure; NaN without a target.

    Attributes:
        read_as: the measure that the targets were mistaken for.
        a, b: (R, C) the cuts that come of it, fractions.
        right_a, right_b: (R, C) the cuts without the mistake.
        error: (R, C) the Poisson's ratio that the wrong cuts truly have, minus the target.
        right_error: (R, C) the same without the mistake.
    """

    read_as: str
    a: FloatArray
    b: FloatArray
    right_a: FloatArray
    right_b: FloatArray
    error: FloatArray
    right_error: FloatArray


def mixed_up(cells: Cells) -> Mixed:
    """Design the targets as if they were in another measure, and judge the cuts truly."""
    read_as = MISTAKEN[cells.surrogates.measure]
    response = misread(cells, read_as)
    tolerance = cells.options.tolerance
    wrong = least_cuts(response, cells.target, cells.high, tolerance).cuts
    right = least_cuts(cells.poisson, cells.target, cells.high, tolerance).cuts
    return Mixed(
        read_as,
        *(cells.on_patch(cuts[:, side]) for cuts in (wrong, right) for side in range(2)),
        *(cells.on_patch(cells.poisson.jet(cuts).value - cells.target) for cuts in (wrong, right)),
    )


def misread(cells: Cells, read_as: str) -> Misread:
    """The surrogate's response at the numbers of the targets, taken for another measure."""
    measure = cells.surrogates.measure
    number = cells.problem.longitudinal_strain.ravel()[cells.place]
    if measure == "log":
        strain = np.log1p(number)
        other = _from_log
    else:
        # Read as log: the stretch is exp(number).
        strain = np.expm1(number) if measure == "engineering" else 0.5 * np.expm1(2.0 * number)
        other = _log_from_engineering if measure == "engineering" else _log_from_green
    held = held_in_data(strain, cells.surrogates)
    return Misread(KernelResponse.of(cells.surrogates.poisson, held), strain, number.copy(), other)


def _from_log(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    stretch = np.exp(y)
    return stretch - 1.0, stretch, stretch


def _log_from_engineering(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    stretch = np.maximum(1.0 + y, 1e-6)
    return np.log(stretch), 1.0 / stretch, -1.0 / stretch**2


def _log_from_green(y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    square = np.maximum(1.0 + 2.0 * y, 1e-6)
    return 0.5 * np.log(square), 1.0 / square, -2.0 / square**2
