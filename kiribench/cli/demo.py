"""``kiribench demo``: the synthetic subjects measured, scored, designed for and reported."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiribench.cli.command import Common, Outcome

if TYPE_CHECKING:
    from kiribench.conformability.result import Conformability
    from kiribench.dataset import Dataset
    from kiribench.report.sections.designs import DesignsSummary
    from kiribench.report.truth import Truth
    from kiribench.strain.result import StrainField

SCHEMA = "kiribench.demo/1"
DEFAULT_OUT = Path("reports/demo")


def demo(
    *, dataset: Path | None = None, designs: bool = True, common: Common | None = None
) -> Outcome:
    """Measure and score the three synthetic subjects, design a patch, write the HTML report.

    Everything is computed from the scans; nothing is stored in advance. The subjects are
    synthetic, so the truth is known and stands beside the result.

    Parameters
    ----------
    dataset
        Subject folders; data/synthetic of a source checkout if absent. Where there is no
        checkout, the same subjects are generated under --out first.
    designs
        Design a patch for the first subject by five methods, predict how each would lie when
        worn, and write the files for the laser; needs the dataset's design space.
    common
        Options of every command; --out is reports/demo unless given.
    """
    from kiribench.cli.demo_designs import design_and_check, find_design_space
    from kiribench.cli.participants import each
    from kiribench.cli.report_files import score_settings, write_reports
    from kiribench.conformability.export import conform_rows, conform_sidecar
    from kiribench.conformability.score import ScoreOptions, input_warnings, score_subject
    from kiribench.dataset import Dataset
    from kiribench.report.sections.designs import designs_section
    from kiribench.report.truth import read_truth
    from kiribench.schema.result_tables import write_table
    from kiribench.strain.export import strain_rows, strain_sidecar
    from kiribench.strain.measure import measure_subject

    common = common or Common()
    out = common.out or DEFAULT_OUT
    opened = Dataset.open(dataset or find_synthetic(out, quiet=common.quiet))
    options = ScoreOptions()
    subjects = list(opened.subjects())
    strains = each(subjects, measure_subject, "measuring", quiet=common.quiet)
    scores = each(
        subjects, lambda subject: score_subject(subject, options), "scoring", quiet=common.quiet
    )
    for strain, score in zip(strains, scores, strict=True):
        stem = f"sub-{score.participant}"
        folder = out / stem
        write_table(folder / f"{stem}_strain.tsv", strain_rows(strain), strain_sidecar(strain))
        write_table(folder / f"{stem}_conform.tsv", conform_rows(score), conform_sidecar(score))
    space = find_design_space(opened.root) if designs else None
    designed = None
    if space is not None:
        designed = design_and_check(opened, subjects[0].id, space, out, quiet=common.quiet)
    index = write_reports(
        out, opened, subjects, scores, settings=score_settings(options), strains=strains,
        more=None if designed is None else designs_section(designed), quiet=common.quiet,
    )  # fmt: skip
    truths = [read_truth(opened, subject.id) for subject in subjects]
    rows = [
        row(score, strain, truth)
        for score, strain, truth in zip(scores, strains, truths, strict=True)
    ]
    return Outcome(
        result={
            "schema": SCHEMA,
            "dataset": opened.description.name,
            "index": str(index),
            "participants": rows,
            "designs": None if designed is None else list(designed.designs),
            "designs_verdict": None if designed is None else designed.verdict,
        },
        text=summary(opened, scores, rows, index, designed),
        faults=tuple(
            dict.fromkeys(
                [fault for strain in strains for fault in strain.warnings]
                + [fault for score in scores for fault in input_warnings(score)]
            )
        ),
        inputs=(
            *opened.files,
            *(path for subject in subjects for path in subject.files),
            *(() if space is None else (space, space.with_suffix(".json"))),
        ),
    )


def find_synthetic(out: Path, *, quiet: bool) -> Path:
    """``data/synthetic`` beside the package, or the same subjects generated under ``out``.

    Args:
        out: where the demonstration writes.
        quiet: no progress bar.
    """
    import kiribench

    stored = Path(kiribench.__file__).resolve().parents[1] / "data" / "synthetic"
    if (stored / "dataset_description.json").is_file():
        return stored
    made = out / "dataset"
    if (made / "dataset_description.json").is_file():
        return made
    from kiribench.cli.progress import progress
    from kiribench.synthetic import STORED, write_dataset

    with progress("making subjects", quiet=quiet) as advance:
        write_dataset(made, list(STORED.values()), progress=advance)
    return made


def row(score: Conformability, strain: StrainField, truth: Truth | None) -> dict[str, Any]:
    """One participant of the result: counts, interval, and the truth where it is known."""
    from kiribench.report.truth import agreements, true_satisfactory

    whole = score.whole
    found = {item.quantity: item for item in agreements(truth, score, strain)} if truth else {}
    overlap = found.get(f"overlap, {score.grade_by}")
    return {
        "id": score.participant,
        "cells": whole.cells,
        "scored": whole.scored,
        "good": whole.good,
        "fair": whole.fair,
        "poor": whole.poor,
        "satisfactory": whole.satisfactory,
        "satisfactory_low": whole.satisfactory_low,
        "satisfactory_high": whole.satisfactory_high,
        "true_satisfactory": true_satisfactory(truth, score.grade_by) if truth else None,
        "largest_overlap_error": overlap.largest if overlap else None,
    }


def summary(
    dataset: Dataset,
    scores: list[Conformability],
    rows: list[dict[str, Any]],
    index: Path,
    designed: DesignsSummary | None,
) -> str:
    """A table, the verdicts in words, and where the report is."""
    from kiribench.report.gather import is_synthetic
    from kiribench.report.verdict import SYNTHETIC_NOTE, causes, verdict, weakest
    from kiribench.report.words import percent, percent_span

    synthetic = is_synthetic(dataset.description)
    head = ("subject", "at least fair", "95 % interval", "truth", "good", "fair", "poor")
    lines = [
        (
            entry["id"],
            percent(entry["satisfactory"]),
            percent_span(entry["satisfactory_low"], entry["satisfactory_high"]),
            percent(entry["true_satisfactory"]),
            *(str(entry[grade]) for grade in ("good", "fair", "poor")),
        )
        for entry in rows
    ]
    widths = [max(len(line[i]) for line in (head, *lines)) for i in range(len(head))]
    table = [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in (head, *lines)
    ]
    words = []
    for score in scores:
        sentences = (verdict(score, synthetic=synthetic), weakest(score), causes(score))
        words.append(" ".join(sentence for sentence in sentences if sentence))
    if designed is not None:
        words.append(f"Designs for {designed.participant}: {designed.verdict}")
    note = [SYNTHETIC_NOTE] if synthetic else []
    return "\n".join([*table, "", *words, "", *note, f"Report: {index}"])
