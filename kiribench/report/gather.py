"""From a subject folder and its results to what a page shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kiribench.conformability.result import Conformability
from kiribench.dataset import Dataset, Subject
from kiribench.errors import Fault
from kiribench.provenance import provenance
from kiribench.report.subject import SubjectReport
from kiribench.report.truth import read_truth
from kiribench.schema.sidecars import DatasetDescription
from kiribench.strain.result import StrainField
from kiribench.surface.mesh import Mesh


def gather(
    dataset: Dataset,
    subject: Subject,
    *,
    conformability: Conformability | None,
    strain: StrainField | None,
    surface: Mesh | None,
    settings: Mapping[str, Any],
    warnings: tuple[Fault, ...] = (),
) -> SubjectReport:
    """Put together what the page of one subject shows.

    Args:
        dataset, subject: where the results come from.
        conformability, strain: the results, or None.
        surface: the bare flexed scan, mm, or None where no picture is wanted.
        settings: the options in force, by their names on the command line.
        warnings: what is doubtful beyond what the results carry.
    """
    record = provenance((*dataset.files, *subject.files))
    root = dataset.root.resolve()
    synthetic = is_synthetic(dataset.description)
    record["inputs"] = {
        relative(name, root): entry for name, entry in sorted(record["inputs"].items())
    }
    return SubjectReport(
        participant=subject.id,
        dataset=dataset.description.name,
        side=subject.side or "none",
        layout=subject.layout,
        synthetic=synthetic,
        conformability=conformability,
        strain=strain,
        surface=surface,
        settings=settings,
        provenance=record,
        warnings=warnings,
        truth=read_truth(dataset, subject.id) if synthetic else None,
    )


def relative(name: str, root: Path) -> str:
    """A path within the dataset, so that a moved dataset gives the same report."""
    path = Path(name).resolve()
    return path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name


def is_synthetic(description: DatasetDescription) -> bool:
    """Whether the description says that the data was computed.

    Either ``"Synthetic": true``, or a generator named ``kiribench synth`` under
    ``GeneratedBy`` (the BIDS key).
    """
    extra = description.model_extra or {}
    if extra.get("Synthetic") is True:
        return True
    generators = extra.get("GeneratedBy")
    return isinstance(generators, list) and any(
        isinstance(item, dict) and item.get("Name") == "kiribench synth" for item in generators
    )
