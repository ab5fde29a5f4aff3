"""One self-contained HTML file a subject: no network, readable with scripts off."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from kiribench.report.html import Html, tag, text
from kiribench.report.sections.beside_paper import paper_section
from kiribench.report.sections.fit import definitions_section, maps_section
from kiribench.report.sections.known_truth import truth_section
from kiribench.report.sections.opening import header, verdict_section
from kiribench.report.sections.record import methods_section, provenance_section, tables_section
from kiribench.report.sections.skin import skin_section
from kiribench.report.sections.space import space_section
from kiribench.report.sections.worst import worst_section
from kiribench.report.subject import SubjectReport
from kiribench.report.viewer import Viewer

CONTENTS = (
    ("verdict", "Verdict"),
    ("fit", "Fit"),
    ("definitions", "Definitions"),
    ("worst", "Worst cells"),
    ("space", "On the body"),
    ("skin", "Skin strain"),
    ("truth", "Truth"),
    ("paper", "Paper"),
    ("methods", "Methods"),
    ("provenance", "Provenance"),
    ("cells", "All cells"),
)


def write_subject_report(path: Path, subject: SubjectReport) -> Path:
    """Write the page of one subject.

    Args:
        path: the HTML file; its folder is made if it is not there.
        subject: what to show.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(subject_page(subject), encoding="utf-8", newline="\n")
    return path


def subject_page(subject: SubjectReport) -> str:
    """The whole HTML document of one subject; the same input gives the same text."""
    score = subject.conformability
    space: tuple[Html, Viewer] | None = None
    sections: list[Html | None] = [verdict_section(subject)]
    if score is not None:
        sections += [maps_section(subject, score), definitions_section(subject, score)]
        sections.append(worst_section(subject, score))
        if subject.surface is not None:
            space = space_section(subject, score, subject.surface)
            sections.append(space[0] if space else None)
    if subject.strain is not None:
        sections.append(skin_section(subject, subject.strain))
    sections += [
        truth_section(subject),
        paper_section(subject),
        methods_section(subject),
        provenance_section(subject),
        tables_section(subject),
    ]
    shown = text([section for section in sections if section])
    body = text([header(subject), _contents(shown), tag("main", shown)])
    kind = "Synthetic subject" if subject.synthetic else "Subject"
    return document(
        f"{kind} {subject.participant}: conformability",
        body,
        payload=space[1].payload if space else None,
        script_hashes=space[1].script_hashes if space else (),
    )


def document(
    title: str, body: Html, *, payload: Html | None = None, script_hashes: tuple[str, ...] = ()
) -> str:
    """A complete HTML document that may load nothing and run only the scripts named.

    Args:
        title: of the window.
        body: the content.
        payload: scripts at the end of the body.
        script_hashes: their hashes for the Content-Security-Policy.
    """
    policy = (
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
        f"form-action 'none'; script-src {' '.join(script_hashes) or chr(39) + 'none' + chr(39)}"
    )
    style = files("kiribench.report").joinpath("style.css").read_text(encoding="utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", **{"http-equiv": "Content-Security-Policy"}, content=policy),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name_="color-scheme", content="light"),
        tag("meta", name_="referrer", content="no-referrer"),
        tag("title", title),
        tag("style", Html(style)),
    )
    page = tag("html", head, "\n", tag("body", body, "\n", payload), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"


def _contents(shown: Html) -> Html:
    links = [
        tag("a", words, href=f"#{name}") for name, words in CONTENTS if f' id="{name}"' in shown
    ]
    return tag("nav", links, aria_label="Contents")
