"""What a fit is expected to cost, so that a slow model can skip a long protocol and say so.

A fixed table, not a stopwatch: whether a model takes part must not depend on how busy the
machine is. The seconds were measured on one core at 10,000 rows (400 designs x 25 strains);
fits of other sizes are scaled by the power of the rows that was measured with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kiribench.validation.fold import Fold

ROWS = 10_000


@dataclass(frozen=True)
class Cost:
    """CPU seconds of one fit at 10,000 rows, and how they grow.

    Attributes:
        seconds: of one fit and prediction of a tenth as many rows.
        power: of the rows.
        least: seconds of a small fit.
    """

    seconds: float
    power: float = 1.0
    least: float = 0.01


_COSTS = {
    "gp": Cost(0.4, 1.5, 0.1),
    "gp:paper": Cost(1.5, 1.5, 0.1),
    "gp:shared-sigma": Cost(0.2, 1.5, 0.1),
    "gp_kronecker": Cost(2.2, 1.5, 0.2),
    "svgp": Cost(0.9, 0.5, 0.3),
    "gradient_boosting": Cost(0.5),
    "gradient_boosting:paper": Cost(0.1),
    "random_forest": Cost(0.4),
    "random_forest:paper": Cost(0.2),
    "polynomial": Cost(0.01),
    "hist_gradient_boosting": Cost(0.4, 0.5),
    "lightgbm": Cost(0.2, 0.5),
    "rbf": Cost(0.2),
    "mlp_ensemble": Cost(0.5, 0.0, 0.5),
}
UNKNOWN = Cost(5.0)
TUNING_FITS = 25  # settings tried x inner folds, see tuning


def cost_of(model: str) -> Cost:
    """The table's row for a model; a tuned one costs its inner fits as well."""
    name, _, variant = model.partition(":")
    if variant != "tuned":
        return _COSTS.get(model, UNKNOWN)
    plain = _COSTS.get(name, UNKNOWN)
    return Cost(plain.seconds * TUNING_FITS, plain.power, plain.least * TUNING_FITS)


def expected_seconds(model: str, folds: Sequence[Fold], *, one_fit: bool) -> float:
    """CPU seconds of all folds of a protocol.

    Args:
        model: its name.
        folds: of the protocol.
        one_fit: whether the folds are left out of one fit in closed form.
    """
    cost = cost_of(model)
    rows = np.array([len(fold.train) for fold in folds], dtype=np.float64)
    if one_fit:
        rows = rows[:1]
    return float(np.maximum(cost.least, cost.seconds * (rows / ROWS) ** cost.power).sum())
