"""``kiribench conform``: how well the worn patch covers the skin, cell by cell, and why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, DatasetError, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.conformability.result import Conformability
    from kiribench.dataset import Subject

SCHEMA = "kiribench.conform/1"


def conform(
    dataset: Path,
    /,
    *,
    participant: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    grade_by: Literal["paper", "strict", "iou"] = "paper",
    alignment: Literal["global", "per-cell"] = "global",
    registration: Literal["auto", "none"] = "auto",
    denoise: Literal["auto", "always", "never"] = "auto",
    samples: int = 1000,
    seed: int = 0,
    fail_under: float | None = None,
    common: Common | None = None,
) -> Outcome:
    """Score the worn patch of each participant: overlap, grade and cause of every cell.

    Needs the bare scan at 90 degrees (flex090) and the worn scan (flex090worn) with their
    nodes; participants without a worn scan are skipped and listed. With --out, writes a
    table and its description for each participant (sub-ID/sub-ID_conform.tsv and .json) and
    an HTML report (sub-ID.html, index.html) beside conform.json.

    Parameters
    ----------
    dataset
        Folder of the subject folders.
    participant
        Id of a participant, with or without sub-; may be given several times. All if absent.
    grade_by
        Overlap that is graded: of the skin cell (paper), of the larger cell (strict), or
        intersection over union (iou). All three are always given.
    alignment
        global leaves the patch where it was worn; per-cell first moves each patch cell onto
        its skin cell's centre.
    registration
        auto registers the worn scan to the bare one by the skin outside the patch where
        needed; none takes both scans as they are.
    denoise
        Denoise the bare scan: where the estimated noise would lengthen geodesics noticeably,
        always, or never.
    samples
        Draws of the Monte Carlo for intervals and probabilities.
    seed
        Seed of the draws.
    fail_under
        Exit with code 1 if the satisfactory ratio of any participant is below this fraction
        (0.75 means 75 %).
    common
        Options of every command.
    """
    from kiribench.cli.participants import chosen, each
    from kiribench.cli.report_files import score_settings, write_reports
    from kiribench.conformability.export import (
        conform_object,
        conform_rows,
        conform_sidecar,
        conform_text,
    )
    from kiribench.conformability.score import ScoreOptions, input_warnings, score_subject
    from kiribench.dataset import Dataset
    from kiribench.schema.result_tables import write_table

    common = common or Common()
    _check_fail_under(fail_under)
    options = ScoreOptions(grade_by, alignment, registration, denoise, samples, seed)
    options.check()
    opened = Dataset.open(dataset)
    asked = chosen(opened, participant)
    subjects, skipped = _worn(asked)
    results = each(
        subjects, lambda subject: score_subject(subject, options), "scoring", quiet=common.quiet
    )
    if common.out is not None:
        for result in results:
            stem = f"sub-{result.participant}"
            write_table(
                common.out / stem / f"{stem}_conform.tsv",
                conform_rows(result),
                conform_sidecar(result),
            )
        write_reports(
            common.out,
            opened,
            subjects,
            results,
            settings=score_settings(options),
            denoise=denoise,
            quiet=common.quiet,
        )
    failed = _gate(results, fail_under)
    text = [conform_text(result) for result in results]
    text += [f"Participant {entry['id']}: skipped, {entry['reason']}" for entry in skipped]
    text += [fault.what for fault in failed]
    return Outcome(
        result={
            "schema": SCHEMA,
            "dataset": opened.description.name,
            "grade_by": grade_by,
            "alignment": alignment,
            "fail_under": fail_under,
            "passed": not failed,
            "participants": [conform_object(result) for result in results],
            "skipped": skipped,
        },
        text="\n\n".join(text),
        exit_code=EXIT_GATE_FAILED if failed else EXIT_OK,
        faults=(*(fault for result in results for fault in input_warnings(result)), *failed),
        inputs=(*opened.files, *(path for subject in subjects for path in subject.files)),
    )


def _check_fail_under(fail_under: float | None) -> None:
    if fail_under is not None and not 0.0 <= fail_under <= 1.0:
        raise UsageError(
            "fail-under-range",
            "--fail-under is no fraction.",
            remedy="Give a fraction: 0.75 for 75 %.",
            got=fail_under,
            expected="0 to 1",
        )


def _worn(asked: list[Subject]) -> tuple[list[Subject], list[dict[str, Any]]]:
    """Subjects with a worn scan, and the others with the reason."""
    subjects = [subject for subject in asked if "flex090worn" in subject.acquisitions]
    skipped = [
        {"id": subject.id, "reason": "there is no worn scan (acquisition flex090worn)."}
        for subject in asked
        if "flex090worn" not in subject.acquisitions
    ]
    if not subjects:
        raise DatasetError(
            "conform-no-worn-scan",
            "No participant asked for has a worn scan.",
            remedy="Add sub-ID_acq-flex090worn_scan.obj with its .json and its nodes table; "
            "for bare scans alone use 'kiribench measure'.",
            got=", ".join(entry["id"] for entry in skipped) or "no participants",
        )
    return subjects, skipped


def _gate(results: list[Conformability], fail_under: float | None) -> list[Fault]:
    if fail_under is None:
        return []
    return [
        Fault(
            "conform-below-limit",
            f"Participant {result.participant}: the satisfactory ratio is below the limit.",
            "Look at the causes of the poor cells.",
            got="no cell scored"
            if result.whole.satisfactory is None
            else f"{result.whole.satisfactory:.4f}",
            expected=f"{fail_under:g} or more",
        )
        for result in results
        if result.whole.satisfactory is None or result.whole.satisfactory < fail_under - 1e-12
    ]
