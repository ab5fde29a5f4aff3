"""The verdict in words, for the report and for the terminal."""

from __future__ import annotations

from kiribench.conformability.result import FAIR_FROM, Conformability, RegionScore
from kiribench.report.words import listing, percent, percent_span

SYNTHETIC_NOTE = (
    "Synthetic data: all scans were computed. Nobody was scanned and nobody wore a patch."
)


def verdict(score: Conformability, *, synthetic: bool) -> str:
    """One sentence with the satisfactory ratio, its interval and the counts.

    Args:
        score: of the participant.
        synthetic: the data is computed, and the sentence says so.
    """
    who = f"{'synthetic ' if synthetic else ''}subject {score.participant}"
    whole = score.whole
    if whole.satisfactory is None:
        return f"On {who}, no cell of the patch could be scored."
    missing = whole.cells - whole.scored
    unscored = f"; {missing} of {whole.cells} cells could not be scored" if missing else ""
    fair = f"{100 * FAIR_FROM:.0f} %"
    per_cell = score.alignment == "per-cell"
    reach = (
        f"have at least {fair} of their skin covered"
        if score.grade_by == "paper"
        else f"reach an overlap of {fair} by the definition '{score.grade_by}'"
    )
    aligned = ", each cell centred on its skin cell first," if per_cell else ","
    return (
        f"On {who}{aligned} {whole.good + whole.fair} of {whole.scored} cells "
        f"({percent(whole.satisfactory)}; 95 % interval "
        f"{percent_span(whole.satisfactory_low, whole.satisfactory_high)}) {reach}: "
        f"{whole.good} good, {whole.fair} fair and {whole.poor} poor{unscored}."
    )


def weakest(score: Conformability, limit: int = 2) -> str | None:
    """Where the patch fits worst, as a sentence; None where every region is satisfactory."""
    known = [region for region in score.regions if region.satisfactory is not None]
    below = sorted((r for r in known if _share(r) < 1.0), key=_share)
    if not below:
        return None
    named = [
        f"{r.label} ({r.good + r.fair} of {r.scored} cells at least fair)" for r in below[:limit]
    ]
    return f"The weakest fit is in {listing(named)}."


def causes(score: Conformability) -> str | None:
    """The commonest main cause among the cells that are not good, as a sentence."""
    wanting = (score.grade == "fair") | (score.grade == "poor")
    mains = [str(main) for main in score.causes.main[wanting] if main not in ("", "none")]
    if not mains:
        return None
    counts = {cause: mains.count(cause) for cause in dict.fromkeys(mains)}
    first = max(counts, key=lambda cause: counts[cause])
    return (
        f"In {counts[first]} of the {int(wanting.sum())} cells that are not good the largest "
        f"single cause is {first.replace('-', ' ')}."
    )


def _share(region: RegionScore) -> float:
    return region.satisfactory if region.satisfactory is not None else 1.0
