"""A dataset: its description, its participants, and everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from kiribench.dataset.files import Folder, present, unreadable
from kiribench.dataset.participants import Participants, find_participants, read_participants
from kiribench.dataset.reader import read_subject, resolve_layout
from kiribench.dataset.subject import REQUIRED_ACQUISITIONS, Subject
from kiribench.errors import DatasetError, Fault, UsageError
from kiribench.schema.layout import Layout, LayoutMetadata
from kiribench.schema.sidecars import DatasetDescription
from kiribench.schema.strict_json import parse_json, parse_model, short

DESCRIPTION = "dataset_description.json"


@dataclass(frozen=True, eq=False)
class Dataset:
    """A folder of subjects; make it with :meth:`open`.

    Attributes:
        root: the folder.
        description: ``dataset_description.json``.
        layout: the layout of every subject that has none of its own.
        participants: ids without ``sub-``, sorted; those whose folder exists.
        metadata: the layout keys as given, which a subject's own keys override.
        listed: ``participants.tsv``.
        warnings: what is doubtful in the folder as a whole.
    """

    root: Path
    description: DatasetDescription
    layout: Layout
    participants: tuple[str, ...]
    metadata: LayoutMetadata
    listed: Participants
    warnings: tuple[Fault, ...] = ()

    @classmethod
    def open(cls, root: Path | str) -> Dataset:
        """Read the description and find the participants of the dataset at ``root``.

        Raises:
            DatasetError: everything that is wrong with the folder as a whole, at once;
                subjects are read, and refused, one by one with :meth:`subject`.
        """
        dataset, faults = read_dataset(Path(root))
        errors = [fault for fault in faults if fault.severity == "error"]
        if dataset is None or errors:
            raise DatasetError.of(errors)
        return dataset

    def subject(self, participant: str) -> Subject:
        """Read one subject; its faults are raised when what they concern is asked for.

        Raises:
            UsageError: ``participant-unknown`` for an id that has no folder.
        """
        wanted = participant.removeprefix("sub-")
        if wanted not in self.participants:
            raise UsageError(
                "participant-unknown",
                "The dataset has no such participant.",
                got=short(participant),
                expected=", ".join(self.participants),
                remedy="Give one of the ids above.",
            )
        return read_subject(
            Folder.at(self.root), wanted, self.metadata, self.listed.sides.get(wanted)
        )

    def subjects(self, participant: str | None = None) -> Iterator[Subject]:
        """All subjects in the order of their ids, or the one asked for."""
        for wanted in (participant,) if participant is not None else self.participants:
            yield self.subject(wanted)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of the folder as a whole, for provenance."""
        candidates = (self.root / DESCRIPTION, self.root / "participants.tsv")
        folder = Folder.at(self.root)
        return tuple(path for path in candidates if folder.usable(path))


def check_dataset(root: Path | str) -> tuple[Fault, ...]:
    """Every fault of the folder, its tables and its sidecars; scans are not opened."""
    dataset, faults = read_dataset(Path(root))
    listed = list(faults)
    if dataset is not None:
        for subject in dataset.subjects():
            listed += subject_faults(subject)
    return tuple(listed)


def subject_faults(subject: Subject) -> tuple[Fault, ...]:
    """All faults of a subject, with its missing acquisitions (the worn scan may be absent)."""
    if any(fault.code == "path-unreadable" for fault in subject.own_faults):
        return subject.faults  # what cannot be listed is not missing
    absent = [name for name in REQUIRED_ACQUISITIONS if name not in subject.acquisitions]
    missing = [subject.missing(name) for name in absent]
    return (*missing, *subject.faults)


def read_dataset(root: Path) -> tuple[Dataset | None, tuple[Fault, ...]]:
    """The dataset as far as it can be read, and the faults of the folder as a whole."""
    try:
        return _read_folder(root)
    except OSError as error:  # a folder that may not be listed
        return None, (unreadable(error, str(root)),)


def _read_folder(root: Path) -> tuple[Dataset | None, tuple[Fault, ...]]:
    if not root.is_dir():
        is_file = root.is_file()
        return None, (
            Fault(
                "dataset-missing",
                "The dataset is a file, not a folder." if is_file else "There is no such folder.",
                "Give the folder that holds dataset_description.json.",
                file=str(root),
            ),
        )
    folder = Folder.at(root)
    description, metadata, layout, faults = _read_description(folder)
    found, finding = find_participants(folder)
    listed, listing = read_participants(folder, found)
    faults += (*finding, *listing)
    if not present(root / "README") and not any(
        present(root / f"README.{suffix}") for suffix in ("md", "txt", "rst")
    ):
        faults += (
            Fault(
                "readme-missing",
                "There is no README.",
                "Say in it how and by whom the scans were taken.",
                file="README",
                severity="warning",
            ),
        )
    if metadata is None or layout is None:
        # Without a layout the subjects' tables cannot be judged.
        return None, faults
    if description is None:
        # Read on, so that the subjects' faults show up as well; open() refuses anyway.
        description = DatasetDescription(name="unnamed")
    warnings = tuple(fault for fault in faults if fault.severity == "warning")
    return Dataset(root, description, layout, found, metadata, listed, warnings), faults


def _read_description(
    folder: Folder,
) -> tuple[DatasetDescription | None, LayoutMetadata | None, Layout | None, tuple[Fault, ...]]:
    path = folder.root / DESCRIPTION
    if not present(path):
        fault = Fault(
            "description-missing",
            "The dataset has no description.",
            'Write the file with at least {"Name": "..."}.',
            file=DESCRIPTION,
        )
        return None, LayoutMetadata(), Layout.of(), (fault,)
    data, faults = folder.read(path)
    if data is None:
        return None, None, None, faults
    value, parsing = parse_json(data, file=DESCRIPTION)
    faults += parsing
    if value is None:
        return None, None, None, faults
    description, reading = parse_model(DatasetDescription, value, file=DESCRIPTION)
    metadata, layout, laying = resolve_layout(value, (), file=DESCRIPTION)
    return description, metadata, layout, (*faults, *reading, *laying)
