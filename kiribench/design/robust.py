"""Cuts for a patch that is not put on exactly: good on average over placement errors and noise.

The nominal design knows one pose. Here the patch is put on in nine: as it should be, and in eight
in which everything is wrong at once, each error by one standard deviation one way or the other.
The eight are the runs of an orthogonal array of strength three (the half fraction of 2^4), so the
mean over them is exact for every cubic of independent symmetric errors (Victoir 2004, doi
10.1137/S0036142902407952); a strap only slips back, so its two levels have the mean and the
deviation of a half-normal draw.

What is minimised is the mean square distance of the corners from their nodes over all poses, with
the exact derivatives in every pose: only these know that some cuts let the patch slide farther
than it was put on wrongly, and others hold it. Independent errors of the nodes add their variance
to this mean whatever the cuts are, so the design for them is the same. Overlaps themselves make a
poor objective: they have a kink where a cell fits, and by `paper` an oversized cell costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from math import pi, sqrt

import numpy as np

from kiribench.design.limits import Limits
from kiribench.design.worn import EXACT, Pose, WornDesign, WornOptions, design_worn
from kiribench.design.worn_model import WornModel
from kiribench.lattice import CutMap

#: The mesh is coarse (what placement does is many times its error) and the start is near.
ROBUST = WornOptions(levels=((6, 3),), trust=0.15, worth=0.03)


@dataclass(frozen=True)
class Spread:
    """Standard deviations of what goes wrong.

    Attributes:
        along_mm, across_mm: of the place. turn_deg: of the turn. slip_mm: of the normal draw
            whose size the distal strap slips (it only slips back). node_mm: of every corner's
            node, in each direction.
    """

    along_mm: float = 1.0
    across_mm: float = 0.3
    turn_deg: float = 0.5
    slip_mm: float = 1.0
    node_mm: float = 0.25

    def poses(self) -> tuple[Pose, ...]:
        """The exact pose, and the runs of the orthogonal array (see the module's docstring)."""
        found = [EXACT]
        for one, two, three in product((-1.0, 1.0), repeat=3):
            slip = sqrt(2 / pi) + one * two * three * sqrt(1 - 2 / pi)
            pose: Pose = {
                "offset_mm": (two * self.across_mm, one * self.along_mm),
                "turn_deg": three * self.turn_deg,
                "strap_slip_mm": slip * self.slip_mm,
            }
            # Where an error is left out, runs are equal in pairs.
            if pose not in found:
                found.append(pose)
        return tuple(found)

    def draw(self, count: int, rng: np.random.Generator) -> list[Pose]:
        """Random poses: three normal errors of the place and the turn, a half-normal slip."""
        sizes = (self.across_mm, self.along_mm, self.turn_deg, self.slip_mm)
        return [
            {
                "offset_mm": (float(across), float(along)),
                "turn_deg": float(turn),
                "strap_slip_mm": float(abs(slip)),
            }
            for across, along, turn, slip in rng.standard_normal((count, 4)) * sizes
        ]


def design_robust(
    model: WornModel,
    start: CutMap,
    limits: Limits | None = None,
    options: WornOptions = ROBUST,
    spread: Spread | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> WornDesign:
    """Improve a design on average over errors of placement and of the nodes.

    Args:
        model: of the worn patch, in any pose.
        start: a nominal design, such as `worn`.
        limits: of the cut lengths. options: its poses are replaced. spread: of the errors.
        progress: called with (done, total) steps.

    Returns:
        Its iterations are the exact pose; their objective is the mean over all poses in which the
        start has an equilibrium.

    Raises:
        NotConvergedError: ``worn-start``; the start has no equilibrium in the exact pose.
    """
    poses = (spread or Spread()).poses()
    return design_worn(model, start, limits, replace(options, poses=poses), progress=progress)
