"""Several designs of one patch beside each other, with the best uniform sheet as the control."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kiribench.conformability.grades import ROUNDING
from kiribench.conformability.result import FAIR_FROM, GOOD_FROM
from kiribench.design.limits import Limits
from kiribench.errors import NotConvergedError
from kiribench.fem.material import Material
from kiribench.reference.check import CheckedDesign, CheckOptions, check_design, put_on
from kiribench.reference.ground import Ground
from kiribench.schema.patch_design import PatchDesign

#: Uniform sheets that are tried, a = b.
TRIED = (0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
#: The control is looked for on this mesh, and reported on the mesh of the others.
COARSE = 6
CONTROL = "best uniform"


@dataclass(frozen=True)
class UniformTrial:
    """One uniform sheet: its cut length and how it did on the coarse mesh."""

    fraction: float
    mean_overlap: float
    fair: float
    good: float


def best_uniform(
    like: PatchDesign,
    ground: Ground,
    options: CheckOptions | None = None,
    *,
    limits: Limits | None = None,
    material: Material | None = None,
) -> tuple[CheckedDesign, tuple[UniformTrial, ...]]:
    """The uniform sheet a = b with the largest mean overlap by the worn model itself.

    It is chosen with what the other designs are judged by, so it is the strongest control.

    Args:
        like: a design with the same cells, targets and regions.
        ground, options, material: as in :func:`kiribench.reference.check.check_design`.
        limits: of the cut lengths.

    Raises:
        NotConvergedError: none of the sheets has an equilibrium.
    """
    options, limits = options or CheckOptions(), limits or Limits()
    longest = limits.longest(like.cell_mm)
    # A hundred draws are the fewest that the score allows; the trials need none of them.
    rough = replace(options.score, samples=100)
    trials = []
    for fraction in dict.fromkeys(min(one, longest) for one in TRIED):
        design = uniform_like(like, fraction)
        try:
            worn = put_on(design, ground, options, COARSE, material)
        except NotConvergedError:
            continue
        overlap = ground.score(worn.corner_q_mm, design, rough).overlap
        known = overlap[np.isfinite(overlap)]
        trials.append(
            UniformTrial(
                fraction,
                float(known.mean()),
                float((known >= FAIR_FROM - ROUNDING).mean()),
                float((known >= GOOD_FROM - ROUNDING).mean()),
            )
        )
    if not trials:
        raise NotConvergedError(
            "check-no-uniform",
            "No uniform sheet has an equilibrium here.",
            remedy="Leave the control out with --no-uniform.",
        )
    best = max(trials, key=lambda one: one.mean_overlap)
    checked = check_design(uniform_like(like, best.fraction), ground, options, material)
    return checked, tuple(trials)


def uniform_like(like: PatchDesign, fraction: float) -> PatchDesign:
    """A uniform sheet with the cells and targets of another design."""
    kept = {
        name: values
        for name, values in like.quantities.items()
        if not name.startswith("predicted_")
    }
    return replace(
        like,
        method=CONTROL,
        a=np.full(like.shape, fraction),
        b=np.full(like.shape, fraction),
        quantities=kept,
        settings={},
        file=None,
    )
