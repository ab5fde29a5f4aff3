"""Comparing a pull: known offsets are named, scatter is noise, look-alikes are not told apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stand_in_pull import BLOCK, MESH, OPTIONS, TRAVEL_MM, Truth, design, pull, without_cell
from tolerances import DIAGNOSED_CUT_PERCENT, DISTANCE_COVERAGE

from kiribench.errors import TableError
from kiribench.fem.material import Ogden
from kiribench.reference.tensile import TensileComparison, compare_tensile
from kiribench.reference.tensile_causes import (
    BEYOND_NOISE,
    IMPLAUSIBLE,
    Cause,
    Observed,
    diagnose,
)
from kiribench.reference.tensile_noise import distance_of, scatter_of
from kiribench.reference.tensile_simulation import Specimen
from kiribench.reference.tensile_specimen import stated_specimen

PLAN = design()


def compared(truth: Truth, **how: object) -> TensileComparison:
    return compare_tensile(PLAN, pull(PLAN, truth, cell_sd=0.01, **how), options=OPTIONS)  # type: ignore[arg-type]


def amounts(found: TensileComparison) -> dict[str, float]:
    assert found.diagnosis is not None
    return {one.name: one.value for one in found.diagnosis.best.amounts}


def test_scatter_is_called_noise() -> None:
    found = compared(Truth())
    assert found.diagnosis is not None
    assert found.diagnosis.kind == "noise"
    assert found.verdict.startswith("Noise")
    assert found.distance.low == 0.0
    assert (np.abs(found.difference) < 1.5 * found.half_width).all()


def test_a_cut_length_wrong_by_two_percent_is_named() -> None:
    found = compared(Truth(longer_a=0.02))
    assert found.diagnosis is not None
    assert found.diagnosis.kind == "one"
    assert found.diagnosis.best.families == ("cut length",)
    assert amounts(found)["cut-a"] == pytest.approx(2.0, abs=DIAGNOSED_CUT_PERCENT)
    assert amounts(found)["cut-b"] == pytest.approx(0.0, abs=DIAGNOSED_CUT_PERCENT)
    assert found.distance_explained is not None
    assert found.distance_explained.value < 0.3 * found.distance.rms
    assert "Cut length explains it" in found.text.splitlines()[-1]


def test_another_law_is_named_with_its_modulus_and_exponent() -> None:
    """The paper's neo-Hookean law simulated, an Ogden rubber pulled: far from linear."""
    law = Ogden(0.112, 3.29)
    found = compared(Truth(specimen=Specimen(mesh=MESH, material=law)))
    assert found.diagnosis is not None
    assert (found.diagnosis.kind, found.diagnosis.best.name) == ("one", "material")
    assert amounts(found)["stiffness"] == pytest.approx(100 * (0.112 / 0.207 - 1), abs=1.0)
    assert amounts(found)["exponent"] == pytest.approx(1.29, abs=0.1)
    assert found.distance_force is not None
    assert found.distance_force > 0.2


@pytest.mark.parametrize(
    ("truth", "name", "value", "within"),
    [(Truth(slip=0.06), "slip", 6.0, 0.5), (Truth(slack_mm=1.0), "slack", 1.0, 0.15)],
    ids=["slip", "slack"],
)
def test_grips_are_named(truth: Truth, name: str, value: float, within: float) -> None:
    found = compared(truth)
    assert found.diagnosis is not None
    assert (found.diagnosis.kind, found.diagnosis.best.name) == ("one", "boundary")
    assert amounts(found)[name] == pytest.approx(value, abs=within)


def test_ends_and_cuts_look_alike_without_loads_and_not_with_them() -> None:
    truth = Truth(specimen=Specimen(mesh=MESH, ends="sliding"))
    blind, seeing = compared(truth, loads=False), compared(truth)
    assert blind.diagnosis is not None
    assert seeing.diagnosis is not None
    assert blind.diagnosis.kind == "cannot-tell"
    assert {one.name for one in blind.diagnosis.tied} == {"boundary", "cut length"}
    assert "Cannot tell" in blind.verdict
    assert (seeing.diagnosis.kind, seeing.diagnosis.best.name) == ("one", "boundary")
    assert amounts(seeing)["ends"] == pytest.approx(1.0, abs=0.4)


def test_the_result_is_plain_json_and_lost_cells_do_no_harm() -> None:
    import json

    test = without_cell(pull(PLAN, Truth()), 5, 3)
    options = replace(OPTIONS, explain=False, strain_measure="green")
    found = compare_tensile(PLAN, test, options=options)
    result = json.loads(json.dumps(found.result, allow_nan=False))
    assert result["strain_measure"] == "green"
    assert result["diagnosis"] is None
    assert len(result["curve"]["poisson_ratio"]) == len(TRAVEL_MM) - 1
    # Another measure, the same sheet: the curves still agree.
    assert found.distance.rms < 0.006


def test_a_block_that_is_not_in_the_design() -> None:
    test = pull(PLAN, Truth())
    for specimen in (Specimen(mesh=MESH, row=6), Specimen(mesh=MESH, column=3)):
        with pytest.raises(TableError) as caught:
            compare_tensile(PLAN, test, options=replace(OPTIONS, specimen=specimen))
        assert caught.value.code == "tensile-block-outside"
    with pytest.raises(TableError) as caught:
        compare_tensile(PLAN, test, options=replace(OPTIONS, min_strain=0.6))
    assert caught.value.code == "tensile-too-few-frames"


# --- the statistics alone, without a simulator -------------------------------------------


def _cells(rng: np.random.Generator, truth: np.ndarray, cells: int = 10) -> np.ndarray:
    m = len(truth)
    lasting = rng.normal(size=(cells, 1)) * np.linspace(0.5, 1.0, m)
    return truth + 2e-3 * lasting + 1e-3 * rng.normal(size=(cells, m))


def test_scatter_of_the_mean_is_that_of_many_repeats() -> None:
    rng = np.random.default_rng(1)
    found = [scatter_of(_cells(rng, np.zeros(12)), (12,), np.nan).of_mean for _ in range(400)]
    shape = np.linspace(0.5, 1.0, 12)
    expected = (4e-6 * np.outer(shape, shape) + 1e-6 * np.eye(12)) / 10
    # 400 variances with nine degrees of freedom: 2.4 % each, three of that.
    assert np.abs(np.mean(found, axis=0) - expected).max() < 0.07 * expected.max()


@pytest.mark.parametrize("size", [0.0, 0.002, 0.01])
def test_the_distances_interval_holds_the_true_distance(size: float) -> None:
    rng = np.random.default_rng(2)
    strain = np.linspace(0.05, 0.5, 12)
    truth = size * np.sin(6 * strain)
    weight = np.gradient(strain)
    true = np.sqrt((weight * truth**2).sum() / weight.sum())
    inside = 0
    for _ in range(200):
        cells = _cells(rng, truth)
        scatter = scatter_of(cells, (12,), np.nan)
        found = distance_of(cells.mean(axis=0), scatter.of_mean, strain, scatter.freedom)
        inside += found.low - 1e-12 <= true <= found.high
    assert inside / 200 >= DISTANCE_COVERAGE


def test_proportional_causes_are_not_told_apart_and_misfit_is_called_none() -> None:
    rng = np.random.default_rng(3)
    wave = np.sin(np.linspace(0, 3, 15))
    causes = (
        Cause("one", "material", "one more by", "", 1.0, 0.05 * wave),
        Cause("two", "boundary", "two more by", "", 1.0, 0.04 * wave),
    )

    def observed(truth: np.ndarray) -> Observed:
        return Observed(_cells(rng, truth), (15,), np.empty(0), 0.003, np.zeros(15), 1e-3)

    both = diagnose(observed(0.03 * wave), causes)
    assert both.kind == "cannot-tell"
    assert both.alike[0][2] == pytest.approx(1.0)
    neither = diagnose(observed(0.03 * np.cos(np.linspace(0, 12, 15))), causes)
    assert neither.kind == "none"
    assert neither.all[0].probability < IMPLAUSIBLE


def test_a_misfit_that_no_cause_lessens_is_not_called_noise() -> None:
    """Few cells: the heavy tails make no cause likelier than noise, and noise is no answer."""
    rng = np.random.default_rng(5)
    causes = (Cause("one", "material", "one more by", "", 1.0, 0.05 * np.ones(15)),)
    truth = 0.02 * np.sin(np.linspace(0, 12, 15))
    cells = _cells(rng, truth, cells=5)
    found = diagnose(Observed(cells, (15,), np.empty(0), 0.003, np.zeros(15), 1e-3), causes)
    assert found.all[1].log_evidence - found.all[0].log_evidence < BEYOND_NOISE
    assert found.kind == "none"


def test_noise_is_rarely_taken_for_a_cause() -> None:
    rng = np.random.default_rng(4)
    shapes = [np.ones(15), np.linspace(-1, 1, 15), np.linspace(0, 1, 15) ** 2]
    causes = tuple(
        Cause(f"c{k}", family, "more by", "", 1.0, 0.02 * shape)
        for k, (family, shape) in enumerate(
            zip(("material", "boundary", "cut length"), shapes, strict=True)
        )
    )
    wrong = 0
    for seed in range(20):
        observed = Observed(
            _cells(rng, np.zeros(15)), (15,), np.empty(0), 0.003, np.zeros(15), 1e-3
        )
        wrong += diagnose(observed, causes, seed=seed).kind != "noise"
    assert wrong <= 1


def test_the_block_is_centred() -> None:
    found = compare_tensile(PLAN, pull(PLAN, Truth()), options=replace(OPTIONS, explain=False))
    assert f"rows 2 to {1 + BLOCK[0]}, columns 1 to {BLOCK[1]}" in found.notes[0]


def test_the_specimen_of_a_sidecar() -> None:
    test = pull(PLAN, Truth())
    stated = {"GripMm": 5, "Ends": "sliding", "MuMpa": 0.112, "Alpha": 3.29, "Row": 1}
    expected = Specimen(grip_mm=5.0, ends="sliding", material=Ogden(0.112, 3.29), row=1)
    assert stated_specimen(PLAN, replace(test, record={"Specimen": stated})) == expected
    assert stated_specimen(replace(PLAN, settings={"Specimen": stated}), test) == expected
    assert stated_specimen(PLAN, test) == Specimen()
    for bad in ({"Grip": 5}, {"GripMm": -1}, {"Ends": "loose"}, {"Row": 1.5}, {"Alpha": "x"}, 7):
        with pytest.raises(TableError) as caught:
            stated_specimen(PLAN, replace(test, record={"Specimen": bad}))
        assert caught.value.code == "tensile-specimen"
