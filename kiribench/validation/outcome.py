"""What one fit of one model gave on one fold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FoldOutcome:
    """Predictions of the test rows of a fold, or why there are none.

    Attributes:
        protocol, model, fold: names; ``fold`` is :attr:`kiribench.validation.fold.Fold.name`.
        mean: (q,) predictions in the order of the fold's test rows, unit of the targets.
        sd: (q,) standard deviation of an observation, or ``None``.
        fit_s, predict_s: seconds of CPU time (wall time on a GPU); of closed-form folds an
            equal share of the one fit and of the leaving out.
        train_r2: on at most 500 training rows; ``None`` where not computed.
        closed_form: whether the fold was left out in closed form.
        failure: the reason where the model gave no prediction, else ``None``.
        notes: further facts of the fit: structure, likelihoods, chosen settings.
    """

    protocol: str
    model: str
    fold: str
    mean: FloatArray
    sd: FloatArray | None
    fit_s: float
    predict_s: float
    train_r2: float | None = None
    closed_form: bool = False
    failure: str | None = None
    notes: dict[str, Any] = field(default_factory=dict)
