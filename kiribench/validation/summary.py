"""The scores of a model under a protocol: each fold's, their mean and spread, and pooled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.validation import gaussian_scores, point_scores
from kiribench.validation.fold import Fold
from kiribench.validation.outcome import FoldOutcome
from kiribench.validation.table import CvTable

FloatArray = NDArray[np.float64]
#: Scores in the order of the tables, with their meaning.
SCORES: dict[str, str] = {
    "r2": "coefficient of determination",
    "rmse": "root mean square error, unit of the target",
    "rmse_over_mesh_error": "rmse over the root mean square of the table's mesh error",
    "mae": "mean absolute error, unit of the target",
    "max_error": "largest absolute error, unit of the target",
    "nlpd": "mean negative log predictive density, nats",
    "crps": "mean continuous ranked probability score, unit of the target",
    "coverage50": "share of rows inside the central 50 % interval",
    "coverage80": "share of rows inside the central 80 % interval",
    "coverage95": "share of rows inside the central 95 % interval",
    "train_r2": "coefficient of determination on (at most 500) training rows",
    "fit_s": "seconds to fit one fold (CPU; wall time on a GPU); pooled is the sum",
    "predict_s": "seconds to predict one fold; pooled is the sum",
}
TIMES = ("fit_s", "predict_s")


@dataclass(frozen=True)
class Score:
    """A score over the folds.

    Attributes:
        mean, sd: over the folds that have it; sd with n - 1, ``None`` for one fold.
        pooled: of all test rows together; repeats stand side by side.
    """

    mean: float | None
    sd: float | None
    pooled: float | None

    def as_dict(self) -> dict[str, float | None]:
        """For JSON."""
        return {"mean": self.mean, "sd": self.sd, "pooled": self.pooled}


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """The learning curve at one number of groups.

    Attributes:
        groups: that were learnt from.
        scores: as in :class:`Summary`.
    """

    groups: int
    scores: dict[str, Score]


@dataclass(frozen=True, eq=False)
class Summary:
    """A model under a protocol.

    Attributes:
        protocol, model: names.
        fold_names, fold_labels: of the k folds that have predictions.
        per_fold: by score, (k,), NaN where a fold has none.
        scores: by score, absent ones all ``None``.
        rows: (q,) test rows of all folds, one after the other.
        mean: (q,) predictions.
        sd: (q,) or ``None``.
        calibration: (stated, found) coverage, pooled; empty without uncertainty.
        closed_form: whether folds were left out of one fit.
        failures: reason by fold, for the folds without predictions.
        notes: of the first fold.
        curve: of the learning curve, else empty; ``scores`` are then those of its last point.
    """

    protocol: str
    model: str
    fold_names: tuple[str, ...]
    fold_labels: tuple[str, ...]
    per_fold: dict[str, FloatArray]
    scores: dict[str, Score]
    rows: NDArray[np.int64]
    mean: FloatArray
    sd: FloatArray | None
    calibration: list[tuple[float, float]]
    closed_form: bool
    failures: dict[str, str]
    notes: dict[str, object]
    curve: tuple[CurvePoint, ...] = ()


def summarise(table: CvTable, folds: Sequence[Fold], outcomes: Sequence[FoldOutcome]) -> Summary:
    """The scores of a model under a protocol.

    Args:
        table: the rows.
        folds: of the protocol.
        outcomes: one a fold, in the same order.
    """
    pairs = [
        (fold, outcome)
        for fold, outcome in zip(folds, outcomes, strict=True)
        if outcome.failure is None
    ]
    failures = {one.fold: one.failure for one in outcomes if one.failure is not None}
    sizes = sorted({fold.size for fold, _ in pairs if fold.size is not None})
    curve = tuple(
        CurvePoint(size, _scores(table, [pair for pair in pairs if pair[0].size == size])[1])
        for size in sizes
    )
    if sizes:  # errors at different sizes are no sample of one thing
        pairs = [pair for pair in pairs if pair[0].size == sizes[-1]]
    per_fold, scores = _scores(table, pairs)
    rows, mean, sd = _joined(pairs)
    known = sd is not None and len(rows) > 0
    return Summary(
        protocol=outcomes[0].protocol,
        model=outcomes[0].model,
        fold_names=tuple(fold.name for fold, _ in pairs),
        fold_labels=tuple(fold.label for fold, _ in pairs),
        per_fold=per_fold,
        scores=scores,
        rows=rows,
        mean=mean,
        sd=sd,
        calibration=gaussian_scores.calibration_curve(table.y[rows], mean, sd)
        if known and sd is not None
        else [],
        closed_form=any(outcome.closed_form for _, outcome in pairs),
        failures=failures,
        notes=dict(pairs[0][1].notes) if pairs else {},
        curve=curve,
    )


Pairs = Sequence[tuple[Fold, FoldOutcome]]


def _joined(pairs: Pairs) -> tuple[NDArray[np.int64], FloatArray, FloatArray | None]:
    if not pairs:
        return np.zeros(0, dtype=np.int64), np.zeros(0), None
    rows = np.concatenate([fold.test for fold, _ in pairs])
    mean = np.concatenate([outcome.mean for _, outcome in pairs])
    spreads = [outcome.sd for _, outcome in pairs if outcome.sd is not None]
    return rows, mean, np.concatenate(spreads) if len(spreads) == len(pairs) else None


def _scores(table: CvTable, pairs: Pairs) -> tuple[dict[str, FloatArray], dict[str, Score]]:
    unit = table.mesh_error_rms
    each = [
        _of_rows(table.y[fold.test], outcome.mean, outcome.sd, unit)
        | {"train_r2": outcome.train_r2, "fit_s": outcome.fit_s, "predict_s": outcome.predict_s}
        for fold, outcome in pairs
    ]
    rows, mean, sd = _joined(pairs)
    pooled: dict[str, float | None] = _of_rows(table.y[rows], mean, sd, unit) if pairs else {}
    per_fold: dict[str, FloatArray] = {}
    scores: dict[str, Score] = {}
    for name in SCORES:
        values = np.array([np.nan if (x := one[name]) is None else x for one in each], dtype=float)
        per_fold[name] = values
        known = values[np.isfinite(values)]
        of_all = float(known.sum()) if name in TIMES and len(known) else pooled.get(name)
        scores[name] = Score(
            mean=float(known.mean()) if len(known) else None,
            sd=float(known.std(ddof=1)) if len(known) > 1 else None,
            pooled=of_all,
        )
    return per_fold, scores


def _of_rows(
    truth: FloatArray, mean: FloatArray, sd: FloatArray | None, unit: float | None
) -> dict[str, float | None]:
    error = point_scores.rmse(truth, mean)
    result: dict[str, float | None] = {
        "r2": point_scores.r2(truth, mean),
        "rmse": error,
        "rmse_over_mesh_error": None if unit is None else error / unit,
        "mae": point_scores.mae(truth, mean),
        "max_error": point_scores.max_error(truth, mean),
    }
    gaussian: dict[str, Callable[[FloatArray], float]] = {
        "nlpd": lambda s: gaussian_scores.nlpd(truth, mean, s),
        "crps": lambda s: gaussian_scores.crps(truth, mean, s),
        "coverage50": lambda s: gaussian_scores.coverage(truth, mean, s, 0.50),
        "coverage80": lambda s: gaussian_scores.coverage(truth, mean, s, 0.80),
        "coverage95": lambda s: gaussian_scores.coverage(truth, mean, s, 0.95),
    }
    return result | {name: None if sd is None else score(sd) for name, score in gaussian.items()}
