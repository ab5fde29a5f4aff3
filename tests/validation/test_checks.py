"""Each numbered check where it fires and where it does not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kiribench.schema.design_space import DesignSpace
from kiribench.validation.checks import CHECKS, run_checks
from kiribench.validation.checks.check import Evidence, Wanted
from kiribench.validation.checks.kb007_extrapolation import reach
from kiribench.validation.checks.kb008_mixed_measures import uncut_poisson
from kiribench.validation.fold import folds_of_labels
from kiribench.validation.outcome import FoldOutcome
from kiribench.validation.protocols import plan
from kiribench.validation.settings import CvSettings
from kiribench.validation.summary import summarise
from kiribench.validation.table import CvTable, of_design_space

CHECK = {check.code: check for check in CHECKS}
DOCS = Path(__file__).parents[2] / "docs" / "checks"
BIG = 8  # 64 designs: enough


def found(code: str, evidence: Evidence) -> tuple[str, str]:
    result = next(one for one in run_checks(evidence) if one.check.code == code)
    return result.found.status, result.severity if result.found.status == "fired" else ""


def folds_evidence(table: CvTable, *names: str) -> Evidence:
    return Evidence(table, plan(table, CvSettings(folds=4, protocols=names)).folds)


def scored(table: CvTable, error: float, sd: float | None, *, train_r2: float = 1.0) -> Evidence:
    """Evidence of a made-up model with normal errors under grouped folds."""
    folds = plan(table, CvSettings(folds=4, repeats=1, protocols=("grouped",))).folds["grouped"]
    rng = np.random.default_rng(1)
    outcomes = [
        FoldOutcome(
            "grouped",
            "made-up",
            fold.name,
            mean=table.y[fold.test] + error * rng.standard_normal(len(fold.test)),
            sd=None if sd is None else np.full(len(fold.test), sd),
            fit_s=0.1,
            predict_s=0.1,
            train_r2=train_r2,
        )
        for fold in folds
    ]
    one = summarise(table, folds, outcomes)
    return Evidence(table, {"grouped": folds}, {"grouped": {"made-up": one}})


def test_kb001_split_groups(table: CvTable) -> None:
    assert found("KB001", folds_evidence(table, "grouped", "edge")) == ("passed", "")
    assert found("KB001", folds_evidence(table, "grouped", "shuffled")) == ("fired", "note")
    own = replace(table, own_fold=np.arange(len(table.y)) % 3, fold_names=("x", "y", "z"))
    assert found("KB001", folds_evidence(own, "own-folds")) == ("fired", "error")
    rows = replace(table, group_word="row")
    assert found("KB001", Evidence(rows))[0] == "not applicable"


def test_kb002_unshuffled(table: CvTable) -> None:
    assert found("KB002", folds_evidence(table, "contiguous")) == ("fired", "note")
    own = replace(table, own_fold=np.arange(len(table.y)) // 100, fold_names=tuple("wxyz"))
    assert found("KB002", folds_evidence(own, "own-folds")) == ("fired", "error")
    order = np.random.default_rng(0).permutation(len(table.y))
    mixed = replace(table, X=table.X[order], y=table.y[order], group=table.group[order])
    assert found("KB002", folds_evidence(mixed, "contiguous")) == ("passed", "")
    assert found("KB002", folds_evidence(table, "grouped"))[0] == "not applicable"


def test_kb003_target_leakage(table: CvTable) -> None:
    assert found("KB003", Evidence(table)) == ("passed", "")
    lateral = -table.y * table.X[:, 2]
    ratio = replace(table, X=np.column_stack([table.X, lateral]), features=(*table.features, "l"))
    assert found("KB003", Evidence(ratio)) == ("fired", "error")
    same = replace(table, X=np.column_stack([table.X, table.y**3]), features=(*"abc", "d"))
    assert found("KB003", Evidence(same)) == ("fired", "error")
    noisy = np.column_stack([table.X, table.y + 0.1 * np.sin(999 * table.X[:, 2])])
    assert found("KB003", Evidence(replace(table, X=noisy, features=tuple("abcd"))))[0] == "passed"


def test_kb004_few_designs(table: CvTable) -> None:
    assert found("KB004", folds_evidence(table, "grouped")) == ("fired", "warning")  # 36 designs
    from validation.conftest import table_of

    assert found("KB004", folds_evidence(table_of(BIG, 3), "grouped")) == ("passed", "")


def test_kb005_under_fitted(table: CvTable) -> None:
    good = scored(table, 0.001, None)
    assert found("KB005", good) == ("passed", "")
    poor = scored(table, 0.3, None, train_r2=0.6).summaries["grouped"]["made-up"]
    both = replace(good, summaries={"grouped": good.summaries["grouped"] | {"poor": poor}})
    assert found("KB005", both) == ("fired", "warning")
    assert found("KB005", Evidence(table))[0] == "not applicable"


def test_kb006_calibration(table: CvTable) -> None:
    assert found("KB006", scored(table, 0.01, 0.01)) == ("passed", "")
    assert found("KB006", scored(table, 0.01, 0.005)) == ("fired", "warning")  # too sure
    assert found("KB006", scored(table, 0.01, 0.03)) == ("fired", "warning")  # too cautious
    assert found("KB006", scored(table, 0.01, None))[0] == "not applicable"


def test_kb007_extrapolation(table: CvTable) -> None:
    def wanted(strain: float, poisson: float) -> Evidence:
        return Evidence(table, wanted=Wanted(np.array([strain]), np.array([poisson]), "log", "w"))

    assert found("KB007", wanted(0.3, 0.3)) == ("passed", "")
    assert found("KB007", wanted(0.9, 0.3)) == ("fired", "warning")
    assert found("KB007", wanted(0.3, 0.7)) == ("fired", "warning")
    assert found("KB007", Evidence(table))[0] == "not applicable"


def test_reach_interpolates_and_never_extrapolates() -> None:
    group, strain = np.array([0, 0, 1, 1]), np.array([0.0, 1.0, 0.5, 1.0])
    low, high = reach(group, strain, np.array([0.0, 1.0, 0.1, 0.2]), np.array([0.25, 0.75, 2.0]))
    assert low[:2] == pytest.approx([0.25, 0.15]) and high[:2] == pytest.approx([0.25, 0.75])
    assert np.isnan(low[2]) and np.isnan(high[2])


@pytest.mark.parametrize("measure", ["log", "engineering", "green"])
def test_uncut_rubber_in_three_measures(measure: str) -> None:
    """From stretches l and l^-1/2, independently of the closed form."""
    from kiribench.schema.design_space import strain_of_stretch

    stretch = np.array([1.1, 1.5, 2.0])
    strain = strain_of_stretch(stretch, measure)
    lateral = strain_of_stretch(stretch**-0.5, measure)
    assert uncut_poisson(strain, measure) == pytest.approx(-lateral / strain, rel=1e-12)


def test_kb008_mixed_measures(table: CvTable) -> None:
    uncut = np.maximum(table.X[:, 0], table.X[:, 1]) <= 5.0

    def behaving_as(measure: str) -> CvTable:
        y = np.where(uncut, uncut_poisson(table.X[:, 2], measure), table.y)
        return replace(table, y=y)

    assert found("KB008", Evidence(behaving_as("log"))) == ("passed", "")
    assert found("KB008", Evidence(behaving_as("engineering"))) == ("fired", "error")
    assert found("KB008", Evidence(behaving_as("green"))) == ("fired", "error")
    declared = replace(behaving_as("engineering"), measure="engineering")
    assert found("KB008", Evidence(declared)) == ("passed", "")
    other = Wanted(np.array([0.3]), np.array([0.3]), "engineering", "w")
    assert found("KB008", Evidence(behaving_as("log"), wanted=other)) == ("fired", "error")
    plain = replace(table, features=tuple("pqr"), measure=None)
    assert found("KB008", Evidence(plain))[0] == "not applicable"


def test_kb009_duplicates(table: CvTable) -> None:
    space = DesignSpace(
        file=Path("t.csv"),
        a_percent=table.X[:, 0],
        b_percent=table.X[:, 1],
        longitudinal_strain=table.X[:, 2],
        poisson_ratio=table.y,
        design=table.group,
        design_names=table.group_names,
        measure="log",
    )
    assert found("KB009", Evidence(of_design_space(space))) == ("passed", "")
    twin = replace(space, a_percent=np.where(table.group == 3, 5.0, space.a_percent))
    twin = replace(twin, b_percent=np.where(table.group == 3, 5.0, space.b_percent))
    merged = of_design_space(twin)
    assert merged.groups == 35  # equal cuts are one group
    assert found("KB009", Evidence(merged)) == ("fired", "warning")


def test_kb010_below_mesh_error(table: CvTable) -> None:
    assert found("KB010", scored(table, 0.001, None)) == ("fired", "note")  # mesh error 0.01
    assert found("KB010", scored(table, 0.05, None)) == ("passed", "")
    assert found("KB010", Evidence(replace(table, mesh_error=None)))[0] == "not applicable"


def test_every_check_has_its_page_and_its_number() -> None:
    assert [check.code for check in CHECKS] == [f"KB{k:03d}" for k in range(1, len(CHECKS) + 1)]
    pages = {path.stem: path.read_text(encoding="utf-8") for path in DOCS.glob("KB*.md")}
    assert set(pages) == {check.code for check in CHECKS}
    for check in CHECKS:
        page = " ".join(pages[check.code].split())
        assert page.startswith(f"# {check.code}: {check.title} ")
        assert f"Severity: {check.severity}" in page
        assert check.remedy in page
        assert re.search(r"## When it fires .+ ## Why it matters .+ ## What to do ", page)


def test_folds_of_labels_skip_empty_labels() -> None:
    folds = folds_of_labels(np.array([0, 0, 2, 2]))
    assert [list(fold.test) for fold in folds] == [[0, 1], [2, 3]]
