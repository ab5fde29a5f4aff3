"""Cuts that put every corner of the patch on its node of the skin, by the worn model.

Gauss-Newton on the corner positions q(a, b) in skin coordinates, with the exact derivatives of the
discrete worn model. In skin coordinates an overlap does not change with the stretch of the skin
(both cells stretch alike), so a millimetre of q counts the same everywhere. One step minimises

    mean |q + J d - target|^2 + barrier mean(-log distance to the bounds)
        + smoothness mean(difference of neighbours)^2

over the cuts p + d within the bounds and a trust region: all half-cuts are means of cell values,
so the bounds are the ligament constraints. The barrier keeps cuts off their bounds, where the
linear model would drive them (an ill-posed direction: some cuts hardly move a corner).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.design.limits import Limits
from kiribench.design.skin import Skin
from kiribench.errors import NotConvergedError, UsageError
from kiribench.fem.material import Material
from kiribench.fem.wear import (
    WearSensitivities,
    WearSpec,
    WornPatch,
    wear_patch,
    wear_sensitivities,
)
from kiribench.lattice import CutMap
from kiribench.schema.patch_design import PatchDesign

FloatArray = NDArray[np.float64]

#: Cuts are kept in [SHORTEST, longest allowed]: a cut of no length has no tip to move.
SHORTEST = 0.02
#: Starts are moved inwards by this share of the range, where the barrier is finite.
MARGIN = 0.02
#: A trust region below this changes no cut by what a laser can cut.
SHORTEST_STEP = 0.002


@dataclass(frozen=True)
class WornOptions:
    """How the worn design works.

    Attributes:
        levels: meshes from coarse to fine: elements a facet edge, and at most so many steps.
        trust: largest change of a cut in one step, fraction of the cell edge.
        barrier_mm2, smoothness_mm2: weights, see the module's docstring.
        converged_mm: a level ends where the rms distance of the corners falls by less in a step.
    """

    levels: tuple[tuple[int, int], ...] = ((6, 8), (10, 3))
    trust: float = 0.3
    barrier_mm2: float = 1e-3
    smoothness_mm2: float = 2e-3
    converged_mm: float = 0.01

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


class WornModel(Protocol):
    """What carries a cut map to corner positions; :class:`KneeModel` or a stand-in of it."""

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) where the corners belong, skin coordinates."""
        ...

    @property
    def weight(self) -> FloatArray:
        """(R+1, C+1) 1 where the skin node was seen, else 0."""
        ...

    def worn(self, cut_map: CutMap, elements: int) -> WornPatch:
        """The patch in equilibrium."""
        ...

    def sensitivities(self, cut_map: CutMap, elements: int) -> WearSensitivities:
        """The same with the derivatives of its corners."""
        ...


@dataclass(frozen=True, eq=False)
class KneeModel:
    """The worn model on a subject's skin.

    Attributes:
        skin: the flexed skin.
        spec: how the patch is put on; its mesh is replaced.
        material: None is the paper's.
    """

    skin: Skin
    spec: WearSpec = field(default_factory=WearSpec)
    material: Material | None = None

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) where the corners belong."""
        return self.skin.target_q_mm

    @property
    def weight(self) -> FloatArray:
        """(R+1, C+1) 1 where the skin node was seen, else 0."""
        return self.skin.under.present.astype(np.float64)

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        """The patch in equilibrium; ``pose`` overrides fields of the spec (offset, turn, slip)."""
        spec = replace(self.spec, elements_per_facet=elements, **pose)
        return wear_patch(cut_map, self.skin.surface, self.skin.origin_q_mm, spec, self.material)

    def sensitivities(self, cut_map: CutMap, elements: int) -> WearSensitivities:
        """The same with the derivatives of its corners."""
        spec = replace(self.spec, elements_per_facet=elements)
        return wear_sensitivities(
            cut_map, self.skin.surface, self.skin.origin_q_mm, spec, self.material
        )


@dataclass(frozen=True, eq=False)
class Iteration:
    """One accepted state of the design.

    Attributes:
        a, b: (R, C) cut lengths / cell edge.
        corner_q_mm: (R+1, C+1, 2) where the corners lie.
        elements: of the mesh that says so.
        rms_mm, worst_mm: distance of the corners from their nodes, in skin coordinates.
        objective_mm2: with barrier and smoothness. step: largest change of a cut that led here.
        cpu_seconds: since the start.
    """

    a: FloatArray
    b: FloatArray
    corner_q_mm: FloatArray
    elements: int
    rms_mm: float
    worst_mm: float
    objective_mm2: float
    step: float
    cpu_seconds: float


@dataclass(frozen=True, eq=False)
class WornDesign:
    """A design by the worn model, with its course.

    Attributes:
        cut_map: the result. iterations: the states on the way, the start first.
        options, limits: of the design. at_bounds: cuts within 1 % of the range of a bound.
        reason: why it stopped. cpu_seconds: processor time.
    """

    cut_map: CutMap
    iterations: tuple[Iteration, ...]
    options: WornOptions
    limits: Limits
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

    def state(cuts: FloatArray, worn: WornPatch, elements: int, step: float) -> Iteration:
        rms, worst = distances(worn.corner_q_mm, model)
        a, b = cuts.reshape(2, *shape)
        value = misfit(worn.corner_q_mm, model) + regular.value(cuts)
        return Iteration(
            a, b, worn.corner_q_mm, elements, rms, worst, value, step,
            time.process_time() - began,
        )  # fmt: skip

    history: list[Iteration] = []
    reason, done = "all steps were taken", 0
    for elements, steps in options.levels:
        # Another mesh has another misfit: steps are compared on one mesh only.
        found = _tried(model, map_of(p), elements)
        if found is None and not history:
            raise NotConvergedError(
                "worn-start",
                "The patch that the design starts from has no equilibrium on this skin.",
                remedy="Start from another method, such as 'uniform'.",
            )
        if found is None:
            reason = f"no equilibrium at {elements} elements a facet"
            break
        history.append(state(p, found.worn, elements, 0.0))
        trust, reason = options.trust, "all steps were taken"
        for _ in range(steps):
            if progress is not None:
                progress(done, options.steps)
            before, taken, after = history[-1], None, None
            while trust > SHORTEST_STEP:
                step = model_step(p, found, model, regular, trust)
                trial = p + step
                after = _tried(model, map_of(trial), elements)
                if after is not None:
                    new = state(trial, after.worn, elements, float(np.abs(step).max()))
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
            if before.rms_mm - taken.rms_mm < options.converged_mm:
                reason = f"the last step gained less than {options.converged_mm:g} mm"
                break
    if progress is not None:
        progress(options.steps, options.steps)
    near = 0.01 * (high - low)
    return WornDesign(
        cut_map=map_of(p),
        iterations=tuple(history),
        options=options,
        limits=limits,
        at_bounds=int(((p < low + near) | (p > high - near)).sum()),
        reason=reason,
        cpu_seconds=time.process_time() - began,
    )


def _tried(model: WornModel, cut_map: CutMap, elements: int) -> WearSensitivities | None:
    """The patch with its derivatives, or None where it has no equilibrium."""
    try:
        found = model.sensitivities(cut_map, elements)
    except NotConvergedError:
        return None
    return found if found.worn.status == "ok" else None


def misfit(corner_q_mm: FloatArray, model: WornModel) -> float:
    """Weighted mean square of the two components of the corners' distances, mm^2."""
    weight = np.repeat(model.weight.ravel(), 2)
    off = (corner_q_mm - model.target_q_mm).ravel()
    return float((weight * np.nan_to_num(off) ** 2).sum() / weight.sum())


@dataclass(frozen=True)
class Regularisation:
    """Barrier and smoothness of 2 R C cuts, mm^2.

    Attributes:
        shape: (R, C). low, high: bounds of the cuts. barrier, smoothness: weights, mm^2.
    """

    shape: tuple[int, int]
    low: float
    high: float
    barrier: float
    smoothness: float

    def value(self, p: FloatArray) -> float:
        """Of cuts p (2 R C,) strictly within the bounds."""
        width = self.high - self.low
        to_bounds = -np.log((p - self.low) / width) - np.log((self.high - p) / width)
        rough = p @ self._roughness() @ p
        return float(self.barrier * to_bounds.mean() + self.smoothness * rough)

    def jet(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (n,) and Hessian (n, n)."""
        count = len(p)
        near, far = 1.0 / (p - self.low), 1.0 / (self.high - p)
        rough = self._roughness()
        gradient = self.barrier / count * (far - near) + 2 * self.smoothness * rough @ p
        hessian = np.diag(self.barrier / count * (near**2 + far**2)) + 2 * self.smoothness * rough
        return gradient, hessian

    def _roughness(self) -> FloatArray:
        """(n, n) matrix of the mean square difference of neighbouring cells, per kind of cut."""
        rows, columns = self.shape
        number = np.arange(rows * columns).reshape(rows, columns)
        pairs = np.concatenate(
            [
                np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2),
                np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2),
            ]
        )
        one = np.zeros((len(pairs), rows * columns))
        one[np.arange(len(pairs)), pairs[:, 0]] = -1.0
        one[np.arange(len(pairs)), pairs[:, 1]] = 1.0
        square = one.T @ one / max(1, 2 * len(pairs))
        return np.asarray(np.kron(np.eye(2), square))


def model_step(
    p: FloatArray,
    found: WearSensitivities,
    model: WornModel,
    regular: Regularisation,
    trust: float,
) -> FloatArray:
    """The change of the cuts that is best by the linearised corners, within the trust region."""
    weight = np.repeat(model.weight.ravel(), 2)
    weight = weight / weight.sum()
    off = np.nan_to_num((found.worn.corner_q_mm - model.target_q_mm).ravel())
    normal = 2 * (found.corner_q.T * weight) @ found.corner_q
    slope = 2 * (found.corner_q.T * weight) @ off

    def jet(step: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        gradient, hessian = regular.jet(p + step)
        left = off + found.corner_q @ step
        value = float((weight * left**2).sum()) + regular.value(p + step)
        return value, slope + normal @ step + gradient, normal + hessian

    # The barrier is infinite at the bounds: stay a little inside of them.
    inset = 1e-4 * (regular.high - regular.low)
    low = np.maximum(-trust, regular.low + inset - p)
    high = np.minimum(trust, regular.high - inset - p)
    return newton_in_box(jet, np.zeros_like(p), np.minimum(low, 0.0), np.maximum(high, 0.0))


Jet = Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]


def newton_in_box(
    jet: Jet, start: FloatArray, low: FloatArray, high: FloatArray, *, steps: int = 60
) -> FloatArray:
    """Minimum of a smooth convex function in a box, by Newton steps of the free variables.

    Bertsekas (1982, doi 10.1137/0320018): variables at a bound that the slope holds there are
    left out; the step of the others is shortened until the function falls.

    Args:
        jet: value, gradient (n,) and positive definite Hessian (n, n).
        start, low, high: (n,), the start within the bounds.
    """
    x = start.copy()
    value, gradient, hessian = jet(x)
    for _ in range(steps):
        held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
        free = ~held
        if np.abs(gradient[free]).max(initial=0.0) < 1e-12 * max(1.0, abs(value)):
            break
        direction = np.zeros_like(x)
        direction[free] = np.linalg.solve(hessian[np.ix_(free, free)], -gradient[free])
        length, better = 1.0, False
        while length > 1e-6:
            trial = np.clip(x + length * direction, low, high)
            new = jet(trial)
            if np.isfinite(new[0]) and new[0] < value - 1e-4 * gradient @ (x - trial):
                better = True
                break
            length /= 2
        if not better:
            break
        gained = value - new[0]
        x, (value, gradient, hessian) = trial, new
        if gained < 1e-12 * max(1e-6, abs(value)):
            break
    return x


def worn_table(start: PatchDesign, found: WornDesign, *, method: str = "worn") -> PatchDesign:
    """The design as a table: the targets of the start, the new cuts, no surrogate's prediction."""
    kept = {
        name: values
        for name, values in start.quantities.items()
        if not name.startswith("predicted_")
    }
    return replace(
        start,
        method=method,
        a=found.cut_map.a.copy(),
        b=found.cut_map.b.copy(),
        quantities=kept,
        file=None,
        settings={
            "Limits": found.limits.as_dict(start.cell_mm),
            "MethodSettings": worn_settings(found, start.method),
        },
    )


def worn_settings(found: WornDesign, start: str) -> dict[str, Any]:
    """What the sidecar says of a worn design: settings, and every iteration."""
    last = found.iterations[-1]
    return {
        "Start": start,
        "Steps": len([one for one in found.iterations if one.step > 0]),
        "Levels": [list(level) for level in found.options.levels],
        "BarrierMm2": found.options.barrier_mm2,
        "SmoothnessMm2": found.options.smoothness_mm2,
        "Trust": found.options.trust,
        "RmsMm": last.rms_mm,
        "WorstMm": last.worst_mm,
        "AtBounds": found.at_bounds,
        "Stopped": found.reason,
        "Iterations": [
            {
                "Elements": one.elements,
                "RmsMm": one.rms_mm,
                "WorstMm": one.worst_mm,
                "ObjectiveMm2": one.objective_mm2,
                "Step": one.step,
                "APercent": np.round(100 * one.a, 2).tolist(),
                "BPercent": np.round(100 * one.b, 2).tolist(),
            }
            for one in found.iterations
        ],
    }
