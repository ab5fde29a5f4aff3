"""All checks of a reference dataset."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.conformability.export import conform_rows, conform_sidecar
from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, Conformability
from kiribench.conformability.score import score_subject
from kiribench.dataset import Dataset, Subject
from kiribench.regression.check import Check
from kiribench.regression.tables import column_of, compare_record, compare_truth, read_rows
from kiribench.regression.variants import VARIANTS, Variant, write_variant
from kiribench.schema.result_tables import write_table
from kiribench.strain.export import strain_rows, strain_sidecar
from kiribench.strain.measure import measure_subject
from kiribench.strain.result import StrainField

#: Overlaps must be within what the project promises. Stretches: 0.05 mm in a 15 mm edge, what
#: chords that stand up to 0.1 mm off the smooth patella make. Poisson's ratio divides by the
#: strain: it is compared where the skin stretches by a tenth or more, with half of .003 / .1.
#: The errors fall with the square of the triangles.
OVERLAP_BOUND = 0.002
STRETCH_BOUND = 0.003
POISSON_BOUND = 0.015
POISSON_FROM_STRETCH = 1.1
#: The truth's shear is that at the cell's centre, ours the mean over 15 mm: rms only.
SHEAR_RMS_BOUND = 0.02

TRUTH = Path("derivatives") / "truth"
RECORDS = Path("derivatives") / "kiribench"


@dataclass(frozen=True, eq=False)
class Fresh:
    """What is computed today for one subject."""

    subject: Subject
    strain: StrainField
    score: Conformability
    seconds: float

    @property
    def stem(self) -> str:
        """``sub-ID``."""
        return f"sub-{self.subject.id}"


def compute(subject: Subject) -> Fresh:
    """Measure and score one subject with the defaults."""
    start = time.perf_counter()
    strain, score = measure_subject(subject), score_subject(subject)
    return Fresh(subject, strain, score, time.perf_counter() - start)


def run_suite(
    dataset: Dataset, advance: Callable[[int, int], None], *, update: bool = False
) -> list[Check]:
    """Run every check.

    Args:
        dataset: with ``derivatives/truth`` and ``derivatives/kiribench``.
        advance: called with (done, total).
        update: write the recorded tables anew first.
    """
    checks: list[Check] = []
    names = dataset.participants
    total = len(names) + len(VARIANTS)
    first: Fresh | None = None
    for done, name in enumerate(names):
        advance(done, total)
        fresh = compute(dataset.subject(name))
        first = first or fresh
        checks += truth_checks(dataset.root, fresh)
        if update:
            write_records(dataset.root, fresh)
        checks += record_checks(dataset.root, fresh)
    if first is not None:
        for done, variant in enumerate(VARIANTS):
            advance(len(names) + done, total)
            checks += invariant_checks(dataset, first, variant)
    advance(total, total)
    return checks


def record_path(root: Path, stem: str, kind: str) -> Path:
    """The recorded table of a subject; ``kind`` is ``conform`` or ``strain``."""
    return root / RECORDS / stem / f"{stem}_{kind}.tsv"


def write_records(root: Path, fresh: Fresh) -> None:
    """Write today's tables as the records."""
    write_table(
        record_path(root, fresh.stem, "conform"),
        conform_rows(fresh.score),
        conform_sidecar(fresh.score),
    )
    write_table(
        record_path(root, fresh.stem, "strain"),
        strain_rows(fresh.strain),
        strain_sidecar(fresh.strain),
    )


def record_checks(root: Path, fresh: Fresh) -> list[Check]:
    """Today's tables against the recorded ones."""
    name = fresh.subject.id
    return [
        *compare_record(
            f"{name} conform",
            conform_rows(fresh.score),
            record_path(root, fresh.stem, "conform"),
            fresh.seconds / 2,
        ),
        *compare_record(
            f"{name} strain",
            strain_rows(fresh.strain),
            record_path(root, fresh.stem, "strain"),
            fresh.seconds / 2,
        ),
    ]


def truth_checks(root: Path, fresh: Fresh) -> list[Check]:
    """Overlaps, grades and strains against the closed forms."""
    folder = root / TRUTH / fresh.stem
    files = [folder / f"{fresh.stem}_{kind}.tsv" for kind in ("overlap", "strain")]
    name = fresh.subject.id
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        detail = f"There is no {', '.join(missing)} under {TRUTH.as_posix()}."
        return [Check("truth", f"{name} tables", False, None, 0.0, detail)]
    overlap, strain = (read_rows(file) for file in files)
    cells = _by_cell(conform_rows(fresh.score))
    strains = _by_cell(strain_rows(fresh.strain))
    checks = [
        compare_truth(
            f"{name} {column}",
            _column(cells, column),
            column_of(overlap, column),
            OVERLAP_BOUND,
            0.0,
        )
        for column in ("overlap_paper", "overlap_strict", "overlap_iou")
    ]
    checks.append(_grades(name, cells, column_of(overlap, "overlap_paper"), overlap))
    for column, bound in (
        ("longitudinal_stretch", STRETCH_BOUND),
        ("lateral_stretch", STRETCH_BOUND),
    ):
        checks.append(
            compare_truth(
                f"{name} {column}", _column(strains, column), column_of(strain, column), bound, 0.0
            )
        )
    along = column_of(strain, "longitudinal_stretch")
    ratio = {
        at: value
        for at, value in column_of(strain, "poisson_ratio").items()
        if along[at] >= POISSON_FROM_STRETCH
    }
    checks.append(
        compare_truth(
            f"{name} poisson_ratio", _column(strains, "poisson_ratio"), ratio, POISSON_BOUND, 0.0
        )
    )
    checks.append(_shear(name, strains, column_of(strain, "shear")))
    return checks


def _grades(
    name: str,
    cells: dict[tuple[int, int], dict[str, Any]],
    truth: dict[tuple[int, int], float],
    rows: list[dict[str, str]],
) -> Check:
    """Grades may differ only where the truth lies within the bound of a limit."""
    wrong = []
    for row in rows:
        at = int(row["row"]), int(row["col"])
        near = min(abs(truth[at] - limit) for limit in (GOOD_FROM, FAIR_FROM)) <= OVERLAP_BOUND
        if cells[at]["grade"] != row["grade"] and not near:
            wrong.append(f"{at} {row['grade']} became {cells[at]['grade']}")
    return Check("truth", f"{name} grades", not wrong, float(len(wrong)), 0.0, "; ".join(wrong))


def _shear(
    name: str,
    strains: dict[tuple[int, int], dict[str, Any]],
    truth: dict[tuple[int, int], float],
) -> Check:
    apart = [
        strains[at]["shear"] - true
        for at, true in truth.items()
        if strains[at]["shear"] is not None
    ]
    rms = float(np.sqrt(np.mean(np.square(apart)))) if apart else None
    passed = rms is not None and rms <= SHEAR_RMS_BOUND
    return Check(
        "truth", f"{name} shear rms", passed, rms, SHEAR_RMS_BOUND, "cell mean, not centre"
    )


def invariant_checks(dataset: Dataset, fresh: Fresh, variant: Variant) -> list[Check]:
    """Measure and score a copy in which nothing that matters has changed."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = write_variant(fresh.subject, dataset, variant, Path(folder))
        again = compute(copy.subject(fresh.subject.id))
    seconds = time.perf_counter() - start
    return list(_invariants(fresh, again, variant, seconds))


def _invariants(fresh: Fresh, again: Fresh, variant: Variant, seconds: float) -> Iterator[Check]:
    old, new = fresh.strain, again.strain
    for name, before, after, bound in (
        ("overlap", fresh.score.overlap_paper, again.score.overlap_paper, variant.overlap_bound),
        ("iou", fresh.score.overlap_iou, again.score.overlap_iou, variant.overlap_bound),
        (
            "longitudinal_stretch",
            old.longitudinal_stretch.value,
            new.longitudinal_stretch.value,
            variant.strain_bound,
        ),
        (
            "lateral_stretch",
            old.lateral_stretch.value,
            new.lateral_stretch.value,
            variant.strain_bound,
        ),
        ("shear", old.shear.value, new.shear.value, 20.0 * variant.strain_bound),
    ):
        same = np.array_equal(np.isfinite(before), np.isfinite(after))
        worst = float(np.nanmax(np.abs(after - before)))
        yield Check(
            "invariant",
            f"{variant.name} {name}",
            same and worst <= bound,
            worst,
            bound,
            variant.why if same else "other cells are masked",
            seconds / 5,
        )


def _by_cell(rows: list[dict[str, Any]]) -> dict[tuple[int, int], dict[str, Any]]:
    return {(row["row"], row["col"]): row for row in rows}


def _column(
    cells: dict[tuple[int, int], dict[str, Any]], column: str
) -> dict[tuple[int, int], float | None]:
    return {at: row[column] for at, row in cells.items()}
