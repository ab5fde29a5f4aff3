"""A designed patch in one JSON object and in words; the last line is the verdict."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.design.methods import METHODS
from kiribench.design.on_skin import KNEE_METHODS
from kiribench.design.result import REASONS, Designed

FloatArray = NDArray[np.float64]

_UNSEEN = ("strain-below-data", "strain-beyond-data")
_AIMS = {"worn": "worn-corners", "robust": "worn-corners-over-errors"}


def design_object(result: Designed) -> dict[str, Any]:
    """The JSON object of one patch in ``kiribench.design/1``."""
    design, error = result.design, result.error
    distance = design.quantity("distance")
    known = np.isfinite(error)
    names, counts = np.unique(design.reason[design.reason != ""], return_counts=True)
    absolute = np.abs(error[known])
    # At a strain that was never simulated nothing is known to be met.
    unseen = np.isin(design.reason[known], _UNSEEN)
    met = (absolute <= result.options.tolerance + 1e-9) & ~unseen
    return {
        "participant": design.participant,
        "method": design.method,
        "aims_at": _AIMS.get(design.method, "poisson-ratio"),
        "strain_measure": design.strain_measure,
        "rows": design.shape[0],
        "columns": design.shape[1],
        "cells": int(error.size),
        "with_target": int(known.sum()),
        # A method that aims at something else meets no targets, and misses none.
        "within_tolerance": int(met.sum()) if result.on_skin is None else None,
        "unseen_strain": int(unseen.sum()),
        "tolerance": result.options.tolerance,
        "out_of_reach": int((distance[known] > 1e-6).sum()),
        "largest_distance": float(distance[known].max()),
        "reasons": {str(name): int(count) for name, count in zip(names, counts, strict=True)},
        "error": {"rms": float(np.sqrt(np.mean(absolute**2))), "largest": float(absolute.max())},
        "predicted_sd_median": _median(design.quantity("predicted_poisson_ratio_sd")),
        "cutting_error_median": _median(design.quantity("cutting_error")),
        "a_percent": _range(100 * design.a),
        "b_percent": _range(100 * design.b),
        "mean_squared_cut": float(np.mean(design.a**2 + design.b**2)),
        "nominal_stress_mpa": _range(result.nominal_stress_mpa),
        "force_difference_rms": force_difference(result.nominal_stress_mpa),
        "on_skin": None if result.on_skin is None else asdict(result.on_skin),
        "limits": result.limits.as_dict(design.cell_mm),
        "method_settings": design.settings.get("MethodSettings", {}),
        "cpu_seconds": round(result.cpu_seconds, 4),
        "notes": list(result.notes),
    }


def force_difference(stress_mpa: FloatArray) -> float | None:
    """Rms of ln stress about the mean of its column: how unequal cells in series pull.

    Args:
        stress_mpa: (R, C) nominal stress at each cell's own strain, NaN where unknown.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(stress_mpa)
    parts = [column[np.isfinite(column)] for column in logs.T]
    differences = np.concatenate([part - part.mean() for part in parts if len(part)] or [[]])
    return float(np.sqrt(np.mean(differences**2))) if len(differences) else None


def design_text(result: Designed) -> str:
    """The patch for a person; the last line is the verdict."""
    told = design_object(result)
    who = f"Participant {told['participant']}" if told["participant"] else "Patch"
    lines = [
        f"{who}: {told['rows']} x {told['columns']} cells, {told['method']} "
        f"({(METHODS | KNEE_METHODS).get(told['method'], '')}), {told['strain_measure']} strain, "
        f"{told['cpu_seconds']:.2f} CPU s.",
        f"  cuts across the pull (a) {_span(told['a_percent'])} %, along it (b) "
        f"{_span(told['b_percent'])} % of {result.design.cell_mm:g} mm; longest allowed "
        f"{told['limits']['BoundPercent']:.4g} %",
        *(_aim_lines(told) if told["on_skin"] is None else _skin_lines(told)),
    ]
    if result.on_skin is None:
        lines += _flat_lines(told, result)
    for code, count in told["reasons"].items():
        words = REASONS.get(code, _missing(code))
        if result.on_skin is not None:
            words = "No target of its own; its cuts follow from the corners of the patch."
        lines.append(f"  {count} cell{'s' * (count != 1)} {code}: {words}")
    lines += [f"  {note}" for note in told["notes"]]
    lines.append("  Verdict: " + _verdict(told))
    return "\n".join(lines)


def _missing(code: str) -> str:
    return f"No target ({code.replace('-', ' ')}): the cuts are filled in from the neighbours."


def _flat_lines(told: dict[str, Any], result: Designed) -> list[str]:
    """How sure the prediction is, and what the cells pull with."""
    lines = []
    if told["predicted_sd_median"] is not None:
        lines.append(
            f"  the surrogate's own sd is {told['predicted_sd_median']:.4f}, cutting errors of "
            f"{100 * result.options.cut_error:g} % and {result.options.kerf_error_mm:g} mm of "
            f"kerf make {told['cutting_error_median']:.4f} (medians)"
        )
    if told["force_difference_rms"] is not None:
        lines.append(
            f"  at their target strains cells in series pull with forces that differ by "
            f"{100 * told['force_difference_rms']:.1f} % rms"
        )
    return lines


def _aim_lines(told: dict[str, Any]) -> list[str]:
    return [
        f"  Poisson's ratio misses its target by {told['error']['rms']:.4f} rms, "
        f"{told['error']['largest']:.4f} at most; within {told['tolerance']:g} in "
        f"{told['within_tolerance']} of {told['with_target']} cells"
    ]


def _skin_lines(told: dict[str, Any]) -> list[str]:
    """What a design on the skin aims at, and what it does not."""
    skin = told["on_skin"]
    lines = [
        "  aim: the corners of the worn patch on their nodes of the flexed skin"
        if told["method"] == "worn"
        else "  aim: the corners of the worn patch on their nodes, on average over errors of "
        "placement",
        f"  worn, simulated: corners {skin['rms_mm']:.2f} mm (rms) from their nodes, "
        f"{skin['worst_mm']:.2f} mm at most, on a mesh of {skin['elements']} elements a facet "
        f"edge that the design has not seen; {skin['start_rms_mm']:.2f} mm where it began "
        f"({skin['start']}, on the design's mesh)",
    ]
    if skin["overlap_mean"] is not None:
        lines.append(
            f"  predicted overlap with the skin's cells, by the fast estimate: "
            f"{skin['overlap_mean']:.3f} mean, "
            f"{skin['overlap_least']:.3f} in the worst" + _good(skin, " ({} of {} cells good)")
        )
    if skin["posed_rms_mm"] is not None:
        lines.append(
            f"  over the errors of placement: {skin['posed_rms_mm']:.2f} mm (rms), "
            f"{skin['posed_start_rms_mm']:.2f} mm where it began"
        )
    lines.append(
        f"  Poisson's ratio is no aim: by the surrogate, each cell flat and for itself, it is "
        f"{told['error']['rms']:.3f} (rms) from the skin's"
    )
    return lines


def _good(skin: dict[str, Any], words: str) -> str:
    if skin["cells_good"] is None:
        return ""
    return words.format(skin["cells_good"], skin["cells_scored"])


def _skin_verdict(told: dict[str, Any]) -> str:
    skin = told["on_skin"]
    words = (
        f"on the simulated skin the corners lie {skin['rms_mm']:.2f} mm (rms) from their nodes, "
        f"{skin['worst_mm']:.2f} mm at most"
    )
    if skin["overlap_mean"] is not None:
        words += f", and cells overlap by about {100 * skin['overlap_mean']:.1f} % (mean)"
        words += _good(skin, ", {} of {} good")
    if not skin["equilibrium"]:
        words = f"not confirmed, the finer mesh has no equilibrium: {words}"
    return words + ". Predicted is not worn: kiribench check tells how it sits."


def _verdict(told: dict[str, Any]) -> str:
    if told["on_skin"] is not None:
        return _skin_verdict(told)
    aimed, met, beyond = told["with_target"], told["within_tolerance"], told["out_of_reach"]
    filled = told["cells"] - aimed
    if met == aimed:
        words = "every target is met by the surrogate's prediction"
    else:
        words = f"{met} of {aimed} targets are met by the surrogate's prediction"
        if told["method"] == "uniform":
            words = f"the control: with one pair of cuts for all cells {words}"
    if beyond:
        words += (
            f", {beyond} are out of reach of any allowed cuts, by at most "
            f"{told['largest_distance']:.3f}"
        )
    if told["unseen_strain"]:
        words += f", {told['unseen_strain']} ask for strains that the surrogate has not seen"
    if filled:
        words += f", {filled} cells had none and are filled in"
    return words + ". Predicted is not worn: kiribench check tells how it sits."


def _median(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def _range(values: FloatArray) -> dict[str, float] | None:
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    return {"min": float(known.min()), "median": float(np.median(known)), "max": float(known.max())}


def _span(of: dict[str, float]) -> str:
    if of["max"] - of["min"] < 0.05:
        return f"{of['median']:.1f}"
    return f"{of['min']:.1f} to {of['max']:.1f}"
