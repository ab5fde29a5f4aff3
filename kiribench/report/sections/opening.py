"""Title, verdict and the warnings that a reader has to know first."""

from __future__ import annotations

from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, Conformability
from kiribench.errors import Fault
from kiribench.report.html import Html, tag, text
from kiribench.report.subject import SubjectReport
from kiribench.report.verdict import SYNTHETIC_NOTE, causes, verdict, weakest
from kiribench.report.words import percent, percent_span, sentence_case


def header(subject: SubjectReport) -> Html:
    """The page's title with the limb and the dataset."""
    return tag(
        "header",
        tag("p", "kiribench · patch conformability", class_="kicker"),
        tag("h1", f"{subject.participant} ", tag("span", subject.limb, class_="quiet")),
        tag("p", "Dataset: ", subject.dataset, class_="quiet"),
        tag("p", SYNTHETIC_NOTE, class_="flag") if subject.synthetic else None,
    )


def verdict_section(subject: SubjectReport) -> Html:
    """The verdict in one sentence, the numbers large, what is weakest and why."""
    score = subject.conformability
    if score is None:
        return tag(
            "section",
            tag("h2", "Verdict"),
            tag(
                "p",
                "No worn scan was scored: this report holds the skin strain alone.",
                class_="verdict",
            ),
            warnings_box(subject.all_warnings),
            id="verdict",
        )
    return tag(
        "section",
        tag("h2", "Verdict"),
        tag("p", verdict(score, synthetic=subject.synthetic), class_="verdict"),
        _numbers(score),
        [tag("p", words) for words in (weakest(score), causes(score)) if words],
        warnings_box(subject.all_warnings),
        id="verdict",
    )


def warnings_box(warnings: tuple[Fault, ...]) -> Html | None:
    """The warnings with place and remedy; None without any."""
    if not warnings:
        return None
    items = [
        tag(
            "li",
            tag("strong", fault.what),
            f" {fault.where}. " if fault.where else " ",
            f"Got {fault.got}. " if fault.got is not None else None,
            f"Expected {fault.expected}. " if fault.expected is not None else None,
            fault.remedy,
            " ",
            tag("code", fault.code),
        )
        for fault in warnings
    ]
    return tag("aside", tag("h3", "Warnings"), tag("ul", items), class_="warnings")


def _numbers(score: Conformability) -> Html:
    whole = score.whole
    big = tag(
        "div",
        tag("span", percent(whole.satisfactory), class_="big"),
        tag("span", "of cells at least fair"),
        tag(
            "span",
            "95 % interval ",
            percent_span(whole.satisfactory_low, whole.satisfactory_high),
            class_="quiet",
        ),
        class_="number",
    )
    counts = [
        tag(
            "div",
            tag("span", n, class_=f"big {name}"),
            tag("span", f"{sentence_case(name)} ({letter})"),
            tag("span", limits, class_="quiet"),
            class_="number",
        )
        for name, letter, n, limits in (
            ("good", "G", whole.good, f"overlap {percent(GOOD_FROM, 0)} or more"),
            ("fair", "F", whole.fair, f"{percent(FAIR_FROM, 0)} up to {percent(GOOD_FROM, 0)}"),
            ("poor", "P", whole.poor, f"below {percent(FAIR_FROM, 0)}"),
        )
    ]
    return tag("div", big, text(counts), class_="numbers")
