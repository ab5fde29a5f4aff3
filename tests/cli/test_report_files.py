"""The HTML that ``conform --out`` writes."""

from __future__ import annotations

from pathlib import Path

import pytest
from report_cases import copy_of_s1

from kiribench.cli.command import Common
from kiribench.cli.conform import conform


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return copy_of_s1(tmp_path / "data")


def run(dataset: Path, out: Path, **options: object) -> str:
    conform(dataset, samples=100, common=Common(out=out, quiet=True), **options)  # type: ignore[arg-type]
    assert (out / "index.html").is_file()
    return (out / "sub-S1.html").read_text(encoding="utf-8")


def test_the_page_shows_the_options_that_were_used(dataset: Path, tmp_path: Path) -> None:
    page = run(dataset, tmp_path / "out", grade_by="strict", alignment="per-cell", seed=7)
    settings = page[page.index("Settings in force") : page.index("Inputs")]
    for name, value in (("grade-by", "strict"), ("alignment", "per-cell"), ("seed", "7"),
                        ("samples", "100"), ("strain-measure", "log")):  # fmt: skip
        assert f'<th scope="row">{name}</th><td>{value}</td>' in settings
    assert "which flatters" in page
    assert "How the skin deforms" in page


def test_a_bad_straight_scan_costs_the_strain_and_not_the_score(
    dataset: Path, tmp_path: Path
) -> None:
    scan = dataset / "sub-S1" / "surf" / "sub-S1_acq-flex000_scan.obj"
    scan.write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    page = run(dataset, tmp_path / "out")
    assert "Where it fits" in page
    assert "How the skin deforms" not in page
    assert "<code>mesh-" in page


def test_without_out_nothing_is_written(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    conform(dataset, samples=100, common=Common(quiet=True))
    assert sorted(tmp_path.rglob("*")) == before
