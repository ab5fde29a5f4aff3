"""The worst cells close up, and why they fit badly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.result import CAUSES, Conformability
from kiribench.report.figures.outlines import outline_card
from kiribench.report.html import Html, table, tag
from kiribench.report.subject import SubjectReport
from kiribench.report.svg import figure_block
from kiribench.report.verdict import causes as causes_sentence
from kiribench.report.words import number, overlap_words, sentence_case, span

SHOWN = 6

MEANING = {
    "shift": "the centre of the patch cell lies beside that of the skin cell",
    "rotation": "the patch cell is turned",
    "longitudinal-stretch": "the patch cell is too long or too short",
    "lateral-stretch": "the patch cell is too wide or too narrow",
    "shear": "the right angle has closed or opened",
    "rest": "what no shift and no affine map explains, such as a trapezoid",
}


def worst_section(subject: SubjectReport, score: Conformability) -> Html | None:
    """Outlines and causes of the cells with the smallest overlap."""
    cells = worst_cells(score, SHOWN)
    if not cells:
        return None
    half = 1.15 * max(
        float(np.abs(outlines[cell]).max())
        for outlines in (score.skin_outline_mm, score.patch_outline_mm)
        for cell in cells
    )
    limit = max(0.05, max(float(score.causes.cost[cell].max()) for cell in cells))
    blocks = [_card(subject, score, cell, half, limit, index) for index, cell in enumerate(cells)]
    return tag(
        "section",
        tag("h2", "The worst cells, and why"),
        tag(
            "p",
            "Solid line: the cell drawn on the skin. Dashed line: the patch cell that should cover "
            "it. Tinted: covered. Arrow: from the skin cell's centre to the patch cell's. "
            "All drawings have one scale, distal is down. Each bar is the overlap that would be "
            "lost if that cause were the only one; causes interact, so the bars need not add up.",
        ),
        tag("div", blocks, class_="cards"),
        _summary(score),
        id="worst",
    )


def worst_cells(score: Conformability, limit: int) -> list[tuple[int, int]]:
    """(row, column) of the scored cells with the smallest graded overlap, worst first."""
    flat = np.where(score.scored, score.overlap, np.inf).ravel()
    order = np.argsort(flat, kind="stable")[: min(limit, int(score.scored.sum()))]
    columns = score.shape[1]
    return [(int(i) // columns, int(i) % columns) for i in order]


def amounts(score: Conformability, cell: tuple[int, int]) -> dict[str, str]:
    """How large each cause is in one cell, in its own unit."""
    parts = score.causes
    longitudinal, lateral = parts.longitudinal_stretch[cell], parts.lateral_stretch[cell]
    return {
        "shift": f"{number(float(np.hypot(*parts.shift_mm[cell])), 1)} mm",
        "rotation": f"{number(float(parts.rotation_deg[cell]), 1, sign=True)}°",
        "longitudinal-stretch": f"{number(100 * (float(longitudinal) - 1), 0, sign=True)} %",
        "lateral-stretch": f"{number(100 * (float(lateral) - 1), 0, sign=True)} %",
        "shear": number(float(parts.shear[cell]), 2, sign=True),
        "rest": f"{number(float(parts.rest_mm[cell]), 1)} mm",
    }


def main_cause(score: Conformability, cell: tuple[int, int]) -> str:
    """The main cause of one cell as a sentence with its direction and size."""
    parts, main = score.causes, str(score.causes.main[cell])
    if main == "shift":
        distal, medial = (float(part) for part in parts.shift_mm[cell])
        size = float(np.hypot(distal, medial))
        towards = [
            word
            for part, word in (
                (distal, "distal" if distal > 0 else "proximal"),
                (medial, "medial" if medial > 0 else "lateral"),
            )
            if abs(part) > 0.38 * size  # beyond about 22 degrees from the other axis
        ]
        return f"Mostly shift: the patch cell lies {size:.1f} mm too far {'-'.join(towards)}."
    if main == "rotation":
        angle = float(parts.rotation_deg[cell])
        sense = "distal towards medial" if angle > 0 else "medial towards distal"
        return f"Mostly rotation: the patch cell is turned by {abs(angle):.1f}° from {sense}."
    if main in ("longitudinal-stretch", "lateral-stretch"):
        along = main == "longitudinal-stretch"
        stretch = float((parts.longitudinal_stretch if along else parts.lateral_stretch)[cell])
        words = ("long", "short") if along else ("wide", "narrow")
        word = words[0] if stretch > 1 else words[1]
        return f"Mostly size: the patch cell is {100 * abs(stretch - 1):.0f} % too {word}."
    if main == "shear":
        return f"Mostly shear: {number(float(parts.shear[cell]), sign=True)} against the skin cell."
    if main == "rest":
        return f"Mostly shape: {MEANING['rest']}."
    return "No single cause costs half a percent."


SHORT = {
    "shift": "shift",
    "rotation": "rotation",
    "longitudinal-stretch": "length",
    "lateral-stretch": "width",
    "shear": "shear",
    "rest": "rest",
}


def _card(
    subject: SubjectReport,
    score: Conformability,
    cell: tuple[int, int],
    half_mm: float,
    limit: float,
    index: int,
) -> Html:
    row, column = cell
    amount = amounts(score, cell)
    costs: NDArray[np.float64] = score.causes.cost[cell]
    bars = [
        (f"{SHORT[cause]}  {amount[cause]}", float(cost))
        for cause, cost in zip(CAUSES, costs, strict=True)
    ]
    overlap = float(score.overlap[cell])
    grade = str(score.grade[cell])
    interval = span(float(score.overlap_low[cell]), float(score.overlap_high[cell]))
    drawing = outline_card(
        score.skin_outline_mm[cell],
        score.patch_outline_mm[cell],
        bars,
        half_mm=half_mm,
        cost_limit=limit,
        mirrored=subject.mirrored,
        name=f"worst-{index}",
        alt=(
            f"Skin cell and patch cell of row {row}, column {column}: overlap "
            f"{overlap_words(overlap)}, {grade}. "
            + "; ".join(f"{label} costs {cost:.2f}" for label, cost in bars)
        ),
    )
    return figure_block(
        drawing,
        [
            tag(
                "strong",
                f"Row {row}, column {column} ({score.region[cell]}): "
                f"{overlap_words(overlap)}, {grade}. ",
            ),
            f"95 % interval {interval}. ",
            main_cause(score, cell),
        ],
        class_="card",
    )


def _summary(score: Conformability) -> Html | None:
    wanting = (score.grade == "fair") | (score.grade == "poor")
    if not wanting.any():
        return None
    rows = []
    for index, cause in enumerate(CAUSES):
        mine = wanting & (score.causes.main == cause)
        rows.append(
            (
                [
                    sentence_case(cause.replace("-", " ")),
                    tag("span", f": {MEANING[cause]}", class_="quiet"),
                ],
                int(mine.sum()),
                number(float(np.median(score.causes.cost[wanting, index]))),
                number(float(score.causes.cost[wanting, index].max())),
            )
        )
    return tag(
        "div",
        tag("p", causes_sentence(score)),
        table(
            ("Cause", "Main cause in", "Median cost", "Largest cost"),
            rows,
            caption=f"Causes over the {int(wanting.sum())} cells that are not good: number of "
            "cells in which it costs most, and the overlap that it alone costs.",
            numeric=(1, 2, 3),
            class_="wide-head",
        ),
    )
