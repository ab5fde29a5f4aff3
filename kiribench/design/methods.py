"""The methods of design: from the targets of a patch to its cuts."""

from __future__ import annotations

from kiribench.design.limits import Limits
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.design.result import Designed
from kiribench.design.surrogates import Surrogates
from kiribench.errors import UsageError

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
        UsageError: the method is unknown, the strain measures differ, or ``balanced`` is asked
            for without a surrogate of the stress.
    """
    if method not in METHODS:
        raise UsageError(
            "method-unknown",
            "There is no such method of design.",
            remedy="Choose one of the methods named.",
            got=method,
            expected=", ".join(METHODS),
        )
    raise NotImplementedError(method)
