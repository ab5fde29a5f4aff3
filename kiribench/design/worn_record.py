"""A worn design as a table, and what its sidecar says of the way there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from kiribench.design.worn import WornDesign
from kiribench.schema.patch_design import PatchDesign


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
        "PosesLeftOut": len(found.options.poses) - len(found.poses),
        "Poses": [
            {key: list(value) if isinstance(value, tuple) else value for key, value in one.items()}
            for one in found.poses
        ],
        "RmsMm": last.rms_mm,
        "WorstMm": last.worst_mm,
        "AtBounds": found.at_bounds,
        "Stopped": found.reason,
        "Iterations": [
            {
                "Elements": one.elements,
                "RmsMm": one.rms_mm,
                "WorstMm": one.worst_mm,
                "PosedRmsMm": one.posed_rms_mm,
                "ObjectiveMm2": one.objective_mm2,
                "Step": one.step,
                "APercent": np.round(100 * one.a, 2).tolist(),
                "BPercent": np.round(100 * one.b, 2).tolist(),
            }
            for one in found.iterations
        ],
    }
