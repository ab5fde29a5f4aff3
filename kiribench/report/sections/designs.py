"""The section of the index that leads from the scans of a subject to its designs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kiribench.report.check_words import PREDICTED_NOTE
from kiribench.report.html import Html, bullets, table, tag
from kiribench.report.words import number, percent

#: What each method is, for a reader who sees them for the first time.
METHODS = {
    "uniform": "the best pair of cut lengths for all cells, by the surrogate",
    "best uniform": "the best a = b for all cells, by the worn model: the control",
    "paper": "the paper's objective, cell by cell",
    "exact": "the least cuts that meet each cell's target",
    "balanced": "all cells at once, with equal force in series",
    "worn": "fitted to the flexed skin by the worn model itself",
    "robust": "the same, over errors of placement",
}


@dataclass(frozen=True)
class DesignsSummary:
    """Designs of one subject's patch, checked.

    Attributes:
        participant: id of the subject.
        space: name of the design space that the surrogate was fitted to.
        designs: one JSON object a design, as in ``kiribench.check/1``.
        verdict: of the check, in words.
        links: what a reader can open -> path from the index.
        ready: whether the files for the laser passed their verification.
    """

    participant: str
    space: str
    designs: Sequence[Mapping[str, Any]]
    verdict: str
    links: Mapping[str, str]
    ready: bool


def designs_section(summary: DesignsSummary) -> Html:
    """The table of the designs, the verdict and the links."""
    rows = [
        (
            one["method"],
            METHODS.get(one["method"], ""),
            percent(one["share"]["paper"]["fair"]),
            percent(one["share"]["paper"]["good"]),
            number(one["share"]["paper"]["mean"], 3),
            percent(one["share"]["strict"]["good"]),
            number(one["mesh"]["mean_overlap_error"], 3),
        )
        for one in summary.designs
    ]
    return tag(
        "section",
        tag("h2", f"From strain to a patch: {summary.participant}"),
        tag("p", PREDICTED_NOTE, class_="flag"),
        tag(
            "p",
            "The skin strain measured above is the target; the surrogate is a Gaussian process "
            f"fitted to the simulated design space ({summary.space}); every design is put on "
            "the flexed skin by the worn model and scored as a worn patch would be.",
        ),
        table(
            ("Design", "How", "At least fair", "Good", "Mean", "Good, strict", "Mesh error"),
            rows,
            caption="Predicted shares of the patch's cells, by the paper's overlap and by the "
            "strict one; the mesh error is that of a cell's overlap, on average.",
            numeric=(2, 3, 4, 5, 6),
        ),
        tag("p", summary.verdict, class_="verdict"),
        bullets(tag("a", title, href=path) for title, path in summary.links.items()),
        tag(
            "p",
            "The files for the laser were read again by independent programs and agree with "
            "the design."
            if summary.ready
            else "The files for the laser failed their verification; see the job sheet.",
            class_="quiet",
        ),
        id="designs",
    )
