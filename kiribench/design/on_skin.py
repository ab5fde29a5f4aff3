"""The methods of design that know the skin: `worn` and `robust`, from a start of the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kiribench.design.cells import cells_of
from kiribench.design.judge import designed
from kiribench.design.limits import Limits
from kiribench.design.methods import design_patch
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.design.reachable import reachable
from kiribench.design.result import Designed, OnSkin
from kiribench.design.robust import design_robust
from kiribench.design.skin import Skin
from kiribench.design.surrogates import Surrogates
from kiribench.design.worn import design_worn, distances
from kiribench.design.worn_model import KneeModel
from kiribench.design.worn_record import worn_settings
from kiribench.errors import NotConvergedError, UsageError
from kiribench.fem.wear import WornPatch
from kiribench.lattice import CutMap

Overlap = Callable[[NDArray[np.float64]], NDArray[np.float64]]

KNEE_METHODS: dict[str, str] = {
    "worn": "corners of the simulated worn patch on their nodes, by Gauss-Newton",
    "robust": "the same, on average over errors of placement",
}
#: Where a design on the skin starts from, the first that can be worn.
STARTS = ("balanced", "exact", "uniform")
#: Confirmed on a mesh that the design has not seen.
CONFIRM_ELEMENTS = 16


def design_on_skin(
    method: str,
    problem: DesignProblem,
    surrogates: Surrogates,
    skin: Skin,
    limits: Limits | None = None,
    options: DesignOptions | None = None,
    *,
    start: str | None = None,
    overlap: Overlap | None = None,
    good_from: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Designed:
    """Design with the worn model of a subject's flexed skin.

    Args:
        method: a key of :data:`KNEE_METHODS`.
        problem, surrogates: of the start, and of what the table says beside the cuts.
        skin: the flexed skin.
        start: method of the start; None is the first of :data:`STARTS` that has an
            equilibrium on the skin, without ``balanced`` where the surrogate knows no stress.
        overlap: corners in skin coordinates to overlaps, to judge the design by.
        good_from: overlap from which on a cell is graded good.
        progress: called with (done, total) steps.

    Raises:
        UsageError: the method is unknown.
        NotConvergedError: no start has an equilibrium on the skin.
    """
    if method not in KNEE_METHODS:
        raise UsageError(
            "method-unknown",
            "There is no such method of design on the skin.",
            remedy="Choose one of the methods named.",
            got=method,
            expected=", ".join(KNEE_METHODS),
        )
    limits, options = limits or Limits(), options or DesignOptions()
    starts = [start] if start else list(STARTS)
    if start is None and surrogates.poisson.stress is None:
        starts.remove("balanced")
    model = KneeModel(skin)
    seconds = 0.0
    for begin in starts:
        first = design_patch(begin, problem, surrogates, limits, options)
        seconds += first.cpu_seconds
        cuts_at_first = CutMap(first.design.a, first.design.b, problem.cell_mm)
        try:
            found = design_worn(model, cuts_at_first, limits, progress=progress)
            break
        except NotConvergedError:
            if begin == starts[-1]:
                raise
    seconds += found.cpu_seconds
    settings = worn_settings(found, begin)
    first_rms = found.iterations[0].rms_mm
    posed: tuple[float | None, float | None] = (None, None)
    if method == "robust":
        found = design_robust(model, found.cut_map, limits, progress=progress)
        seconds += found.cpu_seconds
        settings = worn_settings(found, "worn")
        posed = (found.iterations[0].posed_rms_mm, found.iterations[-1].posed_rms_mm)
    confirmed = model.worn(found.cut_map, CONFIRM_ELEMENTS)
    judged = _judged(model, confirmed, overlap, good_from)
    judged = replace(
        judged,
        start=begin,
        start_rms_mm=first_rms,
        posed_start_rms_mm=posed[0],
        posed_rms_mm=posed[1],
    )
    settings["Confirmed"] = {
        "Elements": CONFIRM_ELEMENTS,
        "RmsMm": judged.rms_mm,
        "WorstMm": judged.worst_mm,
        "Status": confirmed.status,
        "OverlapMean": judged.overlap_mean,
        "OverlapLeast": judged.overlap_least,
    }
    left_out = settings.get("PosesLeftOut", 0)
    cells = cells_of(problem, surrogates, limits, options)
    cuts = np.stack([found.cut_map.a, found.cut_map.b], axis=-1)
    result = designed(
        method,
        cells,
        cuts,
        reachable(cells.poisson, cells.high),
        settings=settings,
        cpu_seconds=seconds + confirmed.cpu_seconds,
        notes=(
            *(
                [f"No equilibrium was found on the mesh of {CONFIRM_ELEMENTS}: not confirmed."]
                if confirmed.status != "ok"
                else []
            ),
            *(
                [
                    f"In {left_out} of its wrong poses the start has no equilibrium on the "
                    "design's mesh: these are left out."
                ]
                if left_out
                else []
            ),
            f"Started from {begin}; {found.at_bounds} of {2 * found.cut_map.a.size} cuts are at "
            "a bound.",
        ),
    )
    # What a uniform sheet of such cuts would do is beside the point here.
    reason = np.where(problem.wanted, "", result.design.reason)
    return replace(result, design=replace(result.design, reason=reason), on_skin=judged)


def _judged(
    model: KneeModel, worn: WornPatch, overlap: Overlap | None, good_from: float | None
) -> OnSkin:
    """Distances of the worn corners from their nodes, and overlaps where they can be told."""
    rms, worst = distances(worn.corner_q_mm, model)
    judged = OnSkin(CONFIRM_ELEMENTS, worn.status == "ok", "", np.nan, rms, worst)
    if overlap is None:
        return judged
    covered = overlap(worn.corner_q_mm)
    covered = covered[np.isfinite(covered)]
    if not len(covered):
        return judged
    good = None if good_from is None else int((covered >= good_from).sum())
    return replace(
        judged,
        overlap_mean=float(covered.mean()),
        overlap_least=float(covered.min()),
        cells_good=good,
        cells_scored=len(covered),
    )
