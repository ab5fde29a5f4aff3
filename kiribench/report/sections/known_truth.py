"""A synthetic subject's results beside its known truth."""

from __future__ import annotations

from kiribench.report.html import Html, table, tag
from kiribench.report.subject import SubjectReport
from kiribench.report.truth import agreements, grades_agreeing, true_satisfactory
from kiribench.report.words import percent


def truth_section(subject: SubjectReport) -> Html | None:
    """How far every measured quantity is from the truth; None where none is known."""
    if subject.truth is None:
        return None
    found = agreements(subject.truth, subject.conformability, subject.strain)
    if not found:
        return None
    score = subject.conformability
    words = None
    if score is not None:
        agreeing = grades_agreeing(subject.truth, score)
        true = true_satisfactory(subject.truth, score.grade_by)
        if agreeing is not None and true is not None:
            words = tag(
                "p",
                f"In truth {percent(true)} of the cells are at least fair. The measured grade is "
                f"the true one in {agreeing[0]} of {agreeing[1]} cells.",
            )
    return tag(
        "section",
        tag("h2", "Against the known truth"),
        tag(
            "p",
            "This subject's surfaces, skin map and patch are closed formulas, so the right answer "
            "is known. It was computed without a mesh, by code that the analysis does not share.",
        ),
        words,
        table(
            ("Quantity", "Cells", "Largest error", "Root mean square"),
            [
                (item.quantity, item.cells, f"{item.largest:.4f}", f"{item.rms:.4f}")
                for item in found
            ],
            caption="Difference of measured and true values. The true shear is that of the cell's "
            "centre, the measured one is fitted over the whole cell.",
            numeric=(1, 2, 3),
        ),
        id="truth",
    )
