"""The truth as tables: one row a cell, numbers as text with fixed decimals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kiribench.synthetic.overlap_truth import FAIR, GOOD
from kiribench.synthetic.subject import SyntheticSubject

STRETCH_ACCURACY = 1e-7
OVERLAP_ACCURACY = 5e-5
"""Bounds of the truth's own error, shown by refinement in the tests."""

Table = tuple[tuple[str, ...], Sequence[tuple[str, ...]]]
"""Column names and rows of text."""


def number(value: float, decimals: int) -> str:
    """The number with fixed decimals, never a negative zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def strain_table(subject: SyntheticSubject) -> Table:
    """One row a grid cell; the columns are explained by :func:`strain_sidecar`."""
    truth = subject.strain
    columns = (
        "row",
        "col",
        "longitudinal_stretch",
        "lateral_stretch",
        "poisson_ratio",
        "shear",
        "c_lateral",
        "c_shear",
        "c_longitudinal",
        "principal_stretch_1",
        "principal_stretch_2",
    )
    rows = []
    for row, col in _cells(truth.lateral_stretch.shape):
        c = truth.right_cauchy_green[row, col]
        values = (
            truth.longitudinal_stretch[row, col],
            truth.lateral_stretch[row, col],
            truth.poisson_ratio[row, col],
            truth.shear[row, col],
            c[0, 0],
            c[0, 1],
            c[1, 1],
            *truth.principal_stretches[row, col],
        )
        rows.append((str(row), str(col), *(number(float(value), 6) for value in values)))
    return columns, rows


def overlap_table(subject: SyntheticSubject) -> Table:
    """One row a patch cell; the columns are explained by :func:`overlap_sidecar`."""
    truth = subject.overlap
    grades = truth.grades()
    labels = subject.layout.regions.labels
    columns = (
        "row",
        "col",
        "region",
        "skin_mm2",
        "patch_mm2",
        "common_mm2",
        "overlap_paper",
        "overlap_strict",
        "overlap_iou",
        "grade",
    )
    rows = []
    for row, col in _cells(truth.skin_mm2.shape):
        areas = (truth.skin_mm2, truth.patch_mm2, truth.common_mm2)
        overlaps = (truth.paper, truth.strict, truth.iou)
        rows.append(
            (
                str(row),
                str(col),
                labels[row][col],
                *(number(float(area[row, col]), 4) for area in areas),
                *(number(float(overlap[row, col]), 6) for overlap in overlaps),
                grades[row][col],
            )
        )
    return columns, rows


def edges_table(subject: SyntheticSubject) -> Table:
    """One row an edge between adjacent grid nodes, with its geodesic length in both poses."""
    truth = subject.strain
    rows = []
    kinds = (
        ("lateral", truth.reference.lateral_mm, truth.flexed.lateral_mm),
        ("longitudinal", truth.reference.longitudinal_mm, truth.flexed.longitudinal_mm),
    )
    for kind, before, after in kinds:
        for row, col in _cells(before.shape):
            lengths = (number(float(x[row, col]), 6) for x in (before, after))
            rows.append((kind, str(row), str(col), *lengths))
    return ("direction", "row", "col", "flex000_mm", "flex090_mm"), rows


def counts(subject: SyntheticSubject) -> dict[str, Any]:
    """Cells, good, fair, poor and satisfactory ratio, for the patch and for each region."""
    grades = subject.overlap.grades()
    labels = subject.layout.regions.labels

    def tally(chosen: list[str]) -> dict[str, Any]:
        good, fair = chosen.count("good"), chosen.count("fair")
        return {
            "Cells": len(chosen),
            "Good": good,
            "Fair": fair,
            "Poor": chosen.count("poor"),
            "Satisfactory": round((good + fair) / len(chosen), 6),
        }

    flat = [
        (labels[row][col], grades[row][col]) for row, col in _cells(subject.overlap.paper.shape)
    ]
    regions = {
        name: tally([given for label, given in flat if label == name])
        for name in subject.layout.regions.names
    }
    return {**tally([given for _, given in flat]), "Regions": regions}


def strain_sidecar() -> dict[str, Any]:
    """What the columns of the strain table and of the edges table mean."""
    return {
        "Description": "True strain of every grid cell from the 0 to the 90 degree skin, from "
        "the closed forms of the two surfaces; no mesh is involved.",
        "StrainMeasure": "log",
        "Accuracy": {"Stretches": STRETCH_ACCURACY, "RoundedTo": 1e-6},
        "longitudinal_stretch": "mean of the 90/0 degree length ratios of the cell's two "
        "longitudinal (proximal-distal) edges, geodesic lengths",
        "lateral_stretch": "the same for the two lateral edges",
        "poisson_ratio": "-ln(lateral_stretch) / ln(longitudinal_stretch)",
        "shear": "tan of the angle by which the lateral and the longitudinal direction, at "
        "right angles at 0 degrees, close at 90 degrees, at the cell's centre; positive if "
        "the angle between lateral-to-medial and proximal-to-distal becomes smaller",
        "c_lateral": "right Cauchy-Green tensor at the cell's centre in the orthonormal frame "
        "of the 0 degree tangent plane whose second axis is the drawn longitudinal direction "
        "and whose first points towards medial: component 11, a squared stretch",
        "c_shear": "component 12",
        "c_longitudinal": "component 22, a squared stretch",
        "principal_stretch_1": "larger principal stretch at the cell's centre",
        "principal_stretch_2": "smaller principal stretch at the cell's centre",
    }


def overlap_sidecar(subject: SyntheticSubject) -> dict[str, Any]:
    """What the columns of the overlap table mean, the counts, and the patch's true place."""
    mismatch = subject.knee.mismatch
    motion = subject.worn_motion
    return {
        "Description": "True areal overlap of skin cells S and patch cells K on the smooth 90 "
        "degree skin. Cells are bounded by geodesics between their corners; patch corners are "
        "the material points under them along the skin's normal. Areas by quadrature of "
        "sqrt(det g) in the parameter domain; no mesh and no polygon clipping is involved.",
        "Accuracy": {"Overlaps": OVERLAP_ACCURACY},
        "GradeBy": "overlap_paper",
        "Grades": {"good": f">= {GOOD}", "fair": f">= {FAIR}", "poor": f"< {FAIR}"},
        "Alignment": "global",
        "overlap_paper": "|S and K| / |S|",
        "overlap_strict": "|S and K| / max(|S|, |K|)",
        "overlap_iou": "|S and K| / |S or K|",
        "Counts": counts(subject),
        "WornMotion": {
            "Description": "x_worn = Rotation x_flex090 + TranslationMm",
            "Rotation": [[round(float(x), 12) for x in row] for row in motion.rotation],
            "TranslationMm": [round(float(x), 9) for x in motion.translation_mm],
        },
        "Mismatch": {
            "Description": "parameters of the closed-form field q - p, patch point to skin "
            "point, of kiribench.synthetic.mismatch",
            **{name: float(value) for name, value in vars(mismatch).items()},
        },
    }


def _cells(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    return [(row, col) for row in range(shape[0]) for col in range(shape[1])]
