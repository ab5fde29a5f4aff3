"""A conformability score as JSON and table rows."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from kiribench.conformability.result import (
    CAUSES,
    DEFINITIONS,
    FAIR_FROM,
    GOOD_FROM,
    GRADES,
    REASONS,
    Conformability,
    RegionScore,
)
from kiribench.conformability.score import input_warnings

#: Columns of the table with their unit and meaning, for the sidecar.
COLUMNS: dict[str, str] = {
    "row": "patch row, 0 proximal",
    "col": "patch column, 0 lateral",
    "region": "region label of the layout",
    "overlap_paper": "area(S and K) / area(S); S skin cell, K patch cell",
    "overlap_strict": "area(S and K) / max(area(S), area(K))",
    "overlap_iou": "area(S and K) / area(S or K)",
    "grade": "good, fair or poor by the chosen definition",
    "overlap_low": "lower end of the 95 % interval of the graded overlap",
    "overlap_high": "upper end of the 95 % interval of the graded overlap",
    "probability_good": "probability of the grade good under node and registration uncertainty",
    "probability_fair": "probability of fair",
    "probability_poor": "probability of poor",
    "perfect_fit_reading": "what a perfect fit would read on average with this uncertainty",
    "grade_paper": "grade by overlap_paper",
    "grade_strict": "grade by overlap_strict",
    "grade_iou": "grade by overlap_iou",
    "definition_matters": "whether the three grades differ",
    "centre_offset_mm": "distance of the cell centres, before any per-cell alignment",
    "main_cause": "cause of the largest cost; none where all are below .005",
    "shift_longitudinal_mm": "patch centre minus skin centre, distal positive",
    "shift_lateral_mm": "patch centre minus skin centre, medial positive",
    "rotation_deg": "turn of the patch cell, from distal towards medial",
    "longitudinal_stretch": "patch cell length over skin cell length",
    "lateral_stretch": "patch cell width over skin cell width",
    "shear": "tangent of the closing of the right angle",
    "rest_mm": "rms corner distance that shift, rotation, stretches and shear leave",
    "cost_shift": "loss of the graded overlap by the shift alone",
    "cost_rotation": "loss by the rotation alone",
    "cost_longitudinal_stretch": "loss by the longitudinal stretch alone",
    "cost_lateral_stretch": "loss by the lateral stretch alone",
    "cost_shear": "loss by the shear alone",
    "cost_rest": "loss by the rest alone",
    "skin_area_mm2": "area of the skin cell",
    "patch_area_mm2": "area of the patch cell on the skin",
    "reason": "why the cell has no score",
}


def number(value: float | np.floating[Any]) -> float | None:
    """A JSON number, or None where there is none."""
    plain = float(value)
    return plain if math.isfinite(plain) else None


def conform_rows(result: Conformability) -> list[dict[str, Any]]:
    """One dict a cell, row-major, keys in the order of ``COLUMNS``."""
    return [_row(result, (r, c)) for r in range(result.shape[0]) for c in range(result.shape[1])]


def _row(result: Conformability, at: tuple[int, int]) -> dict[str, Any]:
    scored = bool(result.scored[at])
    causes = result.causes
    row: dict[str, Any] = {
        "row": at[0],
        "col": at[1],
        "region": str(result.region[at]),
        "overlap_paper": number(result.overlap_paper[at]),
        "overlap_strict": number(result.overlap_strict[at]),
        "overlap_iou": number(result.overlap_iou[at]),
        "grade": str(result.grade[at]) or None,
        "overlap_low": number(result.overlap_low[at]),
        "overlap_high": number(result.overlap_high[at]),
    }
    for k, grade in enumerate(GRADES):
        row[f"probability_{grade}"] = number(result.probability[at][k])
    row["perfect_fit_reading"] = number(result.perfect_fit_reading[at])
    for definition in DEFINITIONS:
        row[f"grade_{definition}"] = str(result.grades[definition][at]) or None
    row["definition_matters"] = bool(result.definition_matters[at]) if scored else None
    row["centre_offset_mm"] = number(result.centre_offset_mm[at])
    row["main_cause"] = str(causes.main[at]) or None
    row["shift_longitudinal_mm"] = number(causes.shift_mm[at][0])
    row["shift_lateral_mm"] = number(causes.shift_mm[at][1])
    row["rotation_deg"] = number(causes.rotation_deg[at])
    row["longitudinal_stretch"] = number(causes.longitudinal_stretch[at])
    row["lateral_stretch"] = number(causes.lateral_stretch[at])
    row["shear"] = number(causes.shear[at])
    row["rest_mm"] = number(causes.rest_mm[at])
    for k, cause in enumerate(CAUSES):
        row[f"cost_{cause.replace('-', '_')}"] = number(causes.cost[at][k])
    row["skin_area_mm2"] = number(result.skin_area_mm2[at])
    row["patch_area_mm2"] = number(result.patch_area_mm2[at])
    row["reason"] = str(result.reason[at]) or None
    return row


def _counts(score: RegionScore) -> dict[str, Any]:
    return {key: value for key, value in asdict(score).items() if key != "label"}


def conform_object(result: Conformability) -> dict[str, Any]:
    """The JSON object of one participant in ``kiribench.conform/1``."""
    names, counts = np.unique(result.reason[~result.scored], return_counts=True)
    present = np.isfinite(result.lift_off_mm)
    return {
        "id": result.participant,
        **_counts(result.whole),
        "grade_by": result.grade_by,
        "alignment": result.alignment,
        "not_scored": {str(n): int(k) for n, k in zip(names, counts, strict=True)},
        "definition_matters": int(result.definition_matters.sum()),
        "by_definition": {
            name: {grade: int((result.grades[name] == grade).sum()) for grade in GRADES}
            for name in DEFINITIONS
        },
        "regions": {score.label: _counts(score) for score in result.regions},
        "registration": asdict(result.frame),
        "lift_off_mm": [[number(value) for value in row] for row in result.lift_off_mm],
        "median_lift_off_mm": (
            float(np.median(result.lift_off_mm[present])) if present.any() else None
        ),
        "node_sd_mm": {"skin": result.node_sd_mm[0], "patch": result.node_sd_mm[1]},
        "samples": result.samples,
        "seed": result.seed,
        "notes": list(result.notes),
        "warnings": [fault.as_dict() for fault in input_warnings(result)],
        "table": conform_rows(result),
    }


def conform_sidecar(result: Conformability) -> dict[str, Any]:
    """The JSON sidecar of the table: columns, reasons, limits and how it was scored."""
    head = {key: value for key, value in conform_object(result).items() if key != "table"}
    return {
        "Columns": COLUMNS,
        "Reasons": REASONS,
        "Limits": {"good": GOOD_FROM, "fair": FAIR_FROM},
        "Score": head,
    }


def conform_text(result: Conformability) -> str:
    """The score of one participant for a person; the last line is the verdict."""
    whole = result.whole
    lines = [
        f"Participant {result.participant}: {whole.scored} of {whole.cells} cells scored, "
        f"grades by {result.grade_by} overlap, {result.alignment} alignment.",
        "  region  cells  good  fair  poor  satisfactory",
    ]
    for score in (*result.regions, whole):
        ratio = "  none scored"
        if score.satisfactory is not None:
            ratio = (
                f"{100 * score.satisfactory:6.1f} %  "
                f"[{100 * (score.satisfactory_low or 0):.0f}, "
                f"{100 * (score.satisfactory_high or 0):.0f}]"
            )
        lines.append(
            f"  {score.label:<7}{score.scored:>5}{score.good:>6}{score.fair:>6}"
            f"{score.poor:>6}  {ratio}"
        )
    causes, counts = np.unique(result.causes.main[result.grade == "poor"], return_counts=True)
    if len(causes):
        listed = ", ".join(f"{n} {name}" for name, n in zip(causes, counts, strict=True))
        lines.append(f"  Main cause of the poor cells: {listed}.")
    satisfactory = ", ".join(
        f"{name} {int(np.isin(result.grades[name], ('good', 'fair')).sum())}"
        for name in DEFINITIONS
    )
    lines.append(
        f"  Grade depends on the definition in {int(result.definition_matters.sum())} cells "
        f"(satisfactory: {satisfactory})."
    )
    lines.append(f"  Frame: {frame_text(result)}")
    if whole.satisfactory is None:
        lines.append("  Verdict: no cell could be scored.")
    else:
        lines.append(
            f"  Verdict: {whole.good + whole.fair} of {whole.scored} scored cells are "
            f"satisfactory (good or fair), {100 * whole.satisfactory:.2f} %."
        )
    return "\n".join(lines)


def frame_text(result: Conformability) -> str:
    """How the two scans were brought together, one sentence."""
    frame = result.frame
    rms = "" if frame.residual_rms_mm is None else f", residual {frame.residual_rms_mm:.3f} mm rms"
    what = {
        "registered": f"worn scan registered by {frame.points_used} skin points outside the "
        f"patch{rms}; moved by {frame.shift_mm:.2f} mm and {frame.rotation_deg:.2f} degrees, "
        f"uncertain by {frame.shift_sd_mm:.3f} mm; {frame.grades_at_risk} grades at risk.",
        "declared": "the worn scan's sidecar says that it is registered to the bare scan.",
        "kept": f"both scans fit as they are{rms}; registering would not improve it.",
        "assumed": "ASSUMED to be the same: too little skin outside the patch to check.",
        "none": "taken as given (registration none).",
        "predicted": "none needed: the patch was computed on the bare scan, not worn.",
    }
    return what[frame.method]
