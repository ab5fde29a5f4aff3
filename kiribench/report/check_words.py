"""The verdict on checked designs in words, for the page and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from kiribench.reference.check import CheckedDesign
from kiribench.report.words import listing, percent

PREDICTED_NOTE = "Predicted is not worn: all of this was simulated, and nobody wore the patch."

DRAWN_NOTE = (
    "The synthetic subject has a worn scan too, but its misfit was drawn at random, and no design "
    "and no mechanics made it. Predicted and worn satisfactory ratios have nothing to agree in, "
    "so they are not compared."
)


def check_verdict(checked: Sequence[CheckedDesign], *, note: bool = True) -> str:
    """One or two sentences: the best design, the others, and what limits it.

    Args:
        checked: designs of one patch on one ground.
        note: end with ``PREDICTED_NOTE``.
    """
    ranked = sorted(
        checked,
        key=lambda one: (
            -(one.conformability.whole.satisfactory or 0.0),
            -one.conformability.whole.good,
            -(one.conformability.whole.mean_overlap or 0.0),
        ),
    )
    best = ranked[0]
    whole = best.conformability.whole
    if whole.satisfactory is None:
        return "No cell of the patch could be scored."
    where = "as worn" if best.ground.kind == "worn" else "in the plane"
    words = (
        f"'{best.design.method}' is predicted, {where}, to be at least fair in "
        f"{percent(whole.satisfactory)} and good in {percent(whole.good / whole.scored)} of "
        f"{whole.scored} cells (mean overlap {whole.mean_overlap:.3f})"
    )
    others = [
        f"'{one.design.method}' {percent(one.conformability.whole.satisfactory)} and "
        f"{percent(one.conformability.whole.good / max(1, one.conformability.whole.scored))}"
        for one in ranked[1:]
    ]
    words += f"; {listing(others)}." if others else "."
    limits = sorted({cause for cause, share in limiting(best).items() if share > 0})
    if limits:
        words += f" What is left in its cells that are not good is {listing(limits)}."
    return f"{words} {PREDICTED_NOTE}" if note else words


def limiting(checked: CheckedDesign) -> dict[str, int]:
    """Main causes of the cells that are not good, in words, with their counts."""
    score = checked.conformability
    out: dict[str, int] = {}
    for grade, cause in zip(score.grade.ravel(), score.causes.main.ravel(), strict=True):
        if grade in ("fair", "poor") and cause not in ("", "none"):
            words = str(cause).replace("-", " ")
            out[words] = out.get(words, 0) + 1
    return out
