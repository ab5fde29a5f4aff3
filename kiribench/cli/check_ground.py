"""What ``kiribench check`` puts a design on: its subject's flexed skin, or a plane."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kiribench.errors import UsageError

if TYPE_CHECKING:
    from kiribench.dataset import Subject
    from kiribench.reference.ground import Ground
    from kiribench.schema.patch_design import PatchDesign


def subject_of(
    design: PatchDesign, folder: Path | None, participant: str | None, *, needed: bool
) -> Subject | None:
    """The subject that a design is for: in the folder given, or beside the design."""
    from kiribench.dataset import Dataset

    name = participant or design.participant
    if folder is None:
        folder = _dataset_of(design, name)
    if folder is None or not name:
        if needed:
            raise UsageError(
                "check-no-subject",
                "The subject that the design is for was not found.",
                remedy="Give its dataset with --subject, and its id with --participant if the "
                "design does not say it.",
                file=design.file,
                got=name or "no participant",
            )
        return None
    if folder.name == f"sub-{name}" and not (folder / "dataset_description.json").exists():
        folder = folder.parent
    return Dataset.open(folder).subject(name)


def of_one_subject(designs: Sequence[PatchDesign], participant: str | None) -> None:
    """Refuse designs of different participants, or of another than the subject.

    Raises:
        UsageError: ``check-other-participant``; a table that names none is nobody's and passes.
    """
    names = [one.participant for one in designs if one.participant]
    expected = participant or (names[0] if names else None)
    for one in designs:
        if one.participant and one.participant != expected:
            raise UsageError(
                "check-other-participant",
                "The design was made for another participant.",
                remedy="Check each design on its own subject; for a design that is nobody's, "
                "leave the participant out of its sidecar.",
                file=one.file,
                got=one.participant,
                expected=expected,
            )


def _dataset_of(design: PatchDesign, participant: str) -> Path | None:
    """The dataset that the sidecar names, or one above the design, that has the participant."""
    if design.file is None or not participant:
        return None
    said = design.settings.get("Dataset")
    above = list(design.file.resolve().parents)
    candidates = [Path(said), design.file.parent / said] if isinstance(said, str) else []
    for folder in (*candidates, *above):
        if (folder / "dataset_description.json").is_file() and (
            folder / f"sub-{participant}"
        ).is_dir():
            return folder
    return None


def ground_of(
    design: PatchDesign, subject: Subject | None, surface: str, pull: float | None
) -> Ground:
    """The surface asked for; ``auto`` is worn where there is a subject.

    Raises:
        UsageError: ``check-pull-worn``, ``check-no-target``.
    """
    import numpy as np

    from kiribench.design.skin import skin_of
    from kiribench.reference.check import targets_of
    from kiribench.reference.developed import flat_skin_of, flat_skin_of_stretches
    from kiribench.reference.ground import FlatGround, KneeGround

    if surface == "worn" or (surface == "auto" and subject is not None and pull is None):
        if pull is not None:
            raise UsageError(
                "check-pull-worn",
                "--pull is for the flat check.",
                remedy="Give --surface flat with it, or leave it out.",
            )
        if subject is None:
            raise ValueError("a worn check has a subject")
        return KneeGround(skin_of(subject))
    plain = FlatGround(design.shape, design.cell_mm, pull=pull)
    if pull is not None:
        return plain
    if subject is not None:
        return FlatGround(design.shape, design.cell_mm, flat_skin_of(skin_of(subject)))
    longitudinal, lateral, source = targets_of(design, plain)
    if source != "design" or not np.isfinite(lateral).any():
        raise UsageError(
            "check-no-target",
            "There is neither a subject nor a target to check the design against.",
            remedy="Give --subject, a design table with its targets, or --pull.",
            file=design.file,
        )
    return FlatGround(
        design.shape,
        design.cell_mm,
        flat_skin_of_stretches(longitudinal, lateral, design.cell_mm),
    )


def synthetic(subject: Subject) -> bool:
    """Whether the dataset says that its subjects were computed."""
    from kiribench.dataset import Dataset
    from kiribench.report.gather import is_synthetic

    return is_synthetic(Dataset.open(subject.root).description)
