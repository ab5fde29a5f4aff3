"""The report of a cross-validation: one self-contained HTML file."""

from __future__ import annotations

from pathlib import Path

from kiribench.report.cv_sections import (
    calibration_section,
    checks_section,
    learning_section,
    protocols_section,
    ranking_section,
    record_section,
    residuals_section,
    table_one_section,
    time_section,
)
from kiribench.report.html import Html, tag, text
from kiribench.report.page import document
from kiribench.validation.checks import CheckResult
from kiribench.validation.export import verdict
from kiribench.validation.run import CvResult
from kiribench.validation.table1 import TableOne

CONTENTS = (
    ("ranking", "Ranking"),
    ("table1", "Table 1"),
    ("protocols", "Protocols"),
    ("residuals", "Residuals"),
    ("calibration", "Calibration"),
    ("learning", "Learning curve"),
    ("time", "Time"),
    ("checks", "Checks"),
    ("record", "Record"),
)


def write_cv_report(
    path: Path,
    result: CvResult,
    checks: tuple[CheckResult, ...],
    table_one: TableOne | None,
) -> Path:
    """Write the report.

    Args:
        path: the HTML file; its folder is made if it is not there.
        result: of :func:`kiribench.validation.run.cross_validate`.
        checks: what the numbered checks found.
        table_one: the comparison with the paper, for a design space.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(cv_page(result, checks, table_one), encoding="utf-8", newline="\n")
    return path


def cv_page(result: CvResult, checks: tuple[CheckResult, ...], table_one: TableOne | None) -> str:
    """The whole HTML document."""
    sections = [
        ranking_section(result),
        table_one_section(result, table_one),
        protocols_section(result),
        residuals_section(result),
        calibration_section(result),
        learning_section(result),
        time_section(result),
        checks_section(checks),
        record_section(result),
    ]
    shown = text([section for section in sections if section])
    head = tag(
        "header",
        tag("p", "kiribench · surrogates compared", class_="kicker"),
        tag("h1", result.table.files[0].name if result.table.files else "Cross-validation"),
        tag("p", verdict(result, checks), class_="verdict"),
    )
    return document("Surrogates compared", text([head, _contents(shown), tag("main", shown)]))


def _contents(shown: Html) -> Html:
    links = [
        tag("a", words, href=f"#{name}") for name, words in CONTENTS if f' id="{name}"' in shown
    ]
    return tag("nav", links, aria_label="Contents")
