"""A checked design as JSON, table rows and text."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.export import conform_object, number
from kiribench.conformability.result import DEFINITIONS
from kiribench.fem.loadpath import OVERLAP_FLAG_MM
from kiribench.fem.wear_contact import weight_mpa
from kiribench.fem.wear_measures import BREAKING_STRESS_MPA, BREAKING_STRETCH, TIP_DISTANCE_MM
from kiribench.reference.check import CheckedDesign
from kiribench.reference.ground import FlatGround

FloatArray = NDArray[np.float64]

#: Columns of the table with their unit and meaning, for the sidecar.
COLUMNS: dict[str, str] = {
    "row": "patch row, 0 proximal",
    "col": "patch column, 0 lateral",
    "region": "region label",
    "longitudinal_stretch": "simulated length of the cell's longitudinal edges / cell edge",
    "lateral_stretch": "simulated length of the cell's lateral edges / cell edge",
    "shear": "tangent of the closing of the right angle",
    "longitudinal_strain": "of the simulated stretch, in StrainMeasure",
    "poisson_ratio": "minus lateral over longitudinal strain, in StrainMeasure; n/a below 0.03",
    "target_longitudinal_stretch": "asked for",
    "target_lateral_stretch": "asked for",
    "longitudinal_strain_error": "simulated minus asked for",
    "poisson_ratio_error": "simulated minus asked for",
    "overlap_paper": "predicted area(S and K) / area(S); S skin cell, K patch cell",
    "overlap_strict": "predicted area(S and K) / max(area(S), area(K))",
    "overlap_iou": "predicted area(S and K) / area(S or K)",
    "grade": "good, fair or poor by the chosen definition",
    "main_cause": "cause of the largest cost",
    "mesh_error_overlap": "estimated error of the graded overlap by the mesh",
    "contact_pressure_mpa": "mean of the cell's four facets; negative where the skin would pull",
    "lift_off_facets": "of the cell's four facets those on which the skin would have to pull by "
    "more than they weigh",
    "face_overlap_mm": "largest depth to which cut faces of the cell pass through each other; the "
    "model has no contact of faces, so from 0.1 on the cell is not to be trusted",
    "reason": "why the cell has no score",
}


def check_rows(checked: CheckedDesign) -> list[dict[str, Any]]:
    """One dict a cell, row-major, keys in the order of ``COLUMNS``."""
    score, worn = checked.conformability, checked.worn
    rows, columns = checked.design.shape
    pressure = worn.contact_pressure_mpa.reshape(rows, 2, columns, 2).mean(axis=(1, 3))
    lifted = checked.lift_off.reshape(rows, 2, columns, 2).sum(axis=(1, 3))
    numbers = {
        "longitudinal_stretch": worn.longitudinal_stretch,
        "lateral_stretch": worn.lateral_stretch,
        "shear": worn.shear,
        "longitudinal_strain": checked.longitudinal_strain,
        "poisson_ratio": checked.poisson_ratio,
        "target_longitudinal_stretch": checked.target_longitudinal,
        "target_lateral_stretch": checked.target_lateral,
        "longitudinal_strain_error": checked.strain_error,
        "poisson_ratio_error": checked.poisson_error,
        "overlap_paper": score.overlap_paper,
        "overlap_strict": score.overlap_strict,
        "overlap_iou": score.overlap_iou,
        "mesh_error_overlap": checked.mesh_overlap,
        "contact_pressure_mpa": pressure,
        "face_overlap_mm": checked.overlapping_mm,
    }
    out = []
    for at in np.ndindex(rows, columns):
        words: dict[str, Any] = {
            "row": at[0],
            "col": at[1],
            "region": str(checked.design.region[at]) or None,
            "grade": str(score.grade[at]) or None,
            "main_cause": str(score.causes.main[at]) or None,
            "lift_off_facets": int(lifted[at]),
            "reason": str(score.reason[at]) or None,
        }
        out.append(
            {name: words[name] if name in words else number(numbers[name][at]) for name in COLUMNS}
        )
    return out


def check_object(checked: CheckedDesign) -> dict[str, Any]:
    """The JSON object of one design in ``kiribench.check/1``."""
    score, worn = checked.conformability, checked.worn
    scored = max(1, score.whole.scored)
    head = {
        key: value
        for key, value in conform_object(score).items()
        if key not in ("id", "table", "registration", "lift_off_mm", "median_lift_off_mm")
    }
    return {
        "method": checked.design.method,
        "file": None if checked.design.file is None else checked.design.file.name,
        "surface": checked.ground.kind,
        **head,
        "share": {
            name: {
                "fair": float(np.isin(score.grades[name], ("good", "fair")).sum()) / scored,
                "good": float((score.grades[name] == "good").sum()) / scored,
                "mean": _mean(score_by(checked, name)),
            }
            for name in DEFINITIONS
        },
        "friction": "stick"
        if np.isinf(checked.options.spec.friction)
        else checked.options.spec.friction,
        "straps": checked.options.spec.straps,
        "pose": {
            "offset_mm": list(checked.options.spec.offset_mm),
            "turn_deg": checked.options.spec.turn_deg,
            "strap_slip_mm": checked.options.spec.strap_slip_mm,
        },
        "elements_per_facet": checked.options.elements,
        "mesh": {
            "coarser_elements_per_facet": None
            if checked.coarse is None
            else checked.options.coarser,
            "largest_shift_mm": float(checked.mesh_shift_mm.max()),
            "largest_overlap_error": _largest(checked.mesh_overlap),
            "mean_overlap_error": _mean(checked.mesh_overlap),
        },
        "errors": {
            "targets": checked.target_source,
            "strain_measure": checked.design.strain_measure,
            "longitudinal_strain_rms": _rms(checked.strain_error),
            "longitudinal_strain_largest": _largest(checked.strain_error),
            "poisson_ratio_rms": _rms(checked.poisson_error),
            "poisson_ratio_largest": _largest(checked.poisson_error),
        },
        "contact": contact_object(checked),
        "face_overlap_mm": number(worn.face_overlap_mm),
        "face_overlap_cells": overlapping_cells(checked),
        "tips": {
            "distance_mm": TIP_DISTANCE_MM,
            "largest_stretch": _largest(worn.tip_stretch),
            "breaking_stretch": BREAKING_STRETCH,
            "largest_nominal_stress_mpa": _largest(worn.tip_stress_mpa / worn.tip_stretch),
            "breaking_stress_mpa": BREAKING_STRESS_MPA,
        },
        "rest": rest_object(checked),
        "strap_force_n": number(worn.strap_force_n),
        "newton_iterations": worn.newton_iterations,
        "cells_below_good": causes_of(checked),
        "table": check_rows(checked),
    }


def pose_words(checked: CheckedDesign) -> str | None:
    """How the patch was put on where that is not in its place; None where it is."""
    spec = checked.options.spec
    medially, distally = spec.offset_mm
    if not any((medially, distally, spec.turn_deg, spec.strap_slip_mm)):
        return None
    return (
        f"Put on {medially:+g} mm medially and {distally:+g} mm distally of its place, turned by "
        f"{spec.turn_deg:g} degrees, the distal strap slipped by {spec.strap_slip_mm:g} mm."
    )


def contact_object(checked: CheckedDesign) -> dict[str, float]:
    """How the skin holds the patch: pressures in pascal, shares of facets and of the area."""
    pressure = 1e6 * checked.worn.contact_pressure_mpa
    area = checked.worn.contact_area_mm2
    return {
        "mean_pressure_pa": float(np.average(pressure, weights=area)),
        "largest_pressure_pa": float(pressure.max()),
        "largest_pull_pa": float(max(0.0, -pressure.min())),
        "weight_pa": 1e6 * weight_mpa(checked.design.thickness_mm),
        "pulled_facets": float((pressure < 0).mean()),
        "lift_off_area": float(np.average(checked.lift_off, weights=area)),
    }


def contact_words(contact: dict[str, float]) -> str:
    """The same in a sentence."""
    mean = f"The skin presses on the patch with {contact['mean_pressure_pa']:.0f} Pa on average"
    if not contact["lift_off_area"]:
        return f"{mean}, and would have to hold no part of it."
    return (
        f"{mean}; on {100 * contact['lift_off_area']:.0f} % of the area it would have to pull "
        f"by more than the sheet weighs ({contact['weight_pa']:.0f} Pa), by "
        f"{contact['largest_pull_pa']:.0f} Pa at most: there the patch would stand off."
    )


def overlapping_cells(checked: CheckedDesign) -> list[list[int]]:
    """(row, column) of cells of which cut faces pass through each other beyond the flag."""
    return [[int(r), int(c)] for r, c in np.argwhere(checked.overlapping_mm > OVERLAP_FLAG_MM)]


def overlap_flag(checked: CheckedDesign) -> str | None:
    """The same in a sentence; None where there are none."""
    cells = overlapping_cells(checked)
    if not cells:
        return None
    listed = ", ".join(f"({r}, {c})" for r, c in cells)
    return (
        f"Cut faces pass through each other by up to {checked.worn.face_overlap_mm:.2f} mm in "
        f"{'cell' if len(cells) == 1 else 'cells'} (row, column) {listed}. Faces that touch are "
        "not modelled: there the prediction does not hold."
    )


def tip_words(tips: dict[str, float]) -> str:
    """Stretch and stress before the cut tips against what broke the rubber."""
    return (
        f"Rubber {tips['distance_mm']:g} mm before the cut tips: stretch up to "
        f"{tips['largest_stretch']:.2f} (it broke at {tips['breaking_stretch']:.1f} in a tension "
        f"test), nominal stress up to {tips['largest_nominal_stress_mpa']:.2f} MPa "
        f"({tips['breaking_stress_mpa']:.2f}). At a tip itself the model knows no limit of "
        "either, so nothing is said about tearing."
    )


def rest_object(checked: CheckedDesign) -> dict[str, float] | None:
    """How the patch was laid on a skin that is not flat at rest; None where it is flat."""
    rest = checked.ground.rest
    return None if rest is None else {
        "mismatch": rest.flatness.mismatch,
        "total_gauss_curvature_rad": rest.flatness.total_curvature,
        "largest_strain": rest.largest_strain,
    }  # fmt: skip


def rest_words(rest: dict[str, float]) -> str:
    """The same in a sentence."""
    return (
        f"The skin at 0 degrees is not flat: its grid misses its pitch by {rest['mismatch']:.1%} "
        f"(rms), its Gauss curvature adds up to {rest['total_gauss_curvature_rad']:.3f} rad under "
        "the patch. The patch was laid on it with the least strain (at most "
        f"{rest['largest_strain']:.1%}), not node on node."
    )


def score_by(checked: CheckedDesign, definition: str) -> FloatArray:
    """(R, C) overlap by a definition."""
    score = checked.conformability
    return {
        "paper": score.overlap_paper,
        "strict": score.overlap_strict,
        "iou": score.overlap_iou,
    }[definition]


def causes_of(checked: CheckedDesign) -> dict[str, int]:
    """Main causes of the cells that are not good, with their counts."""
    score = checked.conformability
    wanting = np.isin(score.grade, ("fair", "poor"))
    names, counts = np.unique(score.causes.main[wanting], return_counts=True)
    return {str(name): int(n) for name, n in zip(names, counts, strict=True)}


def check_sidecar(checked: CheckedDesign) -> dict[str, Any]:
    """The JSON sidecar of the table."""
    head = {key: value for key, value in check_object(checked).items() if key != "table"}
    return {"Columns": COLUMNS, "StrainMeasure": checked.design.strain_measure, "Check": head}


def check_text(checked: CheckedDesign) -> str:
    """One design for a person."""
    content = check_object(checked)
    share, mesh, errors = content["share"], content["mesh"], content["errors"]
    ground = checked.ground
    where = "on the flexed skin" if ground.kind == "worn" else "in the plane"
    lines = [
        f"Design '{checked.design.method}' {where}, friction {content['friction']}, "
        f"{content['elements_per_facet']} elements a facet edge:"
    ]
    pose = pose_words(checked)
    lines += [f"  {pose}"] if pose else []
    if isinstance(ground, FlatGround) and ground.flat is not None:
        lines.append(
            f"  The skin does not lie flat: its edges change by {ground.flat.strain_rms:.1%} (rms)."
        )
    for name in DEFINITIONS:
        one = share[name]
        lines.append(
            f"  {name:<7} at least fair {100 * one['fair']:5.1f} %   good "
            f"{100 * one['good']:5.1f} %   mean {one['mean']:.3f}"
        )
    lines.append(
        f"  Mesh: corners move by up to {mesh['largest_shift_mm']:.2f} mm against "
        f"{mesh['coarser_elements_per_facet']} elements; error of an overlap up to "
        f"{mesh['largest_overlap_error']:.3f}, {mesh['mean_overlap_error']:.3f} on average."
        if mesh["coarser_elements_per_facet"]
        else "  Mesh: the coarsest there is; its error is not known."
    )
    lines.append(
        f"  Against the targets of the {errors['targets']}: strain {errors['strain_measure']} "
        f"{_shown(errors['longitudinal_strain_rms'])} rms, Poisson's ratio "
        f"{_shown(errors['poisson_ratio_rms'])} rms."
    )
    causes = content["cells_below_good"]
    if causes:
        listed = ", ".join(f"{n} {name}" for name, n in causes.items())
        lines.append(f"  Main cause of the cells that are not good: {listed}.")
    flag = overlap_flag(checked)
    notes = [
        None if content["rest"] is None else rest_words(content["rest"]),
        contact_words(content["contact"]) if ground.kind == "worn" else None,
        tip_words(content["tips"]) if checked.worn.tip_stretch.size else None,
        None if flag is None else f"WARNING: {flag}",
    ]
    lines += [f"  {note}" for note in notes if note]
    return "\n".join(lines)


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _known(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]


def _rms(values: FloatArray) -> float | None:
    known = _known(values)
    return float(np.sqrt((known**2).mean())) if known.size else None


def _mean(values: FloatArray) -> float:
    known = _known(values)
    return float(known.mean()) if known.size else 0.0


def _largest(values: FloatArray) -> float:
    return float(np.abs(_known(values)).max(initial=0.0))
