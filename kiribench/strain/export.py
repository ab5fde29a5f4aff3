"""A strain field as table rows, with null and a reason where there is no number."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.strain.result import REASONS, Estimate, StrainField

#: Columns of the table with their unit and meaning, for the sidecar.
COLUMNS: dict[str, str] = {
    "row": "cell row, 0 proximal",
    "col": "cell column, 0 lateral",
    "longitudinal_stretch": "mean length ratio of the two longitudinal geodesic edges",
    "longitudinal_stretch_sd": "its standard deviation from the node uncertainty",
    "lateral_stretch": "mean length ratio of the two lateral geodesic edges",
    "lateral_stretch_sd": "its standard deviation from the node uncertainty",
    "strain_measure": "measure of longitudinal_strain, lateral_strain and poisson_ratio",
    "longitudinal_strain": "longitudinal_stretch in that measure, a fraction",
    "longitudinal_strain_low": "lower end of its 95 % interval",
    "longitudinal_strain_high": "upper end of its 95 % interval",
    "lateral_strain": "lateral_stretch in that measure, a fraction",
    "lateral_strain_low": "lower end of its 95 % interval",
    "lateral_strain_high": "upper end of its 95 % interval",
    "poisson_ratio": "- lateral_strain / longitudinal_strain",
    "poisson_ratio_low": "lower end of Fieller's 95 % interval",
    "poisson_ratio_high": "upper end of Fieller's 95 % interval",
    "poisson_reason": "why poisson_ratio, or only its interval, is absent",
    "shear": "tangent of the closing of the right angle between longitudinal and lateral fibre",
    "shear_low": "lower end of its 95 % interval",
    "shear_high": "upper end of its 95 % interval",
    "gradient_longitudinal_stretch": "stretch of the longitudinal fibre, from the gradient",
    "gradient_lateral_stretch": "stretch of the width across it, from the gradient",
    "principal_stretch_1": "larger principal stretch of the in-plane gradient",
    "principal_stretch_2": "smaller principal stretch",
    "principal_angle_deg": "direction of the larger one, from longitudinal towards medial",
    "rotation_deg": "turn of the material against its longitudinal fibre (polar R)",
    "area_ratio": "area deformed / reference",
    "green_ll": "Green-Lagrange strain, longitudinal",
    "green_tt": "Green-Lagrange strain, lateral",
    "green_lt": "Green-Lagrange shear strain (half the engineering shear)",
    "log_ll": "Hencky strain ln U, longitudinal",
    "log_tt": "Hencky strain ln U, lateral",
    "log_lt": "Hencky strain ln U, shear component",
    "reason": "why the cell has no strain",
}


def number(value: float | np.floating[Any]) -> float | None:
    """A JSON number, or None where there is none."""
    plain = float(value)
    return plain if math.isfinite(plain) else None


def _interval(row: dict[str, Any], name: str, of: Estimate, at: tuple[int, int]) -> None:
    row[name] = number(of.value[at])
    row[f"{name}_low"] = number(of.low[at])
    row[f"{name}_high"] = number(of.high[at])


def strain_rows(field: StrainField) -> list[dict[str, Any]]:
    """One dict a cell, row-major, keys in the order of ``COLUMNS``."""
    return [_row(field, (r, c)) for r in range(field.shape[0]) for c in range(field.shape[1])]


def _row(field: StrainField, at: tuple[int, int]) -> dict[str, Any]:
    row: dict[str, Any] = {"row": at[0], "col": at[1]}
    for name, of in (
        ("longitudinal_stretch", field.longitudinal_stretch),
        ("lateral_stretch", field.lateral_stretch),
    ):
        row[name] = number(of.value[at])
        row[f"{name}_sd"] = number(of.sd[at])
    row["strain_measure"] = field.strain_measure
    _interval(row, "longitudinal_strain", field.longitudinal_strain, at)
    _interval(row, "lateral_strain", field.lateral_strain, at)
    _interval(row, "poisson_ratio", field.poisson_ratio, at)
    row["poisson_reason"] = str(field.poisson_reason[at]) or None
    _interval(row, "shear", field.shear, at)
    row["gradient_longitudinal_stretch"] = number(field.gradient_longitudinal_stretch[at])
    row["gradient_lateral_stretch"] = number(field.gradient_lateral_stretch[at])
    row["principal_stretch_1"] = number(field.principal_stretches[at][0])
    row["principal_stretch_2"] = number(field.principal_stretches[at][1])
    row["principal_angle_deg"] = number(field.principal_angle_deg[at])
    row["rotation_deg"] = number(field.rotation_deg[at])
    row["area_ratio"] = number(field.area_ratio[at])
    for name, tensor in (("green", field.green), ("log", field.hencky)):
        for component, axis in (("ll", 0), ("tt", 1), ("lt", 2)):
            row[f"{name}_{component}"] = number(tensor[at][axis])
    row["reason"] = str(field.reason[at]) or None
    return row


def _summary(of: NDArray[np.float64]) -> dict[str, float | None]:
    known = of[np.isfinite(of)]
    if len(known) == 0:
        return {"mean": None, "median": None, "min": None, "max": None}
    return {
        "mean": float(known.mean()),
        "median": float(np.median(known)),
        "min": float(known.min()),
        "max": float(known.max()),
    }


def _counts(reason: NDArray[np.str_]) -> dict[str, int]:
    names, counts = np.unique(reason[reason != ""], return_counts=True)
    return {str(name): int(count) for name, count in zip(names, counts, strict=True)}


def strain_object(field: StrainField) -> dict[str, Any]:
    """The JSON object of one participant in ``kiribench.measure/1``."""
    return {
        "id": field.participant,
        "strain_measure": field.strain_measure,
        "min_strain": field.min_strain,
        "rows": field.shape[0],
        "columns": field.shape[1],
        "reference_pose": field.reference_pose,
        "deformed_pose": field.deformed_pose,
        "denoised": {
            field.reference_pose: field.denoised[0],
            field.deformed_pose: field.denoised[1],
        },
        "cells": int(field.reason.size),
        "measured": int(field.measured.sum()),
        "not_measured": _counts(field.reason),
        "poisson_reasons": _counts(field.poisson_reason),
        "longitudinal_strain": _summary(field.longitudinal_strain.value),
        "lateral_strain": _summary(field.lateral_strain.value),
        "shear": _summary(field.shear.value),
        "poisson_ratio": _summary(field.poisson_ratio.value),
        "notes": list(field.notes),
        "warnings": [fault.as_dict() for fault in field.warnings],
        "table": strain_rows(field),
    }


def strain_sidecar(field: StrainField) -> dict[str, Any]:
    """The JSON sidecar of the table: columns, reason codes and how it was measured."""
    head = {key: value for key, value in strain_object(field).items() if key != "table"}
    return {"Columns": COLUMNS, "Reasons": REASONS, "Measurement": head}
