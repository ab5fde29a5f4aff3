"""Sections of a checked design: designs side by side, cells, strains against their targets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kiribench.conformability.result import DEFINITIONS
from kiribench.reference.check import CheckedDesign
from kiribench.reference.export import check_object, contact_words, overlap_flag, tip_words
from kiribench.reference.ground import FlatGround
from kiribench.report.figures.definitions import definition_map
from kiribench.report.figures.grades import grade_map
from kiribench.report.figures.heatmap import heatmap, scale_limit
from kiribench.report.html import Html, bullets, table, tag
from kiribench.report.svg import figure_block
from kiribench.report.words import count, number, percent


def methods(checked: Sequence[CheckedDesign]) -> Html:
    """Section: all designs in a table and as maps of their grades."""
    rows, maps = [], []
    for index, one in enumerate(checked):
        content = check_object(one)
        share = content["share"]
        rows.append(
            [
                one.design.method,
                *(
                    percent(share[name][key])
                    for name in DEFINITIONS[:2]
                    for key in ("fair", "good")
                ),
                *(number(share[name]["mean"], 3) for name in DEFINITIONS),
                number(content["mesh"]["largest_overlap_error"], 3),
                number(content["face_overlap_mm"], 2),
            ]
        )
        score = one.conformability
        maps.append(
            figure_block(
                definition_map(
                    _grades(one),
                    np.zeros(score.shape, dtype=bool),
                    mirrored=_mirrored(one),
                    name=f"method-{index}",
                    alt=f"Grades of {one.design.method}: {score.whole.good} good, "
                    f"{score.whole.fair} fair, {score.whole.poor} poor.",
                ),
                [
                    tag("strong", f"{one.design.method}: "),
                    f"{score.whole.good} good, {score.whole.fair} fair, {score.whole.poor} poor.",
                ],
            )
        )
    head = ("Design", "Fair, paper", "Good, paper", "Fair, strict", "Good, strict", "Mean, paper",
            "Mean, strict", "Mean, iou", "Mesh error", "Faces, mm")  # fmt: skip
    return tag(
        "section",
        tag("h2", "Designs side by side"),
        table(
            head,
            rows,
            caption="Share of cells that are at least fair (overlap 75 % or more) and good (90 % "
            "or more) by two definitions, mean overlaps, the largest error of an overlap by the "
            "mesh, and the depth to which cut faces pass through each other.",
            numeric=tuple(range(1, len(head))),
        ),
        [
            tag("p", tag("strong", f"{one.design.method}: "), flag, class_="flag")
            for one in checked
            if (flag := overlap_flag(one))
        ],
        tag("div", maps, class_="triple"),
        id="designs",
    )


def cells(first: CheckedDesign) -> Html:
    """Section: grade and mesh error of every cell, contact, cut tips."""
    score = first.conformability
    drawing = grade_map(
        _grades(first),
        score.overlap,
        [[str(label) for label in row] for row in first.design.region],
        score.definition_matters,
        mirrored=_mirrored(first),
        alt=f"Predicted grades of {first.design.method}: {score.whole.good} good, "
        f"{score.whole.fair} fair, {score.whole.poor} poor.",
    )
    mesh = heatmap(
        first.mesh_overlap,
        limit=scale_limit(first.mesh_overlap),
        label="error of the overlap by the mesh",
        mirrored=_mirrored(first),
        name="mesh-error",
        alt="Estimated error of every cell's overlap by the mesh.",
    )
    content = check_object(first)
    contested = count(int(score.definition_matters.sum()), "cell")
    notes = [
        f"Graded by '{score.grade_by}'; the grade of {contested} depends on the definition "
        "(corner mark).",
        *([contact_words(content["contact"])] if first.ground.kind == "worn" else []),
        *([tip_words(content["tips"])] if first.worn.tip_stretch.size else []),
    ]
    ground = first.ground
    if isinstance(ground, FlatGround) and ground.flat is not None:
        notes.append(
            "The skin does not lie flat: its cells' edges had to change by "
            f"{percent(ground.flat.strain_rms)} (rms). The flat check cannot show that part."
        )
    return tag(
        "section",
        tag("h2", f"Cells of {first.design.method}"),
        tag(
            "div",
            figure_block(drawing, "Predicted grade and overlap of every cell."),
            figure_block(
                mesh,
                "What the mesh adds, from two meshes. A grade closer than this to its limit is "
                "not decided.",
            ),
            class_="pair",
        ),
        bullets(notes),
        id="cells",
    )


def errors(first: CheckedDesign) -> Html:
    """Section: strain, Poisson's ratio and shear of every cell against the target."""
    measure = first.design.strain_measure
    parts = [
        ("strain-error", first.strain_error, f"longitudinal strain ({measure}), minus target"),
        ("poisson-error", first.poisson_error, f"Poisson's ratio ({measure}), minus target"),
        ("shear", first.worn.shear, "shear of the patch cell"),
    ]
    blocks = []
    for name, values, label in parts:
        if not np.isfinite(values).any():
            continue
        blocks.append(
            figure_block(
                heatmap(
                    values,
                    limit=scale_limit(values, ceiling=1.0),
                    label=label,
                    mirrored=_mirrored(first),
                    name=name,
                    alt=f"Map of the {label}.",
                ),
                f"{label[:1].upper()}{label[1:]}.",
            )
        )
    source = (
        "the design's own targets"
        if first.target_source == "design"
        else "what the skin does, because the design table has no targets"
    )
    return tag(
        "section",
        tag("h2", "Strain against its target"),
        tag(
            "p",
            f"Of {first.design.method}, as simulated, against {source}. A patch whose corners lie "
            "on their nodes has no error here but that of the target itself.",
        ),
        tag("div", blocks, class_="triple"),
        id="errors",
    )


def _grades(checked: CheckedDesign) -> list[list[str | None]]:
    return [[str(grade) or None for grade in row] for row in checked.conformability.grade]


def _mirrored(checked: CheckedDesign) -> bool:
    return checked.design.side == "left"
