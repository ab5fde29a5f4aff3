"""Participants: the ``sub-`` folders and ``participants.tsv``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import cast

from kiribench.dataset.files import Folder, present
from kiribench.errors import Fault
from kiribench.schema.sidecars import Side, side_of
from kiribench.schema.strict_json import parse_json, short
from kiribench.schema.tsv import TsvTable, parse_tsv

PARTICIPANTS = "participants.tsv"
_ID = re.compile(r"^[A-Za-z0-9]{1,64}$")
_NO_VALUE = frozenset({"", "n/a", "na"})


@dataclass(frozen=True)
class Participants:
    """What ``participants.tsv`` says.

    Attributes:
        ids: as listed, without ``sub-``.
        sides: the side of those that have one.
    """

    ids: tuple[str, ...] = ()
    sides: Mapping[str, Side] = field(default_factory=dict)


def is_participant_id(text: str) -> bool:
    """Whether ``text`` may be an id: 1 to 64 ASCII letters and digits."""
    return _ID.match(text) is not None and text.isascii()


def find_participants(folder: Folder) -> tuple[tuple[str, ...], tuple[Fault, ...]]:
    """The ids of the ``sub-`` folders, sorted; and what is wrong with their names."""
    found: list[str] = []
    faults: list[Fault] = []
    for path in sorted(folder.root.iterdir()):
        if not path.name.startswith("sub-"):
            continue
        label = path.name.removeprefix("sub-")
        if not path.is_dir():
            faults.append(
                Fault(
                    "subject-not-a-folder",
                    "A file has the name of a subject's folder.",
                    "Put the subject's files into a folder of that name, or rename the file.",
                    file=folder.name(path),
                )
            )
        elif not is_participant_id(label):
            faults.append(_bad_id(label, folder.name(path), None))
        elif not path.resolve().is_relative_to(folder.resolved):
            faults.append(
                Fault(
                    "path-outside",
                    "The path leads out of the dataset.",
                    "Copy the folder into the dataset; links may only lead inside it.",
                    file=folder.name(path),
                    got="a symbolic link to somewhere else",
                )
            )
        else:
            found.append(label)
    if not found and not faults:
        faults.append(
            Fault(
                "dataset-empty",
                "The dataset has no subject.",
                "Add a folder sub-ID/surf with the scans and nodes of each subject.",
                file=".",
                expected="sub-*",
            )
        )
    return tuple(found), tuple(faults)


def read_participants(
    folder: Folder, found: tuple[str, ...]
) -> tuple[Participants, tuple[Fault, ...]]:
    """``participants.tsv`` compared with the folders that were ``found``."""
    faults: list[Fault] = list(_check_sidecar(folder))
    path = folder.root / PARTICIPANTS
    if not present(path):
        faults.append(
            Fault(
                "participants-missing",
                "There is no table of participants; the folders say who they are.",
                "Write participant_id and side, one row a subject.",
                file=PARTICIPANTS,
                severity="warning",
            )
        )
        return Participants(), tuple(faults)
    data, reading = folder.read(path)
    faults += reading
    if data is None:
        return Participants(), tuple(faults)
    table, parsing = parse_tsv(data, file=PARTICIPANTS)
    faults += parsing
    if table is None:
        return Participants(), tuple(faults)
    if "participant_id" not in table.columns:
        faults.append(
            Fault(
                "participants-column-missing",
                "A column is missing.",
                "Name the column of the ids participant_id.",
                file=PARTICIPANTS,
                column="participant_id",
                got=short(", ".join(table.columns), 100),
            )
        )
        return Participants(), tuple(faults)
    listed, listing = _rows(table)
    faults += listing
    for label in listed.ids:
        if label not in found:
            faults.append(
                Fault(
                    "participant-without-folder",
                    f"Participant {label} is listed but has no folder.",
                    f"Add sub-{label}/surf, or remove the row.",
                    file=PARTICIPANTS,
                    row=table.lines[_index_of(table, label)],
                    column="participant_id",
                    got=f"no folder sub-{label}",
                )
            )
    faults += [
        Fault(
            "participant-not-listed",
            f"Participant {label} has a folder but no row.",
            "Add the row.",
            file=PARTICIPANTS,
            severity="warning",
        )
        for label in found
        if label not in listed.ids
    ]
    return listed, tuple(faults)


def _index_of(table: TsvTable, label: str) -> int:
    ids = [text.removeprefix("sub-") for text in table.column("participant_id")]
    return ids.index(label)


def _rows(table: TsvTable) -> tuple[Participants, list[Fault]]:
    faults: list[Fault] = []
    ids: list[str] = []
    sides: dict[str, Side] = {}
    side_fields = table.column("side") if "side" in table.columns else ("",) * len(table.rows)
    for line, text, side_text in zip(
        table.lines, table.column("participant_id"), side_fields, strict=True
    ):
        label = text.removeprefix("sub-")
        if not is_participant_id(label):
            faults.append(_bad_id(label, PARTICIPANTS, line))
            continue
        if label in ids:
            faults.append(
                Fault(
                    "participant-duplicate",
                    f"Participant {label} is listed twice.",
                    "Keep one row a participant.",
                    file=PARTICIPANTS,
                    row=line,
                    column="participant_id",
                )
            )
            continue
        ids.append(label)
        if side_text.lower() in _NO_VALUE:
            continue
        side = side_of(side_text)
        if side in ("left", "right", "none"):
            sides[label] = cast(Side, side)
        else:
            faults.append(
                Fault(
                    "participant-side",
                    "The side is not known.",
                    "Write left, right, or n/a where the sidecars say it.",
                    file=PARTICIPANTS,
                    row=line,
                    column="side",
                    got=short(side_text),
                    expected="left or right",
                )
            )
    return Participants(tuple(ids), sides), faults


def _bad_id(label: str, file: str, line: int | None) -> Fault:
    return Fault(
        "participant-id",
        "The participant's id is not made of letters and digits only.",
        "Use letters A to Z and digits, up to 64, after sub-.",
        file=file,
        row=line,
        column=None if line is None else "participant_id",
        got=short(label),
        expected="[A-Za-z0-9]+",
    )


def _check_sidecar(folder: Folder) -> tuple[Fault, ...]:
    """The optional ``participants.json``: only has to be JSON."""
    path = folder.root / "participants.json"
    if not present(path):
        return ()
    data, faults = folder.read(path)
    if data is None:
        return faults
    _, parsing = parse_json(data, file="participants.json")
    return faults + parsing
