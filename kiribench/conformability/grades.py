"""Overlap to grade, and grades to counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, RegionScore

FloatArray = NDArray[np.float64]
TextArray = NDArray[np.str_]

#: Rounding allowance: an overlap of exactly .75 is fair although its computed area ratio
#: may end in ...9999. Far below anything that a scan can resolve.
ROUNDING = 1e-9


def grade_of(overlap: FloatArray) -> TextArray:
    """Grade of each overlap: good from .90, fair from .75 on, poor below.

    >>> grade_of(np.array([0.95, 0.90, 0.75, 0.74, np.nan]))
    array(['good', 'good', 'fair', 'poor', ''], dtype='<U4')

    Args:
        overlap: any shape, fractions; NaN gives ``""``.
    """
    grade = np.full(overlap.shape, "", dtype="<U4")
    known = np.isfinite(overlap)
    grade[known] = "poor"
    with np.errstate(invalid="ignore"):
        grade[known & (overlap >= FAIR_FROM - ROUNDING)] = "fair"
        grade[known & (overlap >= GOOD_FROM - ROUNDING)] = "good"
    return grade


def region_score(
    label: str,
    inside: NDArray[np.bool_],
    overlap: FloatArray,
    grade: TextArray,
    draws: FloatArray,
) -> RegionScore:
    """Counts of the cells inside a region, with the interval of the satisfactory ratio.

    Args:
        label: the region's label.
        inside: (R, C) cells of the region.
        overlap: (R, C) graded overlap, NaN where not scored.
        grade: (R, C) grades, ``""`` where not scored.
        draws: (n, R, C) Monte Carlo overlaps, NaN where not scored.
    """
    scored = inside & (grade != "")
    count = int(scored.sum())
    good, fair, poor = (int((grade[scored] == name).sum()) for name in ("good", "fair", "poor"))
    if count == 0:
        return RegionScore(label, int(inside.sum()), 0, 0, 0, 0, None, None, None, None)
    ratios = (draws[:, scored] >= FAIR_FROM - ROUNDING).mean(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return RegionScore(
        label=label,
        cells=int(inside.sum()),
        scored=count,
        good=good,
        fair=fair,
        poor=poor,
        satisfactory=(good + fair) / count,
        satisfactory_low=float(low),
        satisfactory_high=float(high),
        mean_overlap=float(overlap[scored].mean()),
    )


def region_scores(
    region: TextArray, overlap: FloatArray, grade: TextArray, draws: FloatArray
) -> tuple[RegionScore, ...]:
    """One :class:`RegionScore` a label, in the order in which the labels first appear.

    Args:
        region: (R, C) labels; the others as in :func:`region_score`.
    """
    labels = list(dict.fromkeys(str(label) for label in region.ravel()))
    return tuple(
        region_score(label, np.asarray(region == label), overlap, grade, draws) for label in labels
    )
