"""``kiribench demo``: from scans to HTML, with the truth beside the result."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from report_cases import STORED, copy_of_s1
from tolerances import PRINTED_OVERLAP

import kiribench.cli.demo as module
from kiribench.cli.command import Common
from kiribench.cli.demo import demo, find_synthetic

Run = tuple[Path, subprocess.CompletedProcess[str]]


def demonstrate(out: Path, *options: str) -> Run:
    done = subprocess.run(
        [sys.executable, "-m", "kiribench", "demo", "--out", str(out), *options],
        capture_output=True, text=True, timeout=580, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return out, done


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return demonstrate(tmp_path_factory.mktemp("demo") / "reports", "--no-designs")


def test_it_ends_with_the_path_of_the_index(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, done = run
    last = done.stdout.strip().splitlines()[-1]
    assert last == f"Report: {out / 'index.html'}"
    assert (out / "index.html").is_file()


def test_table_and_verdict_say_the_same_as_the_json(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, done = run
    result = json.loads((out / "demo.json").read_text(encoding="utf-8"))
    assert result["schema"] == "kiribench.demo/1"
    assert [entry["id"] for entry in result["participants"]] == ["S1", "S2", "S3"]
    for entry in result["participants"]:
        share = f"{100 * entry['satisfactory']:.1f} %"
        assert re.search(rf"^{entry['id']} +{share}", done.stdout, re.MULTILINE)
        assert (
            f"On synthetic subject {entry['id']}, {entry['good'] + entry['fair']} of "
            f"{entry['scored']} cells ({share};" in done.stdout
        )
    assert "Nobody was scanned" in done.stdout


@pytest.mark.slow  # two CPU minutes
def test_the_designs_of_the_first_subject_are_checked_and_exported(tmp_path: Path) -> None:
    out, done = demonstrate(tmp_path / "reports")
    result = json.loads((out / "demo.json").read_text(encoding="utf-8"))
    designs = {entry["method"]: entry for entry in result["designs"]}
    assert set(designs) == {"worn", "balanced", "exact", "paper", "best uniform"}
    worn, control = designs["worn"]["share"]["paper"], designs["best uniform"]["share"]["paper"]
    assert worn["mean"] > control["mean"]
    assert worn["fair"] == 1.0
    assert f"Designs for S1: {result['designs_verdict']}" in done.stdout
    page = (out / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="(sub-S1/[^"]+)"', page)
    assert len(links) == 4
    assert all((out / link).is_file() for link in links)
    assert "agree with the design" in page
    sheet = (out / "sub-S1" / "laser" / "sub-S1_job-sheet.html").read_text(encoding="utf-8")
    assert "Placement tolerance, predicted by kiribench check" in sheet


def column(path: Path, name: str) -> dict[tuple[str, str], float]:
    head, *rows = (line.split("\t") for line in path.read_text(encoding="utf-8").splitlines())
    at = {key: head.index(key) for key in ("row", "col", name)}
    return {(row[at["row"]], row[at["col"]]): float(row[at[name]]) for row in rows}


def test_the_truth_beside_the_result_is_that_of_the_tables(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, _ = run
    result = json.loads((out / "demo.json").read_text(encoding="utf-8"))
    for entry in result["participants"]:
        name = f"sub-{entry['id']}"
        measured = column(out / name / f"{name}_conform.tsv", "overlap_paper")
        truth = column(
            STORED / "derivatives" / "truth" / name / f"{name}_overlap.tsv", "overlap_paper"
        )
        assert measured.keys() == truth.keys()
        largest = max(abs(measured[cell] - truth[cell]) for cell in truth)
        assert entry["largest_overlap_error"] == pytest.approx(largest, abs=PRINTED_OVERLAP)
        fair = sum(overlap >= 0.75 for overlap in truth.values()) / len(truth)
        assert entry["true_satisfactory"] == pytest.approx(fair, abs=1e-12)
        assert entry["satisfactory_low"] <= fair <= entry["satisfactory_high"]


def test_every_subject_has_a_page_and_its_tables(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, _ = run
    for name in ("S1", "S2", "S3"):
        page = out / f"sub-{name}.html"
        assert page.stat().st_size <= 3_000_000
        words = page.read_text(encoding="utf-8")
        assert "Against the known truth" in words
        assert str(STORED) not in words
        for kind in ("strain", "conform"):
            table = out / f"sub-{name}" / f"sub-{name}_{kind}.tsv"
            rows = table.read_text(encoding="utf-8").splitlines()
            assert len(rows) == 1 + (192 if kind == "strain" else 72)


def test_without_a_checkout_the_subjects_are_generated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import kiribench
    import kiribench.synthetic

    installed = tmp_path / "site-packages" / "kiribench" / "__init__.py"
    monkeypatch.setattr(kiribench, "__file__", str(installed))
    only = {"S1": kiribench.synthetic.STORED["S1"]}
    monkeypatch.setattr(kiribench.synthetic, "STORED", only)
    made = find_synthetic(tmp_path / "out", quiet=True)
    assert made == tmp_path / "out" / "dataset"
    tables = sorted(STORED.rglob("sub-S1*_nodes.tsv"))
    assert len(tables) == 3
    for path in tables:
        assert (made / path.relative_to(STORED)).read_bytes() == path.read_bytes()
    assert find_synthetic(tmp_path / "out", quiet=True) == made  # not made twice


def test_a_moved_dataset_gives_the_same_pages(tmp_path: Path) -> None:
    def one(name: str) -> bytes:
        root = copy_of_s1(tmp_path / name / "data")
        demo(dataset=root, designs=False, common=Common(out=tmp_path / name / "out", quiet=True))
        return (tmp_path / name / "out" / "sub-S1.html").read_bytes()

    assert one("here") == one("there")


def test_the_default_folder_is_the_one_of_the_makefile() -> None:
    makefile = (STORED.parents[1] / "Makefile").read_text(encoding="utf-8")
    assert f"demo --out {module.DEFAULT_OUT}" in makefile
