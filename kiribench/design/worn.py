"""Cuts that put every corner of the patch on its node of the skin, by the worn model.

Gauss-Newton on the corner positions q(a, b) in skin coordinates, with the exact derivatives of the
discrete worn model. In skin coordinates an overlap does not change with the stretch of the skin
(both cells stretch alike), so a millimetre of q counts the same everywhere. One step minimises

    mean |q + J d - target|^2 + barrier mean(-log distance to the bounds)
        + smoothness mean(difference of neighbours)^2

over the cuts p + d within the bounds and a trust region: all half-cuts are means of cell values,
so the bounds are the ligament constraints. The barrier keeps cuts off their bounds, where the
linear model would drive them (an ill-posed direction: some cuts hardly move a corner).

The patch may be put on in several poses (:mod:`kiribench.design.robust`): then q are the corners
of all of them, each with the derivatives in its own pose.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.design.convex_box import newton_in_box
from kiribench.design.limits import Limits
from kiribench.design.regularisation import Regularisation
from kiribench.design.worn_model import WornModel
from kiribench.errors import NotConvergedError, UsageError
from kiribench.fem.wear import WearSensitivities
from kiribench.lattice import CutMap

FloatArray = NDArray[np.float64]

#: Cuts are kept in [SHORTEST, longest allowed]: a cut of no length has no tip to move.
SHORTEST = 0.02
#: Starts are moved inwards by this share of the range, where the barrier is finite.
MARGIN = 0.02
#: A trust region below this changes no cut by what a laser can cut.
SHORTEST_STEP = 0.002


#: Fields of the wear model's spec that a pose overrides; none where the patch is put on exactly.
Pose = dict[str, Any]
EXACT: Pose = {}


@dataclass(frozen=True)
class WornOptions:
    """How the worn design works.

    Attributes:
        levels: meshes from coarse to fine: elements a facet edge, and at most so many steps.
        trust: largest change of a cut in one step, fraction of the cell edge.
        barrier_mm2, smoothness_mm2: weights, see the module's docstring.
        worth: a step that gains less of the objective (a fraction) is the last of its level.
        poses: that the patch is put on in, all of the same weight, the exact one first.
    """

    levels: tuple[tuple[int, int], ...] = ((6, 8), (10, 3))
    trust: float = 0.3
    barrier_mm2: float = 0.05
    smoothness_mm2: float = 2e-3
    worth: float = 0.01
    poses: tuple[Pose, ...] = (EXACT,)

    def __post_init__(self) -> None:
        fine = all(elements >= 3 and steps >= 1 for elements, steps in self.levels)
        if not self.levels or not fine or not self.trust > 0:
            raise UsageError(
                "worn-options",
                "The worn design needs at least one step, a trust region and 3 elements a facet.",
                remedy="Give larger numbers.",
                got=f"trust {self.trust:g}, levels {self.levels}",
            )

    @property
    def steps(self) -> int:
        """The most steps that there can be."""
        return sum(steps for _, steps in self.levels)


@dataclass(frozen=True, eq=False)
class Iteration:
    """One accepted state of the design.

    Attributes:
        a, b: (R, C) cut lengths / cell edge.
        corner_q_mm: (R+1, C+1, 2) where the corners lie, put on exactly.
        elements: of the mesh that says so.
        rms_mm, worst_mm: distance of these corners from their nodes, in skin coordinates.
        posed_rms_mm: rms distance over all poses.
        objective_mm2: mean over all poses, with barrier and smoothness.
        step: largest change of a cut that led here.
        cpu_seconds: since the start.
    """

    a: FloatArray
    b: FloatArray
    corner_q_mm: FloatArray
    elements: int
    rms_mm: float
    worst_mm: float
    posed_rms_mm: float
    objective_mm2: float
    step: float
    cpu_seconds: float


@dataclass(frozen=True, eq=False)
class WornDesign:
    """A design by the worn model, with its course.

    Attributes:
        cut_map: the result. iterations: the states on the way, the start first.
        options, limits: of the design. poses: those of the options in which the start has an
            equilibrium; the others were left out.
        at_bounds: cuts within 1 % of the range of a bound.
        reason: why it stopped. cpu_seconds: processor time.
    """

    cut_map: CutMap
    iterations: tuple[Iteration, ...]
    options: WornOptions
    limits: Limits
    poses: tuple[Pose, ...]
    at_bounds: int
    reason: str
    cpu_seconds: float


def distances(corner_q_mm: FloatArray, model: WornModel) -> tuple[float, float]:
    """rms and largest distance of the corners from their nodes, mm in skin coordinates."""
    apart = np.linalg.norm(corner_q_mm - model.target_q_mm, axis=-1)[model.weight > 0]
    return float(np.sqrt((apart**2).mean())), float(apart.max())


def design_worn(
    model: WornModel,
    start: CutMap,
    limits: Limits | None = None,
    options: WornOptions | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> WornDesign:
    """Fit the cuts so that the corners of the worn patch lie on their nodes.

    Args:
        model: of the worn patch.
        start: any design; `balanced` needs the fewest steps.
        limits: of the cut lengths.
        progress: called with (done, total) steps.

    Raises:
        NotConvergedError: ``worn-start``; the start itself has no equilibrium.
    """
    limits, options = limits or Limits(), options or WornOptions()
    began = time.process_time()
    low, high = SHORTEST, limits.longest(start.cell_mm)
    if not high > low + 0.05:
        raise UsageError(
            "worn-no-range",
            "The limits leave no range of cut lengths to design in.",
            remedy="Use a smaller ligament or kerf, or larger cells.",
            got=f"{low:g} to {high:.3f}",
        )
    shape = start.a.shape
    inset = MARGIN * (high - low)
    p = np.clip(np.concatenate([start.a.ravel(), start.b.ravel()]), low + inset, high - inset)
    regular = Regularisation(shape, low, high, options.barrier_mm2, options.smoothness_mm2)

    def map_of(cuts: FloatArray) -> CutMap:
        a, b = cuts.reshape(2, *shape)
        return CutMap(a, b, start.cell_mm)

    def state(cuts: FloatArray, worn: Posed, elements: int, step: float) -> Iteration:
        exact = worn.corner_q_mm[0]
        rms, worst = distances(exact, model)
        a, b = cuts.reshape(2, *shape)
        off = misfit(worn.corner_q_mm, model)
        return Iteration(
            a, b, exact, elements, rms, worst, float(np.sqrt(2 * off)),
            off + regular.value(cuts), step, time.process_time() - began,
        )  # fmt: skip

    history: list[Iteration] = []
    poses = options.poses
    reason, done = "all steps were taken", 0
    for elements, steps in options.levels:
        # Another mesh has another misfit: steps are compared on one mesh only.
        poses, found = _standing(model, map_of(p), elements, poses)
        if found is None and not history:
            raise NotConvergedError(
                "worn-start",
                "The patch that the design starts from has no equilibrium on this skin.",
                remedy="Start from another method, such as 'uniform'.",
            )
        if found is None:
            reason = f"no equilibrium at {elements} elements a facet"
            break
        history.append(state(p, found, elements, 0.0))
        trust, reason = options.trust, "all steps were taken"
        for _ in range(steps):
            if progress is not None:
                progress(done, options.steps)
            before, taken, after = history[-1], None, None
            while trust > SHORTEST_STEP:
                step = model_step(p, found, model, regular, trust)
                trial = p + step
                after = _tried(model, map_of(trial), elements, poses)
                if after is not None:
                    new = state(trial, after, elements, float(np.abs(step).max()))
                    if new.objective_mm2 < before.objective_mm2:
                        taken = new
                        break
                trust /= 4
            if taken is None or after is None:
                reason = "no shorter step made it better"
                break
            p, found, trust = trial, after, min(2 * trust, options.trust)
            history.append(taken)
            done += 1
            if before.objective_mm2 - taken.objective_mm2 < options.worth * before.objective_mm2:
                reason = f"the last step gained less than {options.worth:.0%}"
                break
    if progress is not None:
        progress(options.steps, options.steps)
    return WornDesign(
        cut_map=map_of(p),
        iterations=tuple(history),
        options=options,
        limits=limits,
        poses=poses,
        at_bounds=regular.at_bounds(p),
        reason=reason,
        cpu_seconds=time.process_time() - began,
    )


@dataclass(frozen=True, eq=False)
class Posed:
    """A patch in s poses.

    Attributes:
        corner_q_mm: (s, R+1, C+1, 2) where its corners lie.
        corner_q: (s (R+1) (C+1) 2, n) their derivatives by the cuts, mm.
    """

    corner_q_mm: FloatArray
    corner_q: FloatArray


def _standing(
    model: WornModel, cut_map: CutMap, elements: int, poses: tuple[Pose, ...]
) -> tuple[tuple[Pose, ...], Posed | None]:
    """The poses with an equilibrium and the patch in them; None where the exact one has none."""
    found = [(pose, _solved(model, cut_map, elements, pose)) for pose in poses]
    kept = [(pose, one) for pose, one in found if one is not None]
    if found[0][1] is None:
        return poses, None
    return tuple(pose for pose, _ in kept), _together([one for _, one in kept])


def _tried(
    model: WornModel, cut_map: CutMap, elements: int, poses: tuple[Pose, ...]
) -> Posed | None:
    """The patch in all poses, or None where one of them has no equilibrium."""
    found = []
    for pose in poses:
        one = _solved(model, cut_map, elements, pose)
        if one is None:
            return None
        found.append(one)
    return _together(found)


def _solved(
    model: WornModel, cut_map: CutMap, elements: int, pose: Pose
) -> WearSensitivities | None:
    try:
        found = model.sensitivities(cut_map, elements, **pose)
    except NotConvergedError:
        return None
    return found if found.worn.status == "ok" else None


def _together(found: list[WearSensitivities]) -> Posed:
    return Posed(
        np.stack([one.worn.corner_q_mm for one in found]),
        np.concatenate([one.corner_q for one in found]),
    )


def misfit(corner_q_mm: FloatArray, model: WornModel) -> float:
    """Mean square of the two components of the corners' distances, mm^2.

    Args:
        corner_q_mm: (..., R+1, C+1, 2), any number of poses; unseen nodes do not count.
    """
    off = np.nan_to_num(corner_q_mm - model.target_q_mm)
    count = 2 * model.weight.sum() * (off.size / model.target_q_mm.size)
    return float((model.weight[..., None] * off**2).sum() / count)


def model_step(
    p: FloatArray, found: Posed, model: WornModel, regular: Regularisation, trust: float
) -> FloatArray:
    """The change of the cuts that is best by the linearised corners, within the trust region."""
    off = np.nan_to_num(found.corner_q_mm - model.target_q_mm)
    weight = np.broadcast_to(model.weight[..., None], off.shape).ravel()
    weight, off = weight / weight.sum(), off.ravel()
    normal = 2 * (found.corner_q.T * weight) @ found.corner_q
    slope = 2 * (found.corner_q.T * weight) @ off
    level = float((weight * off**2).sum())

    def jet(step: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        gradient, hessian = regular.jet(p + step)
        bent = normal @ step
        value = level + float(slope @ step + 0.5 * step @ bent) + regular.value(p + step)
        return value, slope + bent + gradient, normal + hessian

    # The barrier is infinite at the bounds: stay a little inside of them.
    inset = 1e-4 * (regular.high - regular.low)
    low = np.maximum(-trust, regular.low + inset - p)
    high = np.minimum(trust, regular.high - inset - p)
    return newton_in_box(jet, np.zeros_like(p), np.minimum(low, 0.0), np.maximum(high, 0.0))
