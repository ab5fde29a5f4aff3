"""A comparison with a tensile test in words and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from kiribench.reference.tensile_causes import Explanation

if TYPE_CHECKING:
    from kiribench.reference.tensile import TensileComparison

FloatArray = npt.NDArray[np.float64]


def amounts_words(found: Explanation) -> str:
    """The amounts that differ from nothing by two standard deviations; all, where none does."""
    clear = [one for one in found.amounts if abs(one.value) > 2 * one.sd]
    shown = clear or list(found.amounts)
    return "; ".join(
        f"{one.words} {one.value:+.3g} ± {1.96 * one.sd:.2g} {one.unit}".strip() for one in shown
    )


def verdict_of(comparison: TensileComparison) -> str:
    """What explains the difference, in one sentence."""
    found = comparison.diagnosis
    if found is None:
        return "Causes were not looked for."
    if found.kind == "noise":
        return "Noise explains it: the scatter of the cells is enough, no cause is needed."
    if found.kind == "one":
        return f"{found.best.name.capitalize()} explains it: {amounts_words(found.best)}."
    if found.kind == "cannot-tell":
        names = " or ".join(one.name for one in found.tied)
        return f"Cannot tell: {names} would explain it equally well."
    if found.kind == "together":
        return (
            f"No single cause explains it; {found.best.name} together would: "
            f"{amounts_words(found.best)}."
        )
    return (
        "Neither material, boundary, cut length nor noise explains it within plausible amounts; "
        f"{found.best.name} comes nearest."
    )


def _list(values: FloatArray | None) -> list[float | None] | None:
    if values is None:
        return None
    return [float(value) if np.isfinite(value) else None for value in values]


def object_of(comparison: TensileComparison) -> dict[str, Any]:
    """A JSON object; what is not known is null."""
    found = comparison.diagnosis
    return {
        "strain_measure": comparison.measure,
        "frames": list(comparison.frame),
        "curve": {
            "longitudinal_strain": _list(comparison.strain),
            "poisson_ratio": _list(comparison.poisson),
            "poisson_ratio_sd_over_cells": _list(comparison.poisson_cells_sd),
            "poisson_ratio_simulated": _list(comparison.poisson_simulated),
            "difference": _list(comparison.difference),
            "difference_half_width": _list(comparison.half_width),
            "mesh_change": _list(comparison.mesh_poisson),
            "displacement_mm": _list(comparison.displacement_mm),
            "longitudinal_strain_simulated": _list(comparison.strain_simulated),
            "force_n": _list(comparison.force_n),
            "force_simulated_n": _list(comparison.force_simulated_n),
        },
        "distance_poisson_ratio": asdict(comparison.distance),
        "distance_force": comparison.distance_force,
        "explanations": None
        if found is None
        else [
            {
                "families": list(one.families) or ["noise"],
                "log_evidence": one.log_evidence,
                "misfit": one.misfit,
                "probability": one.probability,
                "amounts": [asdict(amount) for amount in one.amounts],
            }
            for one in found.all
        ],
        "alike": None if found is None else [list(one) for one in found.alike],
        "diagnosis": None if found is None else found.kind,
        "named": None if found is None else [one.name for one in found.tied],
        "distance_explained": None
        if comparison.distance_explained is None
        else asdict(comparison.distance_explained),
        "verdict": comparison.verdict,
        "notes": list(comparison.notes),
    }


def text_of(comparison: TensileComparison) -> str:
    """Lines for a person; the last one is the verdict."""
    distance = comparison.distance
    worst = int(np.abs(comparison.difference).argmax())
    lines = [
        f"{len(comparison.frame)} frames, {comparison.measure} strain "
        f"{comparison.strain[0]:.3f} to {comparison.strain[-1]:.3f}",
        f"Poisson's ratio, measured less simulated: {distance.value:.4f} rms without scatter "
        f"(95 % interval {distance.low:.4f} to {distance.high:.4f}; {distance.rms:.4f} with it, "
        f"scatter alone {distance.scatter_rms:.4f}); largest "
        f"{comparison.difference[worst]:+.4f} ± {comparison.half_width[worst]:.4f} at strain "
        f"{comparison.strain[worst]:.3f}",
    ]
    if comparison.distance_force is not None:
        lines.append(f"Force: {100 * comparison.distance_force:.1f} % rms of the largest force")
    found = comparison.diagnosis
    if found is not None:
        top = max(one.log_evidence for one in found.all)
        for one in found.all:
            lines.append(
                f"  {one.name}: evidence {one.log_evidence - top:+.1f}, probability of a larger "
                f"misfit {one.probability:.3f}" + (f"; {amounts_words(one)}" if one.amounts else "")
            )
    if comparison.distance_explained is not None:
        lines.append(
            f"With that in the simulation {comparison.distance_explained.value:.4f} are left."
        )
    lines += [*comparison.notes, comparison.verdict]
    return "\n".join(lines)
