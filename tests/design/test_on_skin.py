"""Where a design on the skin starts from: the first method whose patch can be worn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from design_toys import drawn_problem, surrogates

from kiribench.design import on_skin
from kiribench.design.result import Designed
from kiribench.design.summary import design_object, design_text
from kiribench.errors import NotConvergedError
from kiribench.lattice import CutMap
from kiribench.report.design_page import design_page


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


def made(
    monkeypatch: pytest.MonkeyPatch, method: str, overlap: Any, status: str = "ok"
) -> Designed:
    """A design on the skin whose corners are off by (3, 4) mm at one node."""
    problem, cuts = drawn_problem(1)
    rows, columns = problem.shape
    target = np.stack(
        np.meshgrid(15.0 * np.arange(columns + 1), 15.0 * np.arange(rows + 1)), axis=-1
    )
    worn = target.copy()
    worn[2, 1] += (3.0, 4.0)
    model = SimpleNamespace(
        target_q_mm=target,
        weight=np.ones(target.shape[:2]),
        worn=lambda *_: SimpleNamespace(corner_q_mm=worn, status=status, cpu_seconds=0.0),
    )
    first = SimpleNamespace(rms_mm=6.25, posed_rms_mm=1.5)
    last = SimpleNamespace(rms_mm=1.0, posed_rms_mm=1.25)
    found = SimpleNamespace(
        cut_map=CutMap(cuts[..., 0], cuts[..., 1], 15.0),
        iterations=(first, last),
        cpu_seconds=0.0,
        at_bounds=3,
    )
    monkeypatch.setattr(on_skin, "KneeModel", lambda skin: model)
    monkeypatch.setattr(on_skin, "design_worn", lambda *_, **__: found)
    monkeypatch.setattr(on_skin, "design_robust", lambda *_, **__: found)
    monkeypatch.setattr(on_skin, "worn_settings", lambda *_: {})
    return on_skin.design_on_skin(
        method, problem, surrogates(), cast(Any, None), overlap=overlap, good_from=0.9
    )


def told_of(monkeypatch: pytest.MonkeyPatch, method: str, overlap: Any) -> tuple[dict, str]:
    """What is said of such a design."""
    result = made(monkeypatch, method, overlap)
    return design_object(result), design_text(result)


def half_covered(corner_q_mm: Any) -> Any:
    """Overlaps of a patch of 5 x 4 cells: half of the cells .95, a quarter .85, one unknown."""
    shape = (corner_q_mm.shape[-3] - 1, corner_q_mm.shape[-2] - 1)
    values = np.where(np.arange(np.prod(shape)) % 2, 0.95, 0.85).reshape(shape)
    values[0, 0] = np.nan
    return values


def test_a_worn_design_says_what_it_aims_at_and_what_not(monkeypatch: Any) -> None:
    told, words = told_of(monkeypatch, "worn", half_covered)
    assert told["aims_at"] == "worn-corners"
    # The cuts are those that the targets were drawn from: within the tolerance in every cell,
    # and yet no target is said to be met.
    assert told["error"]["largest"] < 1e-6 and told["within_tolerance"] is None
    skin = told["on_skin"]
    nodes = 6 * 5
    assert skin["rms_mm"] == pytest.approx(5 / np.sqrt(nodes))
    assert (skin["worst_mm"], skin["start_rms_mm"]) == (pytest.approx(5.0), 6.25)
    assert (skin["cells_good"], skin["cells_scored"], skin["overlap_least"]) == (10, 19, 0.85)
    assert skin["overlap_mean"] == pytest.approx((10 * 0.95 + 9 * 0.85) / 19)
    assert skin["posed_rms_mm"] is None
    verdict = words.splitlines()[-1]
    assert "0.91 mm (rms)" in verdict and "5.00 mm at most" in verdict
    assert "10 of 19 good" in verdict and "surrogate" not in verdict
    assert "Poisson's ratio is no aim" in words and "targets are met" not in words


def test_a_robust_design_says_its_mean_over_the_errors(monkeypatch: Any) -> None:
    told, words = told_of(monkeypatch, "robust", half_covered)
    assert told["aims_at"] == "worn-corners-over-errors"
    skin = told["on_skin"]
    assert (skin["posed_start_rms_mm"], skin["posed_rms_mm"]) == (1.5, 1.25)
    assert "1.25 mm (rms), 1.50 mm where it began" in words


@pytest.mark.parametrize("method", ["worn", "robust"])
def test_a_design_that_the_finer_mesh_does_not_confirm_says_so(
    monkeypatch: Any, method: str
) -> None:
    result = made(monkeypatch, method, half_covered, status="not-converged")
    note = "No equilibrium was found on the mesh of 16: not confirmed."
    assert design_object(result)["on_skin"]["equilibrium"] is False
    assert result.design.settings["MethodSettings"]["Confirmed"]["Status"] == "not-converged"
    words = design_text(result)
    assert note in words
    assert words.splitlines()[-1].strip().startswith("Verdict: not confirmed")
    page = design_page(result, surrogates())
    assert note in page
    head = page[page.index("<header") : page.index("</header>")]
    assert "Not confirmed, the finer mesh has no equilibrium" in head
    # And one that is confirmed says neither.
    fine = design_text(made(monkeypatch, method, half_covered))
    assert "confirmed" not in fine
