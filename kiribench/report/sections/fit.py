"""Where the patch fits: regions, cells, and what the definition of overlap changes."""

from __future__ import annotations

import numpy as np

from kiribench.conformability.result import DEFINITIONS, Conformability, GradeBy
from kiribench.report.figures.definitions import definition_map
from kiribench.report.figures.grades import grade_map
from kiribench.report.figures.regions import region_map
from kiribench.report.html import Html, table, tag
from kiribench.report.subject import SubjectReport
from kiribench.report.svg import figure_block
from kiribench.report.words import count, listing, number, percent, percent_span

REGION_NAMES = {
    "S": "superior to the patella",
    "I": "inferior to the patella",
    "LS": "lateral, superior",
    "MS": "medial, superior",
    "LI": "lateral, inferior",
    "MI": "medial, inferior",
    "P": "patellar",
}
FORMULA: dict[GradeBy, str] = {
    "paper": "covered part of the skin cell; an oversized patch cell is not penalised",
    "strict": "common area over the larger of the two cells",
    "iou": "common area over the area that either of the two covers",
}


def side_words(subject: SubjectReport) -> str:
    """How the maps are turned."""
    if subject.side in {"left", "right"}:
        where = "right" if subject.mirrored else "left"
        return f"Drawn as the {subject.side} limb is seen from the front: lateral at the {where}."
    return "Lateral (column 0) at the left."


def maps_section(subject: SubjectReport, score: Conformability) -> Html:
    """The regional map, the cell map and the table of regions."""
    rows, columns = score.shape
    region = [[str(label) for label in row] for row in score.region]
    grades = [[str(grade) or None for grade in row] for row in score.grade]
    ratios = {r.label: (r.good + r.fair, r.scored) for r in score.regions}
    shares = "; ".join(
        f"{r.label} {r.good + r.fair} of {r.scored}" for r in score.regions if r.scored
    )
    whole = score.whole
    regions = region_map(
        region,
        ratios,
        mirrored=subject.mirrored,
        alt=f"Map of {len(score.regions)} regions. Cells at least fair: {shares}.",
    )
    cells = grade_map(
        grades,
        score.overlap,
        region,
        score.definition_matters,
        mirrored=subject.mirrored,
        alt=(
            f"Map of {rows} by {columns} cells: {whole.good} good, {whole.fair} fair, "
            f"{whole.poor} poor. The numbers are in the table of all cells below."
        ),
    )
    contested = int(score.definition_matters.sum())
    return tag(
        "section",
        tag("h2", "Where it fits"),
        tag(
            "div",
            figure_block(
                regions,
                "Share of scored cells that are at least fair, region by region; the darker, the "
                "better. " + side_words(subject),
            ),
            figure_block(
                cells,
                f"Grade and overlap of every cell, graded by '{score.grade_by}'. Heavy lines are "
                f"the borders of the regions. A corner mark ({count(contested, 'cell')}) warns "
                "that another definition of overlap gives another grade.",
            ),
            class_="pair",
        ),
        _region_table(score, knee=subject.layout.body_part == "knee"),
        id="fit",
    )


def _region_table(score: Conformability, *, knee: bool) -> Html:
    rows = [
        (
            "Whole patch" if r is score.whole else _named(r.label, knee),
            percent(r.satisfactory),
            percent_span(r.satisfactory_low, r.satisfactory_high),
            r.good,
            r.fair,
            r.poor,
            r.scored if r.scored == r.cells else f"{r.scored} of {r.cells}",
            number(r.mean_overlap),
        )
        for r in (*score.regions, score.whole)
    ]
    return table(
        ("Region", "At least fair", "95 % interval", "Good", "Fair", "Poor", "Scored", "Mean"),
        rows,
        caption="Regions. The interval comes from the uncertainty of the nodes and of the "
        "registration; the last column is the mean overlap.",
        numeric=(1, 2, 3, 4, 5, 6, 7),
        class_="last-strong wide-head",
    )


def _named(label: str, knee: bool) -> Html:
    words = REGION_NAMES.get(label) if knee else None
    return tag("span", label, tag("span", f" {words}", class_="quiet") if words else None)


def definitions_section(subject: SubjectReport, score: Conformability) -> Html:
    """The same patch graded by each of the three definitions, side by side."""
    counts = {
        name: {
            grade: int((score.grades[name] == grade).sum()) for grade in ("good", "fair", "poor")
        }
        for name in DEFINITIONS
    }
    scored = score.whole.scored
    blocks = []
    for name in DEFINITIONS:
        n = counts[name]
        drawing = definition_map(
            [[str(grade) or None for grade in row] for row in score.grades[name]],
            score.definition_matters,
            mirrored=subject.mirrored,
            name=f"definition-{name}",
            alt=f"Grades by {name}: {n['good']} good, {n['fair']} fair, {n['poor']} poor.",
        )
        used = " (used here)" if name == score.grade_by else ""
        share = percent((n["good"] + n["fair"]) / scored) if scored else "none scored"
        blocks.append(
            figure_block(
                drawing,
                [
                    tag("strong", f"{name}{used}: {share} at least fair. "),
                    f"{n['good']} good, {n['fair']} fair, {n['poor']} poor. ",
                    f"Overlap is the {FORMULA[name]}.",
                ],
            )
        )
    changed = int(score.definition_matters.sum())
    places = [f"({r}, {c})" for r, c in np.argwhere(score.definition_matters)]
    words = (
        f"The grade of {count(changed, 'cell')} of {scored} depends on the definition"
        if changed
        else "No cell's grade depends on the definition"
    )
    if 0 < changed <= 12:
        words += f": (row, column) {listing(places)}"
    return tag(
        "section",
        tag("h2", "What the definition of overlap changes"),
        tag(
            "p",
            "The paper scores 'areal overlap' without a formula, so all three readings are shown. ",
            words,
            ". Framed cells get different grades.",
        ),
        tag("div", blocks, class_="triple"),
        id="definitions",
    )
