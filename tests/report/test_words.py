"""Numbers and sentences."""

from __future__ import annotations

import doctest
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_cases import conformability_case, strain_case, subject_case

from kiribench.conformability.grades import grade_of
from kiribench.conformability.result import FrameReport
from kiribench.report.methods import assumptions, facts, methods, references
from kiribench.report.sections.worst import main_cause
from kiribench.report.verdict import causes, verdict, weakest
from kiribench.report.words import overlap_words
from kiribench.schema.layout import Grid, Layout, Patch


@pytest.mark.parametrize("name", ["words", "index"])
def test_the_examples_run(name: str) -> None:
    result = doctest.testmod(import_module(f"kiribench.report.{name}"))
    assert result.attempted > 0
    assert result.failed == 0


@given(st.floats(0.0, 1.0).filter(lambda x: min(abs(x - 0.75), abs(x - 0.9)) > 1e-6))
def test_a_shown_overlap_has_the_grade_of_the_overlap(value: float) -> None:
    shown = np.array([float(overlap_words(value))])
    assert grade_of(shown)[0] == grade_of(np.array([value]))[0]


def test_the_verdict_names_definition_and_alignment() -> None:
    score = conformability_case(missing=())
    assert "have at least 75 % of their skin covered" in verdict(score, synthetic=False)
    assert verdict(score, synthetic=False).startswith("On subject S1, ")
    assert verdict(score, synthetic=True).startswith("On synthetic subject S1, ")
    strict = conformability_case(missing=(), grade_by="strict")
    assert "by the definition 'strict'" in verdict(strict, synthetic=False)
    centred = replace(score, alignment="per-cell")
    assert "each cell centred on its skin cell first" in verdict(centred, synthetic=False)


def test_the_weakest_regions_are_those_with_the_smallest_share() -> None:
    score = conformability_case(missing=())
    known = {r.label: (r.good + r.fair) / r.scored for r in score.regions}
    worst = min(known, key=lambda label: known[label])
    sentence = weakest(score)
    assert sentence is not None
    assert sentence.startswith(f"The weakest fit is in {worst} (")
    fine = tuple(replace(r, satisfactory=1.0) for r in score.regions)
    assert weakest(replace(score, regions=fine)) is None


def test_the_commonest_cause_is_counted_among_cells_that_are_not_good() -> None:
    score = conformability_case(missing=())
    wanting = score.grade != "good"
    mains = score.causes.main[wanting]
    name = max(set(mains), key=lambda cause: int((mains == cause).sum()))
    count = int((mains == name).sum())
    sentence = causes(score)
    assert sentence is not None
    assert f"In {count} of the {int(wanting.sum())} cells" in sentence
    assert sentence.endswith(f"{name.replace('-', ' ')}.")
    assert causes(replace(score, grade=np.full(score.shape, "good"))) is None


@pytest.mark.parametrize(
    ("main", "changes", "words"),
    [
        ("shift", {"shift_mm": [3.0, 0.2]}, "3.0 mm too far distal."),
        ("shift", {"shift_mm": [-3.0, 0.2]}, "3.0 mm too far proximal."),
        ("shift", {"shift_mm": [-0.2, -2.0]}, "2.0 mm too far lateral."),
        ("shift", {"shift_mm": [3.0, 4.0]}, "5.0 mm too far distal-medial."),
        ("lateral-stretch", {"lateral_stretch": 0.8}, "20 % too narrow"),
        ("lateral-stretch", {"lateral_stretch": 1.1}, "10 % too wide"),
        ("longitudinal-stretch", {"longitudinal_stretch": 0.8}, "20 % too short"),
        ("longitudinal-stretch", {"longitudinal_stretch": 1.25}, "25 % too long"),
        ("rotation", {"rotation_deg": 5.0}, "5.0° from distal towards medial"),
        ("rotation", {"rotation_deg": -5.0}, "5.0° from medial towards distal"),
        ("shear", {"shear": -0.2}, "−0.20"),
        ("rest", {}, "trapezoid"),
        ("none", {}, "No single cause"),
    ],
)
def test_the_main_cause_of_a_cell_has_direction_and_size(
    main: str, changes: dict[str, object], words: str
) -> None:
    score = conformability_case(missing=())
    mains = score.causes.main.copy()
    mains[2, 1] = main
    parts = replace(score.causes, main=mains)
    for name, value in changes.items():
        array = getattr(parts, name).copy()
        array[2, 1] = value
        parts = replace(parts, **{name: array})
    assert words in main_cause(replace(score, causes=parts), (2, 1))


def test_the_methods_describe_what_was_done_and_nothing_else() -> None:
    both = " ".join(methods(subject_case()))
    assert "16 x 12 cells of 15 mm" in both
    assert "logarithmic (Hencky)" in both
    assert "12 x 6 patch cells" in both
    assert "2 mm patch" in both
    assert "200 Monte Carlo draws (seed 5)" in both
    assert "global alignment" in both
    assert "Noise was removed" not in both
    alone = " ".join(methods(subject_case(conformability=None)))
    assert "Monte Carlo" not in alone
    assert "patch" not in alone
    scored = " ".join(methods(subject_case(strain=None)))
    assert "Hencky" not in scored
    assert not any("Fieller" in r.words for r in references(subject_case(strain=None)))
    assert any("Fieller" in r.words for r in references(subject_case()))


@pytest.mark.parametrize("measure", ["log", "engineering", "green"])
def test_the_strain_measure_is_named(measure: str) -> None:
    strain = replace(strain_case(), strain_measure=measure, denoised=(True, False))
    words = " ".join(methods(subject_case(strain=strain)))
    named = {"log": "Hencky", "engineering": "engineering strain", "green": "Green-Lagrange"}
    assert [key for key, name in named.items() if name in words] == [measure]
    assert "Noise was removed from flex000 first" in words


@pytest.mark.parametrize("grade_by", ["paper", "strict", "iou"])
@pytest.mark.parametrize("alignment", ["global", "per-cell"])
def test_definition_and_alignment_are_named(grade_by: str, alignment: str) -> None:
    score = replace(conformability_case(grade_by=grade_by), alignment=alignment)
    words = " ".join(methods(subject_case(conformability=score)))
    assert f"'{grade_by}'" in words
    assert ("which flatters" in words) == (alignment == "per-cell")


@pytest.mark.parametrize("method", ["registered", "declared", "kept", "assumed", "none"])
def test_every_way_of_bringing_scans_together_has_its_sentence(method: str) -> None:
    none = method != "registered"
    frame = FrameReport(
        method,  # type: ignore[arg-type]
        1.2, 3.4, None if none else 0.21, None if none else 0.8, 0 if none else 4200,
        0.0 if none else 0.05, 0.0, 0 if none else 1,
    )  # fmt: skip
    score = replace(conformability_case(), frame=frame)
    words = " ".join(methods(subject_case(conformability=score)))
    assert ("0.210 mm rms over 4200 points" in words) == (method == "registered")
    assert ("1 cell at risk" in words) == (method == "registered")
    assert "The worn scan was" in words


def test_assumptions_say_whether_the_offset_was_given() -> None:
    assert any("(2, 3)" in words and "centred" in words for words in assumptions(subject_case()))
    given_ = Layout.of(Grid(), Patch(cell_mm=15.0, row_offset=1, column_offset=2))
    listed = assumptions(subject_case(layout=given_))
    assert any("(1, 2)" in words and "given in the metadata" in words for words in listed)
    assert any("synthetic" in words for words in listed)
    assert not any("synthetic" in words for words in assumptions(subject_case(synthetic=False)))


def test_notes_of_both_results_appear_once() -> None:
    note = conformability_case().notes[0]
    strain = replace(strain_case(), notes=(note, "another"))
    assert facts(subject_case(strain=strain)) == (note, "another")
