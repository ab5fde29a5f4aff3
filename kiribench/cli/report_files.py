"""The HTML reports that commands write beside their tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiribench.errors import DataError, Fault

if TYPE_CHECKING:
    from kiribench.conformability.result import Conformability
    from kiribench.conformability.score import ScoreOptions
    from kiribench.dataset import Dataset, Subject
    from kiribench.report.html import Html
    from kiribench.strain.result import StrainField
    from kiribench.surface.acquisition import Denoise

INDEX = "index.html"


def score_settings(options: ScoreOptions) -> dict[str, Any]:
    """The options of a score by their names on the command line."""
    return {name.replace("_", "-"): value for name, value in asdict(options).items()}


def write_reports(
    out: Path,
    dataset: Dataset,
    subjects: Sequence[Subject],
    scores: Sequence[Conformability],
    *,
    settings: Mapping[str, Any],
    denoise: Denoise = "auto",
    strains: Sequence[StrainField | None] | None = None,
    more: Html | None = None,
    quiet: bool = False,
) -> Path:
    """Write one page a subject and the index.

    Args:
        out: the folder; made if it is not there.
        dataset: of the subjects.
        subjects, scores: in the same order.
        settings: the options in force, by their names on the command line.
        denoise: as the scans were read for the scores.
        strains: the skin strain of each subject, or None: measured here where the bare
            straight scan is there, with the defaults of ``kiribench measure``.
        more: a section for the end of the index.
        quiet: no progress bar.

    Returns:
        The index page.
    """
    from kiribench.cli.progress import progress
    from kiribench.report import report_name, write_index, write_subject_report
    from kiribench.report.gather import gather
    from kiribench.surface.acquisition import acquire

    pages = []
    with progress("writing reports", quiet=quiet) as advance:
        for done, (subject, score) in enumerate(zip(subjects, scores, strict=True)):
            advance(done, len(subjects))
            doubts: tuple[Fault, ...] = ()
            if strains is not None:
                strain = strains[done]
            else:
                strain, doubts = _strain(subject, denoise)
            used = dict(settings)
            if strain is not None:
                used["strain-measure"] = strain.strain_measure
                used["min-strain"] = strain.min_strain
            page = gather(
                dataset,
                subject,
                conformability=score,
                strain=strain,
                surface=acquire(subject, "flex090", denoise=denoise).mesh,
                settings=used,
                warnings=doubts,
            )
            write_subject_report(out / report_name(subject.id), page)
            pages.append(page)
        advance(len(subjects), len(subjects))
    return write_index(out / INDEX, pages, more=more)


def _strain(subject: Subject, denoise: Denoise) -> tuple[StrainField | None, tuple[Fault, ...]]:
    """The skin strain where it can be measured; a score does not depend on it."""
    from kiribench.strain.measure import measure_subject

    if not subject.has("flex000"):
        return None, ()
    try:
        return measure_subject(subject, denoise=denoise), ()
    except DataError as error:
        return None, tuple(replace(fault, severity="warning") for fault in error.faults)
