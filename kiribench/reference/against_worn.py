"""Predictions beside the subject's worn scan, where there is one that a patch has made.

Which design was worn is not in a scan: every design is set beside it, and only the one that was
worn has to agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kiribench.conformability.score import ScoreOptions, score_subject
from kiribench.dataset import Subject
from kiribench.errors import KiribenchError
from kiribench.reference.check import CheckedDesign

WITHIN = 0.05
"""Difference of the satisfactory ratios, as a share of the cells, that was set as the goal."""


@dataclass(frozen=True)
class AgainstWorn:
    """The worn scan, and the designs' predicted satisfactory ratios beside its own.

    Attributes:
        worn: satisfactory ratio of the worn scan; None where it could not be scored.
        predicted: method and its predicted ratio; without those of which no cell was scored.
        reason: why the scan has no ratio.
    """

    worn: float | None
    predicted: tuple[tuple[str, float], ...]
    reason: str | None = None

    def as_object(self) -> dict[str, Any]:
        """For JSON: ratios, and differences in points (predicted minus worn)."""
        return {
            "worn_satisfactory": self.worn,
            "reason": self.reason,
            "designs": [
                {
                    "method": method,
                    "predicted_satisfactory": ratio,
                    "points": None if self.worn is None else 100 * (ratio - self.worn),
                }
                for method, ratio in self.predicted
            ],
        }

    def words(self) -> str:
        """For a person."""
        if self.worn is None:
            return f"The subject's worn scan could not be set beside this: {self.reason}"
        parts = []
        for method, ratio in self.predicted:
            apart = 100 * (ratio - self.worn)
            within = "within" if abs(ratio - self.worn) <= WITHIN + 1e-12 else "not within"
            parts.append(
                f"'{method}' is predicted {100 * ratio:.1f} %, {apart:+.1f} points ({within} "
                f"{100 * WITHIN:.0f})"
            )
        return (
            f"The subject's worn scan reads {100 * self.worn:.1f} % at least fair; "
            f"{'; '.join(parts)}. Only the design that was worn has to agree, and the scan does "
            "not say which that was. Where that one does not agree, what the model leaves out "
            "(friction, bending, thickness, how it was put on) is the first place to look."
        )


def against_worn(
    subject: Subject, checked: Sequence[CheckedDesign], options: ScoreOptions
) -> AgainstWorn:
    """Score the worn scan as ``conform`` does, and set the designs beside it."""
    predicted = tuple(
        (one.design.method, one.conformability.whole.satisfactory)
        for one in checked
        if one.conformability.whole.satisfactory is not None
    )
    try:
        worn = score_subject(subject, options).whole.satisfactory
    except KiribenchError as error:
        return AgainstWorn(None, predicted, str(error))
    if worn is None:
        return AgainstWorn(None, predicted, "none of its cells could be scored.")
    return AgainstWorn(worn, predicted)
