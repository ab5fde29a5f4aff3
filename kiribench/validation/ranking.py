"""Models in the order of their error, with words that claim no more than the folds show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from kiribench.validation.fold import Fold
from kiribench.validation.significance import Comparison, compare, holm
from kiribench.validation.summary import Summary
from kiribench.validation.table import CvTable

LEVEL = 0.05
EQUIVALENT = 0.95
MESH_SHARE = 0.1  # half width of the ROPE in mesh errors
SD_SHARE = 0.01  # and, without mesh error, in standard deviations of the targets,
BEST_SHARE = 0.1  # but no more than this share of the best model's error


@dataclass(frozen=True)
class Place:
    """A model in a ranking.

    Attributes:
        model: its name.
        rmse: mean over the folds that all ranked models have.
        comparison: with the best model; ``None`` for the best itself.
        p_adjusted: Holm's, over all comparisons with the best.
        words: ``best``, ``worse than NAME``, ``no difference shown``, or
            ``practically equal``.
    """

    model: str
    rmse: float
    comparison: Comparison | None
    p_adjusted: float | None
    words: str


@dataclass(frozen=True)
class Ranking:
    """Models by their mean RMSE under one protocol.

    Attributes:
        protocol: its name.
        folds: number of folds that all of them have.
        rope: half width of the region of practical equivalence, unit of the target.
        places: best first.
        unranked: reason by model.
    """

    protocol: str
    folds: int
    rope: float
    places: tuple[Place, ...]
    unranked: dict[str, str]

    @property
    def best(self) -> str | None:
        """The model with the smallest error, which others may share."""
        return self.places[0].model if self.places else None


def rope_of(table: CvTable, best_rmse: float) -> float:
    """A difference in RMSE that nobody would act on, unit of the target."""
    unit = table.mesh_error_rms
    if unit is not None:
        return MESH_SHARE * unit
    return min(SD_SHARE * float(table.y.std()), BEST_SHARE * best_rmse)


def rank(table: CvTable, folds: tuple[Fold, ...], summaries: dict[str, Summary]) -> Ranking:
    """Order the models by their mean RMSE over common folds, and compare each with the best.

    Args:
        table: for the scale of the ROPE.
        folds: of the protocol.
        summaries: by model, of one protocol.
    """
    protocol = next(iter(summaries.values())).protocol
    by_name = {fold.name: fold for fold in folds}
    unranked = {
        name: f"no prediction in {len(one.failures)} of {len(folds)} folds"
        for name, one in summaries.items()
        if one.failures
    }
    ranked = {name: one for name, one in summaries.items() if name not in unranked}
    if not ranked:
        return Ranking(protocol, 0, rope_of(table, 0.0), (), unranked)
    common = [
        name
        for name in next(iter(ranked.values())).fold_names
        if all(name in one.fold_names for one in ranked.values())
    ]
    errors = {
        name: np.array(
            [one.per_fold["rmse"][one.fold_names.index(fold)] for fold in common], dtype=float
        )
        for name, one in ranked.items()
    }
    order = sorted(errors, key=lambda name: float(errors[name].mean()))
    best = order[0]
    rope = rope_of(table, float(errors[best].mean()))
    ratio = float(np.mean([len(by_name[fold].test) / len(by_name[fold].train) for fold in common]))
    if len(common) < 2:
        places = tuple(
            Place(name, float(errors[name].mean()), None, None, "best" if name == best else "")
            for name in order
        )
        return Ranking(protocol, len(common), rope, places, unranked)
    compared = {
        name: compare(errors[name], errors[best], test_over_train=ratio, rope=rope)
        for name in order[1:]
    }
    adjusted = dict(zip(compared, holm([one.p_value for one in compared.values()]), strict=True))
    places_ = [Place(best, float(errors[best].mean()), None, None, "best")]
    for name, one in compared.items():
        words = _words(one, adjusted[name], best)
        places_.append(Place(name, float(errors[name].mean()), one, adjusted[name], words))
    return Ranking(protocol, len(common), rope, tuple(places_), unranked)


def _words(one: Comparison, p_adjusted: float, best: str) -> str:
    if one.p_equivalent >= EQUIVALENT:
        return f"practically equal to {best}"
    if p_adjusted < LEVEL:
        return f"worse than {best}"
    return "no difference shown"


def ranking_object(ranking: Ranking) -> dict[str, Any]:
    """For JSON."""
    places = []
    for place in ranking.places:
        entry: dict[str, Any] = {"model": place.model, "rmse": place.rmse, "words": place.words}
        if place.comparison is not None:
            one = place.comparison
            entry["against_best"] = {
                "difference": one.difference,
                "interval95": [one.low, one.high],
                "statistic": one.statistic if np.isfinite(one.statistic) else None,
                "p_value": one.p_value,
                "p_adjusted": place.p_adjusted,
                "p_worse": one.p_worse,
                "p_equivalent": one.p_equivalent,
                "p_better": one.p_better,
            }
        places.append(entry)
    return {
        "protocol": ranking.protocol,
        "score": "rmse",
        "folds": ranking.folds,
        "rope": ranking.rope,
        "places": places,
        "unranked": ranking.unranked,
    }
