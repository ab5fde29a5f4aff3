"""From a subject folder to a page, on the synthetic subjects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from report_cases import STORED, conformability_case, copy_of_s1, strain_case
from tolerances import LINEAR_ALGEBRA

from kiribench.dataset import Dataset
from kiribench.errors import TableError
from kiribench.report.gather import gather, is_synthetic, relative
from kiribench.report.truth import Truth, agreements, grades_agreeing, read_truth, true_satisfactory
from kiribench.schema.sidecars import DatasetDescription


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ({}, False),
        ({"Synthetic": True}, True),
        ({"Synthetic": "true"}, False),
        ({"GeneratedBy": [{"Name": "kiribench synth"}]}, True),
        ({"GeneratedBy": [{"Name": "scanner"}]}, False),
        ({"GeneratedBy": "kiribench synth"}, False),
        ({"GeneratedBy": [None, {"Name": ["kiribench synth"]}]}, False),
    ],
)
def test_only_the_description_makes_data_synthetic(extra: dict, expected: bool) -> None:
    description = DatasetDescription.model_validate({"Name": "a synthetic name", **extra})
    assert is_synthetic(description) is expected


def test_paths_are_relative_to_the_dataset() -> None:
    root = Path("/data/set")
    assert relative("/data/set/sub-S1/surf/a.obj", root) == "sub-S1/surf/a.obj"
    assert relative("/elsewhere/private/a.obj", root) == "a.obj"


def test_a_subject_is_gathered_with_hashes_side_and_truth() -> None:
    dataset = Dataset.open(STORED)
    subject = dataset.subject("S2")
    page = gather(
        dataset, subject, conformability=None, strain=None, surface=None, settings={"seed": 0}
    )
    assert page.synthetic
    assert page.mirrored == (subject.side == "left")
    names = list(page.provenance["inputs"])
    assert "dataset_description.json" in names
    assert sum(name.startswith("sub-S2/surf/") for name in names) >= 9
    assert not any(name.startswith("/") for name in names)
    assert page.truth is not None


def test_real_data_has_no_truth(tmp_path: Path) -> None:
    root = copy_of_s1(tmp_path / "data")
    description = json.loads((root / "dataset_description.json").read_text(encoding="utf-8"))
    del description["GeneratedBy"]
    (root / "dataset_description.json").write_text(json.dumps(description), encoding="utf-8")
    dataset = Dataset.open(root)
    page = gather(
        dataset, dataset.subject("S1"), conformability=None, strain=None, surface=None, settings={}
    )
    assert not page.synthetic
    assert page.truth is None


def test_truth_is_read_cell_by_cell() -> None:
    truth = read_truth(Dataset.open(STORED), "S1")
    assert truth is not None
    assert truth.overlap is not None
    assert truth.strain is not None
    assert truth.overlap["paper"].shape == (12, 6)
    assert truth.strain["shear"].shape == (16, 12)
    table = STORED / "derivatives" / "truth" / "sub-S1" / "sub-S1_overlap.tsv"
    row = table.read_text(encoding="utf-8").splitlines()[1 + 6 * 4 + 2].split("\t")
    assert row[:2] == ["4", "2"]
    assert truth.overlap["paper"][4, 2] == float(row[6])
    counts = json.loads(table.with_suffix(".json").read_text(encoding="utf-8"))["Counts"]
    assert true_satisfactory(truth, "paper") == pytest.approx(counts["Satisfactory"], abs=1e-6)


def test_a_broken_truth_table_is_an_error_with_its_name(tmp_path: Path) -> None:
    root = copy_of_s1(tmp_path / "data")
    path = root / "derivatives" / "truth" / "sub-S1" / "sub-S1_overlap.tsv"
    path.write_text("row\tcol\n0\t0\n", encoding="utf-8")
    with pytest.raises(TableError, match="overlap_paper"):
        read_truth(Dataset.open(root), "S1")
    path.unlink()
    truth = read_truth(Dataset.open(root), "S1")
    assert truth is not None
    assert truth.overlap is None


def test_agreement_is_measured_minus_truth_over_scored_cells() -> None:
    score, strain = conformability_case(), strain_case()
    overlap = {
        "paper": score.overlap_paper + 0.01,
        "strict": score.overlap_strict.copy(),
        "iou": score.overlap_iou.copy(),
    }
    overlap["strict"][3, 3] += 0.05
    stretch = {
        "longitudinal_stretch": strain.longitudinal_stretch.value - 0.002,
        "lateral_stretch": strain.lateral_stretch.value,
        "shear": strain.shear.value,
    }
    found = {a.quantity: a for a in agreements(Truth(overlap, stretch), score, strain)}
    assert found["overlap, paper"].cells == 71
    assert found["overlap, paper"].largest == pytest.approx(0.01, abs=LINEAR_ALGEBRA)
    assert found["overlap, paper"].rms == pytest.approx(0.01, abs=LINEAR_ALGEBRA)
    assert found["overlap, strict"].largest == pytest.approx(0.05, abs=LINEAR_ALGEBRA)
    assert found["overlap, strict"].rms == pytest.approx(0.05 / np.sqrt(71), abs=LINEAR_ALGEBRA)
    assert found["longitudinal stretch"].cells == 190
    assert found["longitudinal stretch"].largest == pytest.approx(0.002, abs=LINEAR_ALGEBRA)


def test_per_cell_alignment_is_not_compared_with_a_global_truth() -> None:
    from dataclasses import replace

    score = conformability_case()
    truth = Truth(dict.fromkeys(("paper", "strict", "iou"), score.overlap), None)
    assert grades_agreeing(truth, score) == (71, 71)
    centred = replace(score, alignment="per-cell")
    assert agreements(truth, centred, None) == ()
    assert grades_agreeing(truth, centred) is None
    other = Truth({name: np.ones((2, 2)) for name in ("paper", "strict", "iou")}, None)
    assert agreements(other, score, None) == ()
    assert grades_agreeing(other, score) is None
