"""Cuts for a patch that is not put on exactly: good on average over placement errors and noise.

The nominal design knows one pose. Here the patch is put on in several: shifted, turned, with a
slipped strap, each by one standard deviation either way (the sigma points of the unscented
transform, Julier and Uhlmann 2004, doi 10.1109/JPROC.2003.823141, at unit distance), with seeded
draws of node noise in each. What is minimised is the mean over poses, draws and cells of
(1 - overlap)^2, which asks of a cell that is lost anyway less than a sum of distances does. Poses
are solved anew in every round; between rounds the corners of all of them move linearly with the
cuts, by the exact derivatives of the nominal pose.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.design.limits import Limits
from kiribench.design.worn import (
    MARGIN,
    SHORTEST,
    SHORTEST_STEP,
    Iteration,
    Regularisation,
    WornDesign,
    WornModel,
    WornOptions,
    distances,
    newton_in_box,
)
from kiribench.errors import NotConvergedError
from kiribench.fem.wear import WearSensitivities, WornPatch
from kiribench.lattice import CutMap

FloatArray = NDArray[np.float64]
Overlap = Callable[[FloatArray], FloatArray]

#: Step of the overlap's finite differences: far above its rounding, far below a cell.
DIFFERENCE_MM = 0.02


@dataclass(frozen=True)
class Spread:
    """Standard deviations of what goes wrong.

    Attributes:
        along_mm, across_mm: of the place. turn_deg: of the turn. slip_mm: of the distal strap
            (it only slips back). node_mm: of every corner's node, in each direction.
    """

    along_mm: float = 1.0
    across_mm: float = 0.3
    turn_deg: float = 0.5
    slip_mm: float = 1.0
    node_mm: float = 0.25

    def poses(self) -> list[dict[str, Any]]:
        """The nominal pose and one standard deviation either way in every direction."""
        found: list[dict[str, Any]] = [{}]
        for sign in (-1.0, 1.0):
            if self.along_mm:
                found.append({"offset_mm": (0.0, sign * self.along_mm)})
            if self.across_mm:
                found.append({"offset_mm": (sign * self.across_mm, 0.0)})
            if self.turn_deg:
                found.append({"turn_deg": sign * self.turn_deg})
        if self.slip_mm:
            found.append({"strap_slip_mm": self.slip_mm})
        return found


class PosedWornModel(WornModel, Protocol):
    """A worn model that can be put on with an error."""

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        """The patch in equilibrium."""
        ...


@dataclass(frozen=True)
class RobustOptions:
    """How the robust design works.

    Attributes:
        elements: elements a facet edge. rounds: at most so many accepted steps.
        draws: of node noise in each pose. seed: of the draws.
        trust: largest change of a cut in one step.
        barrier, smoothness: weights of the regularisation, in units of (1 - overlap)^2.
        worth: a round that gains less of the objective (a fraction) is the last.
    """

    elements: int = 6
    rounds: int = 4
    draws: int = 3
    seed: int = 0
    trust: float = 0.15
    barrier: float = 1e-5
    smoothness: float = 2e-5
    worth: float = 0.01


def design_robust(
    model: PosedWornModel,
    start: CutMap,
    overlap: Overlap,
    limits: Limits | None = None,
    options: RobustOptions | None = None,
    spread: Spread | None = None,
) -> WornDesign:
    """Improve a design on average over errors of placement and of the nodes.

    Args:
        model: of the worn patch, in any pose.
        start: a nominal design, such as `worn`.
        overlap: corners (..., R+1, C+1, 2) in skin coordinates to overlaps (..., R, C).
        limits: of the cut lengths. spread: of the errors.

    Returns:
        Its iterations are the nominal pose; their objective is the mean over all poses.

    Raises:
        NotConvergedError: ``robust-start``; the start has no equilibrium.
    """
    limits, options, spread = limits or Limits(), options or RobustOptions(), spread or Spread()
    began = time.process_time()
    low, high = SHORTEST, limits.longest(start.cell_mm)
    inset = MARGIN * (high - low)
    shape = start.a.shape
    p = np.clip(np.concatenate([start.a.ravel(), start.b.ravel()]), low + inset, high - inset)
    regular = Regularisation(shape, low, high, options.barrier, options.smoothness)
    poses = spread.poses()
    rng = np.random.default_rng(options.seed)
    # Noise of one draw is the same in all poses and rounds: rounds are compared like for like.
    noise = spread.node_mm * rng.standard_normal((options.draws, *model.target_q_mm.shape))
    history: list[Iteration] = []

    def solved(cuts: FloatArray) -> tuple[WearSensitivities, FloatArray] | None:
        a, b = cuts.reshape(2, *shape)
        cut_map = CutMap(a, b, start.cell_mm)
        try:
            found = model.sensitivities(cut_map, options.elements)
            corners = [found.worn.corner_q_mm]
            for pose in poses[1:]:
                worn = model.worn(cut_map, options.elements, **pose)
                if worn.status != "ok":
                    return None
                corners.append(worn.corner_q_mm)
        except NotConvergedError:
            return None
        return (found, np.stack(corners)) if found.worn.status == "ok" else None

    def value(cuts: FloatArray, corners: FloatArray) -> float:
        return float((_loss(overlap, corners, noise) ** 2).mean()) + regular.value(cuts)

    def note(cuts: FloatArray, found: WearSensitivities, worth: float, step: float) -> None:
        rms, worst = distances(found.worn.corner_q_mm, model)
        a, b = cuts.reshape(2, *shape)
        history.append(
            Iteration(
                a, b, found.worn.corner_q_mm, options.elements, rms, worst, worth, step,
                time.process_time() - began,
            )
        )  # fmt: skip

    state = solved(p)
    if state is None:
        raise NotConvergedError(
            "robust-start",
            "The patch that the design starts from has no equilibrium in all poses.",
            remedy="Start from another design, or design for smaller errors.",
        )
    best = value(p, state[1])
    note(p, state[0], best, 0.0)
    trust, reason = options.trust, "all rounds were taken"
    for _ in range(options.rounds):
        found, corners = state
        step = robust_step(p, found.corner_q, corners, noise, overlap, regular, trust)
        trial = p + step
        after = solved(trial)
        reached = np.inf if after is None else value(trial, after[1])
        if after is None or reached >= best:
            trust /= 4
            if trust < SHORTEST_STEP:
                reason = "no shorter step made it better"
                break
            continue
        gained, best = 1 - reached / best, reached
        p, state = trial, after
        note(p, after[0], best, float(np.abs(step).max()))
        if gained < options.worth:
            reason = f"the last round gained less than {options.worth:.0%}"
            break
    near = 0.01 * (high - low)
    a, b = p.reshape(2, *shape)
    return WornDesign(
        cut_map=CutMap(a, b, start.cell_mm),
        iterations=tuple(history),
        options=WornOptions(levels=((options.elements, options.rounds),), trust=options.trust),
        limits=limits,
        at_bounds=int(((p < low + near) | (p > high - near)).sum()),
        reason=reason,
        cpu_seconds=time.process_time() - began,
    )


def _loss(overlap: Overlap, corners: FloatArray, noise: FloatArray) -> FloatArray:
    """(poses, draws, R, C) 1 - overlap; 0 where there is no overlap to know."""
    return np.nan_to_num(1.0 - overlap(corners[:, None] + noise[None]))


def overlap_slopes(
    overlap: Overlap, corners: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Loss of every cell and its derivatives by its own four corners.

    Corners of one parity of row and column have no cell in common, so four groups of corners
    and two directions give all derivatives in sixteen evaluations.

    Args:
        overlap: see :func:`design_robust`. corners: (s, R+1, C+1, 2). noise: (d, R+1, C+1, 2).

    Returns:
        (s, d, R, C), and (s, d, R, C, 4, 2) by the corners (r, c), (r, c+1), (r+1, c+1),
        (r+1, c).
    """
    base = corners[:, None] + noise[None]
    loss = np.nan_to_num(1.0 - overlap(base))
    rows, columns = loss.shape[-2:]
    slopes = np.zeros((*loss.shape, 4, 2))
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    for even_row in (0, 1):
        for even_column in (0, 1):
            for axis in (0, 1):
                move = np.zeros(corners.shape[1:])
                move[even_row::2, even_column::2, axis] = DIFFERENCE_MM
                change = (overlap(base - move) - overlap(base + move)) / (2 * DIFFERENCE_MM)
                # Which of the cell's four corners is the one of this group.
                down = (row % 2 != even_row).astype(int)
                right = (column % 2 != even_column).astype(int)
                corner = np.where(down == 0, right, 3 - right)
                slopes[..., row, column, corner, axis] = np.nan_to_num(change)
    return loss, slopes


def robust_step(
    p: FloatArray,
    derivative: FloatArray,
    corners: FloatArray,
    noise: FloatArray,
    overlap: Overlap,
    regular: Regularisation,
    trust: float,
) -> FloatArray:
    """Gauss-Newton step of the mean square loss within the trust region and the bounds.

    Args:
        p: (n,) cuts. derivative: ((R+1)(C+1)2, n) of the corners. Others as above.
    """
    loss, slopes = overlap_slopes(overlap, corners, noise)
    rows, columns = loss.shape[-2:]
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    own = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1)
    by_corner = derivative.reshape(number.size, 2, -1)[own]
    # d loss / d cuts = sum over the four corners: (s, d, R, C, n), summed on the fly.
    flat = slopes.reshape(-1, rows * columns, 8)
    jacobian = np.einsum(
        "kce,cen->kcn", flat, by_corner.reshape(rows * columns, 8, -1), optimize=True
    ).reshape(-1, len(p))
    left = loss.ravel()
    count = len(left)
    normal = 2 / count * jacobian.T @ jacobian
    slope = 2 / count * jacobian.T @ left

    def jet(step: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        gradient, hessian = regular.jet(p + step)
        value = float(slope @ step + 0.5 * step @ normal @ step) + regular.value(p + step)
        return value, slope + normal @ step + gradient, normal + hessian

    inset = 1e-4 * (regular.high - regular.low)
    low = np.minimum(np.maximum(-trust, regular.low + inset - p), 0.0)
    high = np.maximum(np.minimum(trust, regular.high - inset - p), 0.0)
    return newton_in_box(jet, np.zeros_like(p), low, high)
