"""One piece of work: a model on some folds of a protocol, by refits or in closed form."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from kiribench.errors import DataError, KiribenchError
from kiribench.surrogate.registry import make, spec
from kiribench.validation.fold import Fold
from kiribench.validation.outcome import FloatArray, FoldOutcome, IntArray
from kiribench.validation.point_scores import r2
from kiribench.validation.tuning import VARIANT, fit_tuned

TRAIN_ROWS = 500  # for the score on the training rows


@dataclass(frozen=True, eq=False)
class Piece:
    """A model on some folds.

    Attributes:
        model: its name.
        folds: to predict, by protocol; of closed forms all that are missing, whatever the
            protocol, for they share one fit; else one or a few of one protocol.
        closed_form: leave the folds out of one fit instead of refitting.
        X, y, group: (n, d), (n,), (n,) of the whole table.
        seed, device: of the model.
    """

    model: str
    folds: dict[str, tuple[Fold, ...]]
    closed_form: bool
    X: FloatArray
    y: FloatArray
    group: IntArray
    seed: int
    device: str


def is_gp(model: str) -> bool:
    """Whether folds can be left out of the model in closed form."""
    return not model.endswith(f":{VARIANT}") and spec(model).is_gp


def run_piece(piece: Piece) -> list[FoldOutcome]:
    """The outcomes of all folds of a piece, one thread; a model that fails gives its reason."""
    with threadpool_limits(limits=1):
        work = _closed_form if piece.closed_form else _refits
        return list(work(piece))


def _closed_form(piece: Piece) -> Iterator[FoldOutcome]:
    clock = _clock(piece.device)
    start = clock()
    # Kernel parameters and scalings of the whole table, as Dubrule's identity has it.
    model = make(piece.model, seed=piece.seed, device=piece.device)
    try:
        model.fit(piece.X, piece.y)
    except (KiribenchError, np.linalg.LinAlgError, RuntimeError, ValueError) as error:
        yield from (_failed(piece, name, fold, error) for name, fold in _each(piece))
        return
    fit_s = (clock() - start) / sum(map(len, piece.folds.values()))
    for protocol, folds in piece.folds.items():
        closed = _left_out(model, piece, protocol, folds, fit_s)
        yield from _refits(replace(piece, folds={protocol: folds})) if closed is None else closed


def _left_out(
    model: Any, piece: Piece, protocol: str, folds: tuple[Fold, ...], fit_s: float
) -> list[FoldOutcome] | None:
    """The folds of one protocol, left out of a fitted model; ``None`` where that is impossible."""
    from kiribench.surrogate.leave_out import leave_folds_out

    clock = _clock(piece.device)
    start = clock()
    try:
        left_out = leave_folds_out(model, [fold.test for fold in folds])
    except DataError as error:
        if error.code != "leave-out-cuts-resampled-curve":
            raise
        return None
    predict_s = (clock() - start) / len(folds)
    notes = _notes(model)
    return [
        FoldOutcome(
            protocol=protocol,
            model=piece.model,
            fold=fold.name,
            mean=one.mean,
            sd=one.sd,
            fit_s=fit_s,
            predict_s=predict_s,
            closed_form=True,
            notes=notes,
        )
        for fold, one in zip(folds, left_out, strict=True)
    ]


def _each(piece: Piece) -> Iterator[tuple[str, Fold]]:
    return ((protocol, fold) for protocol, folds in piece.folds.items() for fold in folds)


def _refits(piece: Piece) -> Iterator[FoldOutcome]:
    clock = _clock(piece.device)
    name, _, variant = piece.model.partition(":")
    for protocol, fold in _each(piece):
        X, y = piece.X[fold.train], piece.y[fold.train]
        start = clock()
        notes: dict[str, Any] = {}
        model: Any
        try:
            if variant == VARIANT:
                tuned = fit_tuned(
                    name, X, y, piece.group[fold.train], seed=piece.seed, device=piece.device
                )
                model = tuned.model
                notes = {"chosen": tuned.settings, "inner_rmse": tuned.inner_rmse}
                uncertain = spec(name).has_uncertainty
            else:
                model = make(piece.model, seed=piece.seed, device=piece.device).fit(X, y)
                uncertain = spec(piece.model).has_uncertainty
            fitted = clock()
            mean, sd = _predict(model, piece.X[fold.test], uncertain)
        except (KiribenchError, np.linalg.LinAlgError, RuntimeError, ValueError) as error:
            yield _failed(piece, protocol, fold, error)
            continue
        done = clock()
        if not np.isfinite(mean).all() or (sd is not None and not (sd > 0).all()):
            yield _failed(piece, protocol, fold, ValueError("a prediction is no finite number"))
            continue
        some = np.random.default_rng(piece.seed).permutation(len(y))[:TRAIN_ROWS]
        train_r2 = r2(y[some], _predict(model, X[some], False)[0])
        yield FoldOutcome(
            protocol=protocol,
            model=piece.model,
            fold=fold.name,
            mean=mean,
            sd=sd,
            fit_s=fitted - start,
            predict_s=done - fitted,
            train_r2=None if train_r2 is None or not np.isfinite(train_r2) else train_r2,
            notes={**notes, **_notes(model)},
        )


def _predict(model: Any, X: FloatArray, uncertain: bool) -> tuple[FloatArray, FloatArray | None]:
    if uncertain:
        mean, sd = model.predict(X, return_std=True)
        return np.asarray(mean, dtype=np.float64), np.asarray(sd, dtype=np.float64)
    return np.asarray(model.predict(X), dtype=np.float64), None


def _failed(piece: Piece, protocol: str, fold: Fold, error: Exception) -> FoldOutcome:
    reason = error.faults[0].what if isinstance(error, KiribenchError) else str(error)
    return FoldOutcome(
        protocol=protocol,
        model=piece.model,
        fold=fold.name,
        mean=np.zeros(0),
        sd=None,
        fit_s=0.0,
        predict_s=0.0,
        failure=f"{type(error).__name__}: {' '.join(reason.split())[:200]}",
    )


def _notes(model: Any) -> dict[str, Any]:
    notes: dict[str, Any] = {}
    if hasattr(model, "structure_"):
        notes["structure"] = model.structure_
        notes["resampling_rms"] = float(model.resampling_rms_)
    if hasattr(model, "evaluations_"):
        notes["likelihoods"] = int(model.evaluations_)
    learnt = getattr(model, "hyperparameters_", None)
    if learnt is not None:
        notes["length_scales"] = [float(x) for x in learnt.length_scales]
        notes["noise_ratio"] = float(learnt.noise_ratio)
    return notes


def _clock(device: str) -> Callable[[], float]:
    return time.process_time if device == "cpu" else time.perf_counter


def chunked(folds: Sequence[Fold], seconds_each: float, least_s: float) -> list[tuple[Fold, ...]]:
    """Folds in chunks that are worth sending to a worker: about ``least_s`` seconds each."""
    count = max(1, min(len(folds), int(least_s / max(seconds_each, 1e-6))))
    return [tuple(folds[start : start + count]) for start in range(0, len(folds), count)]
