"""The paper's values beside ours, only where the two are comparable."""

from __future__ import annotations

import numpy as np

from kiribench.conformability.result import Conformability
from kiribench.report.html import Html, table, tag
from kiribench.report.subject import SubjectReport
from kiribench.report.words import listing, percent, percent_span
from kiribench.strain.result import StrainField

#: Satisfactory cells of 72, subjects S1, S2, S3: arXiv 2511.13941, Results, first section.
PAPER_SATISFACTORY = (66, 58, 56)
PAPER_CELLS = 72


def paper_section(subject: SubjectReport) -> Html | None:
    """Our numbers and the paper's, or the reasons why they cannot stand side by side."""
    if subject.layout.body_part != "knee":
        return None
    rows: list[tuple[str, str, str]] = []
    refused: list[str] = []
    score, strain = subject.conformability, subject.strain
    if score is not None:
        refused, whole = not_comparable(subject, score), score.whole
        if not refused:
            rows.append(
                (
                    "Cells at least fair",
                    f"{percent(whole.satisfactory)} "
                    f"({percent_span(whole.satisfactory_low, whole.satisfactory_high)})",
                    listing([percent(n / PAPER_CELLS) for n in PAPER_SATISFACTORY])
                    + " (three worn patches)",
                )
            )
    if strain is not None:
        rows.extend(_strain_rows(strain))
    if not rows and not refused:
        return None
    return tag(
        "section",
        tag("h2", "Beside the paper"),
        tag(
            "p",
            "Bali, Li, Chen and Li (arXiv 2511.13941) measured three people by hand. ",
            "This subject is synthetic: kiribench's synthetic knees imitate the paper's "
            "description and their misfit was chosen to give its ratios, so agreement is no "
            "evidence about any worn patch. "
            if subject.synthetic
            else "Their scans are not public, so only summary values can be compared. ",
        ),
        tag("p", "The share of satisfactory cells is left out: ", listing(refused), ".")
        if refused
        else None,
        table(
            ("Quantity", "This subject", "Paper"),
            rows,
            caption="Quantities that mean the same in both; the paper gives most of them in words.",
        )
        if rows
        else None,
        id="paper",
    )


def not_comparable(subject: SubjectReport, score: Conformability) -> list[str]:
    """Why this score cannot stand beside the paper's; empty where it can."""
    reasons = []
    if score.grade_by != "paper":
        reasons.append(f"graded by '{score.grade_by}', not by the paper's definition")
    if score.alignment != "global":
        reasons.append("each cell was centred first")
    if score.shape != (12, 6) or abs(score.cell_mm - 15.0) > 1e-9:
        reasons.append("the patch does not have 12 x 6 cells of 15 mm")
    if score.whole.scored != score.whole.cells:
        reasons.append(f"{score.whole.cells - score.whole.scored} cells have no score")
    return reasons


def _strain_rows(strain: StrainField) -> list[tuple[str, str, str]]:
    along, across = strain.longitudinal_stretch.value, strain.lateral_stretch.value
    known = ~np.isnan(along)
    if not known.any():
        return []
    lengthened = float((along[known] > 1).mean())
    mean_along, mean_across = float(along[known].mean()) - 1, float(across[known].mean()) - 1
    rows = [
        (
            "Cells that lengthen longitudinally",
            percent(lengthened, 0),
            "'almost all regions' (no number)",
        ),
    ]
    if mean_along > 0:
        rows.append(
            (
                "Mean lateral over mean longitudinal engineering strain",
                f"{mean_across / mean_along:.2f}",
                "'roughly halved' (no number)",
            )
        )
    both = known & (along > 1)
    if both.any():
        rows.append(
            (
                "Of the lengthening cells, those that widen too (ν < 0)",
                percent(float((across[both] > 1).mean()), 0),
                "'predominantly negative' ν (no number)",
            )
        )
    return rows
