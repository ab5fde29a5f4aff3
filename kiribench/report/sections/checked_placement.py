"""How exactly a checked design has to be put on, and how it came about."""

from __future__ import annotations

from collections.abc import Sequence

from kiribench.reference.check import CheckedDesign
from kiribench.reference.placement import DIRECTIONS, Placement, placement_text
from kiribench.report.figures.check_course import course_figure
from kiribench.report.html import Html, table, tag
from kiribench.report.svg import figure_block
from kiribench.report.words import number, percent


def placement(
    checked: Sequence[CheckedDesign], tolerances: Sequence[Placement | None]
) -> Html | None:
    """Section: tolerances of every design that has them; None without any."""
    rows = []
    for one, tolerance in zip(checked, tolerances, strict=True):
        if tolerance is None:
            continue
        for grade in ("good", "fair"):
            cells = []
            for limit in tolerance.tolerances:
                beyond = "> " if getattr(limit, f"{grade}_open") else ""
                cells.append(f"{beyond}{number(getattr(limit, grade), 1)}")
            rows.append([f"{one.design.method}, {grade}", *cells])
    known = next((one for one in tolerances if one is not None), None)
    if known is None:
        return None
    units = {one.direction: one.unit.replace("deg", "°") for one in known.tolerances}
    head = (
        "Design and grade",
        *(f"{name.replace('_', ' ')}, {units[name]}" for name in DIRECTIONS),
    )
    return tag(
        "section",
        tag("h2", "How exactly it has to be put on"),
        tag("p", placement_text(known)),
        table(
            head,
            rows,
            caption=f"Largest error in each direction at which {percent(known.share, 0)} of the "
            f"cells still have the grade by '{known.definition}'; 0 where they have not even "
            "without one. Offsets in mm on the skin as drawn; strap slip: the distal strap slides "
            "back.",
            numeric=tuple(range(1, len(head))),
        ),
        id="placement",
    )


def course(checked: Sequence[CheckedDesign]) -> Html | None:
    """Section: the steps of designs that keep theirs; None without any."""
    courses = [
        (one.design.method, one.design.settings["MethodSettings"]["Iterations"])
        for one in checked
        if isinstance(one.design.settings.get("MethodSettings"), dict)
        and isinstance(one.design.settings["MethodSettings"].get("Iterations"), list)
    ]
    if not courses:
        return None
    return tag(
        "section",
        tag("h2", "Course of the design"),
        [
            figure_block(
                course_figure(iterations, name=f"course-{index}", method=method),
                f"'{method}': distance of the corners from their nodes, step by step. A new mesh "
                "starts anew; steps are compared on one mesh only.",
            )
            for index, (method, iterations) in enumerate(courses)
        ],
        id="course",
    )
