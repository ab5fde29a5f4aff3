"""Models ranked: what counts as a difference that nobody would act on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from kiribench.validation.ranking import Ranking, rank

FOLDS = tuple(
    cast(Any, SimpleNamespace(name=f"f{i}", test=np.arange(10), train=np.arange(90)))
    for i in range(10)
)


def ranking(mesh_error: float | None, spread: float, better: float, worse: float) -> Ranking:
    """Two models over ten folds, with errors that scatter by a hundredth."""
    rng = np.random.default_rng(3)

    def errors(size: float) -> Any:
        return SimpleNamespace(
            protocol="grouped",
            failures={},
            fold_names=[fold.name for fold in FOLDS],
            per_fold={"rmse": size * (1 + 0.01 * rng.standard_normal(len(FOLDS)))},
        )

    y = spread * np.array([-1.0, 1.0])
    table = cast(Any, SimpleNamespace(mesh_error_rms=mesh_error, y=y))
    return rank(table, FOLDS, {"one": errors(better), "two": errors(worse)})


def test_half_width_is_a_tenth_of_the_mesh_error() -> None:
    found = ranking(0.01, 1.0, 0.002, 0.0025)
    assert found.rope == pytest.approx(0.001)
    assert found.places[1].words == "practically equal to one"


def test_without_mesh_error_twice_the_error_is_never_practically_equal() -> None:
    # A hundredth of the spread is .01 here, far more than what parts the two.
    found = ranking(None, 1.0, 0.002, 0.004)
    assert found.rope == pytest.approx(0.1 * found.places[0].rmse)
    assert found.places[1].words == "worse than one"


def test_without_mesh_error_errors_near_the_spread_are_parted_by_a_hundredth_of_it() -> None:
    found = ranking(None, 1.0, 0.5, 0.51)
    assert found.rope == pytest.approx(0.01)
