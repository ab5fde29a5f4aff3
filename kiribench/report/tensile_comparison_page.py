"""One self-contained HTML file: a simulated pull beside a measured one, and what explains it."""

from __future__ import annotations

from pathlib import Path

from kiribench.reference.tensile import TensileComparison
from kiribench.reference.tensile_words import amounts_words
from kiribench.report.figures.tensile_comparison import load_figure, poisson_figure
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.svg import figure_block


def write_tensile_comparison(path: Path, found: TensileComparison, title: str) -> Path:
    """Write the page of a comparison to ``path``; ``title`` names design and test."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tensile_comparison_page(found, title), encoding="utf-8", newline="\n")
    return path


def tensile_comparison_page(found: TensileComparison, title: str) -> str:
    """The whole HTML document; the same comparison gives the same text."""
    return document(
        f"kiribench: {title}",
        text([tag("main", [_head(found, title), *tensile_sections(found)])]),
    )


def tensile_sections(found: TensileComparison) -> list[Html]:
    """The sections alone, for a page that holds more."""
    sections = [_curves(found)]
    if found.diagnosis is not None:
        sections.append(_causes(found))
    sections.append(tag("section", tag("h2", "What was assumed"), bullets(found.notes)))
    return sections


def _head(found: TensileComparison, title: str) -> Html:
    distance = found.distance
    return tag(
        "header",
        tag("p", "Simulated and measured", class_="kicker"),
        tag("h1", title),
        tag("p", found.verdict, class_="verdict"),
        bullets(
            [
                f"Poisson's ratio differs by {distance.value:.4f} rms over strain, without "
                f"scatter (95 % interval {distance.low:.4f} to {distance.high:.4f}). As read: "
                f"{distance.rms:.4f}; scatter of the cells alone would give "
                f"{distance.scatter_rms:.4f}.",
                *(
                    [f"Force: {100 * found.distance_force:.1f} % rms of the largest."]
                    if found.distance_force is not None
                    else []
                ),
                *(
                    [
                        "Simulated again with what was found, "
                        f"{found.distance_explained.value:.4f} are left."
                    ]
                    if found.distance_explained is not None
                    else []
                ),
            ]
        ),
    )


def _curves(found: TensileComparison) -> Html:
    load = load_figure(found)
    return tag(
        "section",
        tag("h2", "Curves"),
        figure_block(
            poisson_figure(found),
            "Above: Poisson's ratio of the mean strains; the band is the standard deviation over "
            "cells. Below: measured less simulated with its 95 % interval by the scatter of the "
            "cells; grey: change of the simulation by a mesh 1.6 times as coarse.",
        ),
        [
            figure_block(
                load, "The pull as the machine saw it; dashed: the simulation at the same state."
            )
        ]
        if load is not None
        else [],
    )


def _causes(found: TensileComparison) -> Html:
    diagnosis = found.diagnosis
    if diagnosis is None:
        raise ValueError("a comparison without a diagnosis has no causes to show")
    top = max(one.log_evidence for one in diagnosis.all)
    rows = [
        (
            one.name,
            f"{one.log_evidence - top:+.1f}",
            f"{one.probability:.3f}",
            amounts_words(one) if one.amounts else "-",
        )
        for one in sorted(diagnosis.all, key=lambda one: -one.log_evidence)
    ]
    alike = [
        f"{first} and {second} change this test almost alike (cosine {cosine:+.2f}): together "
        "they cannot be told apart."
        for first, second, cosine in diagnosis.alike
    ]
    return tag(
        "section",
        tag("h2", "What would explain it"),
        table(
            ("Explanation", "log evidence", "P(larger misfit)", "Amounts with 95 % intervals"),
            rows,
            caption="Each explanation by itself; 2.3 of log evidence are odds of 10, below .01 "
            "the misfit is no chance",
            numeric=(1, 2),
        ),
        bullets(alike) if alike else [],
    )
