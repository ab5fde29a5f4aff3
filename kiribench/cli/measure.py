"""``kiribench measure``: skin strain cell by cell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kiribench.cli.command import Common, Outcome
from kiribench.errors import Fault

if TYPE_CHECKING:
    from kiribench.strain.result import StrainField

SCHEMA = "kiribench.measure/1"


def measure(
    dataset: Path,
    /,
    *,
    participant: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    strain_measure: Literal["log", "engineering", "green"] = "log",
    min_strain: float = 0.03,
    denoise: Literal["auto", "always", "never"] = "auto",
    common: Common | None = None,
) -> Outcome:
    """Measure skin strain cell by cell from the two bare scans of each participant.

    With --out, writes a table and its description for each participant
    (sub-ID/sub-ID_strain.tsv and .json) beside measure.json.

    Parameters
    ----------
    dataset
        Folder of the subject folders.
    participant
        Id of a participant, with or without sub-; may be given several times. All if absent.
    strain_measure
        Measure of the strains and of Poisson's ratio.
    min_strain
        Poisson's ratio is masked where the absolute longitudinal strain is below this
        fraction.
    denoise
        Denoise the scans before measuring: where the estimated noise would lengthen
        geodesics noticeably, always, or never.
    common
        Options of every command.
    """
    from kiribench.cli.participants import chosen, each
    from kiribench.dataset import Dataset
    from kiribench.schema.result_tables import write_table
    from kiribench.strain.export import strain_object, strain_rows, strain_sidecar
    from kiribench.strain.measure import measure_subject
    from kiribench.strain.measures import check_min_strain

    common = common or Common()
    check_min_strain(min_strain)
    opened = Dataset.open(dataset)
    subjects = chosen(opened, participant)
    fields = each(
        subjects,
        lambda subject: measure_subject(
            subject, strain_measure=strain_measure, min_strain=min_strain, denoise=denoise
        ),
        "measuring",
        quiet=common.quiet,
    )
    if common.out is not None:
        for subject, field in zip(subjects, fields, strict=True):
            stem = f"sub-{field.participant}"
            write_table(
                common.out / stem / f"{stem}_strain.tsv",
                strain_rows(field),
                # Where the patch lies on the grid: what kiribench design needs of the table.
                strain_sidecar(field) | subject.layout.as_metadata() | {"Side": subject.side},
            )
    warnings: list[Fault] = [fault for field in fields for fault in field.warnings]
    result: dict[str, Any] = {
        "schema": SCHEMA,
        "dataset": opened.description.name,
        "participants": [strain_object(field) for field in fields],
    }
    return Outcome(
        result=result,
        text="\n\n".join(measure_text(field) for field in fields),
        faults=tuple(warnings),
        inputs=(*opened.files, *(path for subject in subjects for path in subject.files)),
    )


def measure_text(field: StrainField) -> str:
    """The strain of one participant for a person; the last line is the verdict."""
    import numpy as np

    lines = [
        f"Participant {field.participant}: {int(field.measured.sum())} of {field.reason.size} "
        f"cells measured, {field.reference_pose} to {field.deformed_pose}, "
        f"{field.strain_measure} strain."
    ]
    for name, values in (
        ("longitudinal strain", field.longitudinal_strain.value),
        ("lateral strain", field.lateral_strain.value),
        ("shear", field.shear.value),
        ("Poisson's ratio", field.poisson_ratio.value),
    ):
        known = values[np.isfinite(values)]
        if len(known) == 0:
            lines.append(f"  {name:<20} none")
            continue
        lines.append(
            f"  {name:<20} median {np.median(known):+.4f}   range {known.min():+.4f} to "
            f"{known.max():+.4f}   ({len(known)} cells)"
        )
    sd = field.longitudinal_strain.sd[field.measured]
    if len(sd):
        lines.append(f"  node uncertainty makes a strain sd of {np.median(sd):.4f} (median).")
    lines += [f"  {note}" for note in field.notes]
    masked = int(((field.poisson_reason == "strain-too-small") & field.measured).sum())
    open_ended = int((field.poisson_reason == "interval-unbounded").sum())
    lines.append(
        f"  Verdict: Poisson's ratio is given in {int(field.measured.sum()) - masked} cells, in "
        f"{open_ended} of them without a finite 95 % interval; masked in {masked} "
        f"(strain below {field.min_strain:g})."
    )
    return "\n".join(lines)
