"""Where a design on the skin starts from: the first method whose patch can be worn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from design_toys import drawn_problem, surrogates

from kiribench.design import on_skin
from kiribench.errors import NotConvergedError


class Reached(Exception):
    """The search for a start ended; carries its method."""


def started(monkeypatch: pytest.MonkeyPatch, refusals: int, start: str | None = None) -> int:
    """How many starts were tried where the first `refusals` cannot be worn."""
    tried = []

    def worn(*_: Any, **__: Any) -> Any:
        tried.append(1)
        if len(tried) <= refusals:
            raise NotConvergedError("worn-start", "No equilibrium.", remedy="Another start.")
        return SimpleNamespace(cpu_seconds=0.0)

    def end(_: Any, begin: str) -> None:
        raise Reached(begin)

    monkeypatch.setattr(on_skin, "design_worn", worn)
    monkeypatch.setattr(on_skin, "worn_settings", end)
    problem, _ = drawn_problem(1)
    skin = cast(Any, SimpleNamespace())
    with pytest.raises((Reached, NotConvergedError)) as found:
        on_skin.design_on_skin("worn", problem, surrogates(), skin, start=start)
    if found.type is Reached:
        assert str(found.value) == (start or on_skin.STARTS[len(tried) - 1])
    else:
        assert len(tried) == refusals
    return len(tried)


def test_the_next_method_is_taken_where_one_cannot_be_worn(monkeypatch: Any) -> None:
    assert [started(monkeypatch, refusals) for refusals in (0, 1, 2)] == [1, 2, 3]


def test_the_last_refusal_and_that_of_a_chosen_start_are_told(monkeypatch: Any) -> None:
    assert started(monkeypatch, 3) == 3
    assert started(monkeypatch, 1, start="exact") == 1
