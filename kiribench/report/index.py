"""The index page of a dataset: every subject with its verdict and its small map."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

from kiribench.report.figures.definitions import definition_map
from kiribench.report.html import Html, table, tag
from kiribench.report.page import document
from kiribench.report.subject import SubjectReport
from kiribench.report.svg import figure_block
from kiribench.report.verdict import SYNTHETIC_NOTE, causes, verdict, weakest
from kiribench.report.words import ABSENT, count, percent, percent_span


def report_name(participant: str) -> str:
    """File name of a subject's page; harmless whatever the id contains.

    >>> report_name("S1")
    'sub-S1.html'
    >>> report_name("../x").startswith("sub-x-")
    True
    """
    plain = re.sub(r"[^A-Za-z0-9]+", "", participant)[:40]
    if plain == participant:
        return f"sub-{plain}.html"
    return f"sub-{plain}-{hashlib.sha256(participant.encode()).hexdigest()[:8]}.html"


def write_index(path: Path, subjects: Sequence[SubjectReport], *, more: Html | None = None) -> Path:
    """Write the page that leads to the subjects' pages beside it.

    Args:
        path: the HTML file; the pages of the subjects lie in the same folder, named by
            :func:`report_name`.
        subjects: of one dataset, at least one.
        more: a section to end with.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(index_page(subjects, more=more), encoding="utf-8", newline="\n")
    return path


def index_page(subjects: Sequence[SubjectReport], *, more: Html | None = None) -> str:
    """The whole HTML document of the index."""
    dataset = subjects[0].dataset
    synthetic = any(subject.synthetic for subject in subjects)
    body = tag(
        "main",
        tag(
            "header",
            tag("p", "kiribench · patch conformability", class_="kicker"),
            tag("h1", dataset),
            tag("p", f"{count(len(subjects), 'subject')}, one page each.", class_="quiet"),
            tag("p", SYNTHETIC_NOTE, class_="flag") if synthetic else None,
        ),
        tag("section", tag("h2", "Subjects"), _table(subjects), id="subjects"),
        tag(
            "section",
            tag("h2", "Side by side"),
            tag(
                "p",
                "Grades of the patch cells: G good, F fair, P poor. Framed cells get another "
                "grade by another definition of overlap. Each map leads to its subject's page.",
            ),
            tag("div", [_card(s, i) for i, s in enumerate(subjects)], class_="triple"),
            id="maps",
        ),
        more,
    )
    return document(f"{dataset}: conformability", body)


def _table(subjects: Sequence[SubjectReport]) -> Html:
    rows: list[tuple[object, ...]] = []
    for subject in subjects:
        link = tag("a", subject.participant, href=report_name(subject.participant))
        who = [link, tag("span", f" {subject.limb}", class_="quiet")]
        score = subject.conformability
        if score is None:
            rows.append((who, *[ABSENT] * 6))
            continue
        whole = score.whole
        rows.append(
            (
                who,
                percent(whole.satisfactory),
                percent_span(whole.satisfactory_low, whole.satisfactory_high),
                whole.good,
                whole.fair,
                whole.poor,
                whole.scored if whole.scored == whole.cells else f"{whole.scored} of {whole.cells}",
            )
        )
    return table(
        ("Subject", "At least fair", "95 % interval", "Good", "Fair", "Poor", "Scored"),
        rows,
        caption="Cells of each patch by grade; the interval is that of the share at least fair.",
        numeric=(1, 2, 3, 4, 5, 6),
    )


def _card(subject: SubjectReport, number: int) -> Html:
    score = subject.conformability
    link = report_name(subject.participant)
    if score is None:
        return tag(
            "div",
            tag("h3", tag("a", subject.participant, href=link)),
            tag("p", "Skin strain only."),
        )
    drawing = definition_map(
        [[str(grade) or None for grade in row] for row in score.grade],
        score.definition_matters,
        mirrored=subject.mirrored,
        name=f"map-{number}",
        alt=f"Grades of {subject.participant}: {score.whole.good} good, {score.whole.fair} fair, "
        f"{score.whole.poor} poor.",
    )
    words = [verdict(score, synthetic=subject.synthetic), weakest(score), causes(score)]
    return tag(
        "div",
        tag("h3", tag("a", subject.participant, href=link)),
        figure_block(
            tag("a", drawing, href=link, aria_label=f"Report of {subject.participant}"),
            " ".join(sentence for sentence in words if sentence),
        ),
    )
