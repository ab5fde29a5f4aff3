"""A checked design as JSON, table rows and text."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.export import conform_object, number
from kiribench.conformability.result import DEFINITIONS
from kiribench.fem.wear_measures import BREAKING_STRETCH
from kiribench.reference.check import CheckedDesign, FlatGround

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
    "contact_pressure_mpa": "mean of the cell's four facets; negative where it would lift off",
    "lift_off_facets": "of the cell's four facets those that the skin would have to hold",
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
        "lift_off_share": float(checked.lift_off.mean()),
        "face_overlap_mm": number(worn.face_overlap_mm),
        "largest_tip_stretch": _largest(worn.tip_stretch),
        "breaking_stretch": BREAKING_STRETCH,
        "strap_force_n": number(worn.strap_force_n),
        "newton_iterations": worn.newton_iterations,
        "cells_below_good": causes_of(checked),
        "table": check_rows(checked),
    }


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
    if content["lift_off_share"] > 0:
        lines.append(f"  {100 * content['lift_off_share']:.0f} % of the facets would lift off.")
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
