"""One self-contained HTML file of checked designs: verdict, grades, body, errors, placement."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kiribench.reference.check import CheckedDesign
from kiribench.reference.export import pose_words, rest_object, rest_words
from kiribench.reference.placement import Placement
from kiribench.report.check_words import PREDICTED_NOTE, check_verdict
from kiribench.report.html import Html, bullets, tag, text
from kiribench.report.page import document
from kiribench.report.sections import checked_body, checked_cells, checked_placement
from kiribench.report.verdict import SYNTHETIC_NOTE


def write_check_page(
    path: Path,
    checked: Sequence[CheckedDesign],
    tolerances: Sequence[Placement | None],
    *,
    synthetic: bool = False,
    note: str | None = None,
) -> Path:
    """Write the page.

    Args:
        path: the HTML file.
        checked: designs of one patch on one ground; the first is shown in full.
        tolerances: one a design, or None.
        synthetic: the skin is computed, and the page says so first.
        note: what is said of the subject's worn scan, if there is one.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    page = check_page(checked, tolerances, synthetic=synthetic, note=note)
    path.write_text(page, encoding="utf-8", newline="\n")
    return path


def check_page(
    checked: Sequence[CheckedDesign],
    tolerances: Sequence[Placement | None],
    *,
    synthetic: bool = False,
    note: str | None = None,
) -> str:
    """The whole HTML document; the same designs give the same text."""
    first = checked[0]
    space = checked_body.body(first)
    sections: list[Html | None] = [
        checked_cells.methods(checked),
        checked_cells.cells(first),
        space[0] if space else None,
        checked_cells.errors(first),
        checked_placement.placement(checked, tolerances),
        checked_placement.course(checked),
        _beside(note),
        _record(first),
    ]
    body = text([_head(checked, synthetic), tag("main", [one for one in sections if one])])
    who = first.design.participant or "a patch"
    return document(
        f"{who}: predicted conformability",
        body,
        payload=space[1].payload if space else None,
        script_hashes=space[1].script_hashes if space else (),
    )


def _head(checked: Sequence[CheckedDesign], synthetic: bool) -> Html:
    first = checked[0]
    where = "worn on the flexed skin" if first.ground.kind == "worn" else "in the plane"
    return tag(
        "header",
        tag("p", "kiribench · check of a design", class_="kicker"),
        tag("h1", f"{first.design.participant or 'Patch'} ", tag("span", where, class_="quiet")),
        tag("p", PREDICTED_NOTE, class_="flag"),
        tag("p", SYNTHETIC_NOTE, class_="flag") if synthetic else None,
        tag("p", check_verdict(checked, note=False), class_="verdict"),
    )


def _beside(note: str | None) -> Html | None:
    if note is None:
        return None
    return tag("section", tag("h2", "Predicted and worn"), tag("p", note), id="worn-scan")


def _record(first: CheckedDesign) -> Html:
    options, rest, pose = first.options, rest_object(first), pose_words(first)
    friction = "full stick" if np.isinf(options.spec.friction) else f"{options.spec.friction:g}"
    return tag(
        "section",
        tag("h2", "How it was computed"),
        bullets(
            [
                "A membrane of incompressible neo-Hookean rubber in plane stress, with every cut "
                "as a slit, free to slide on a smooth map of the skin through the scanned nodes.",
                f"Friction {friction}; straps '{options.spec.straps}'; "
                f"{options.elements} elements a facet edge, "
                + (
                    f"judged against {options.coarser}."
                    if first.coarse is not None
                    else "the coarsest mesh there is."
                ),
                "Overlaps by the code that scores a worn scan; no registration, the corners were "
                "computed on the bare scan. Intervals hold the uncertainty of the skin's nodes.",
                "Not in it: bending, contact of the cut faces, thickness, viscosity, a skin that "
                "gives way, and everything that a person does while putting it on.",
                *([] if pose is None else [pose]),
                *([] if rest is None else [rest_words(rest)]),
            ]
        ),
        id="record",
    )
