"""The index of a dataset."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st
from report_cases import subject_case

from kiribench.report.index import index_page, report_name


@given(st.text(max_size=80))
def test_a_page_name_is_harmless(participant: str) -> None:
    name = report_name(participant)
    assert re.fullmatch(r"sub-[A-Za-z0-9-]*\.html", name)
    assert len(name) < 70


@given(st.lists(st.text(max_size=50), unique=True, max_size=20))
def test_different_subjects_have_different_pages(participants: list[str]) -> None:
    assert len({report_name(name) for name in participants}) == len(participants)


def test_every_subject_stands_in_the_index_with_its_numbers() -> None:
    cases = [
        subject_case("S1"),
        subject_case("S2", side="left"),
        subject_case("S3", conformability=None),
    ]
    page = index_page(cases)
    for case in cases:
        assert f'href="{report_name(case.participant)}"' in page
    score = cases[0].conformability
    assert score is not None
    assert score.whole.satisfactory is not None
    assert page.count(f"{100 * score.whole.satisfactory:.1f}\u00a0%") >= 4
    assert "Skin strain only." in page
    assert "Synthetic data" in page
    assert index_page(cases) == page


def test_real_data_is_not_called_synthetic() -> None:
    assert "synthetic" not in index_page([subject_case("S1", synthetic=False)]).lower()
