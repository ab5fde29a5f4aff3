"""Broken folders and metadata."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from zoo.damage import (
    Case,
    both,
    bytes_at,
    edit_json,
    nodes,
    scan,
    sidecar,
    void,
)


def description(root: Path) -> Path:
    return root / "dataset_description.json"


def participants(root: Path) -> Path:
    return root / "participants.tsv"


def rename_subject(root: Path, name: str) -> None:
    (root / "sub-A").rename(root / name)


def subject_elsewhere(root: Path) -> None:
    shutil.move(root / "sub-A", root.parent / "elsewhere")
    (root / "sub-A").symlink_to(root.parent / "elsewhere", target_is_directory=True)


def scan_elsewhere(root: Path) -> None:
    shutil.move(scan(root), root.parent / "elsewhere.obj")
    scan(root).symlink_to(root.parent / "elsewhere.obj")


def scan_is_a_folder(root: Path) -> None:
    scan(root).unlink()
    scan(root).mkdir()


def scan_is_a_pipe(root: Path) -> None:
    scan(root).unlink()
    os.mkfifo(scan(root))


def files_swapped(root: Path) -> None:
    for place in (scan, nodes):
        one, other = place(root, "flex000"), place(root, "flex090")
        one.rename(root / "spare")
        other.rename(one)
        (root / "spare").rename(other)


def acquisition_gone(root: Path) -> None:
    for place in (scan, nodes, sidecar):
        place(root).unlink()


FOLDER = (
    Case("no such folder", lambda root: shutil.rmtree(root), "dataset-missing"),
    Case(
        "a file for a folder",
        lambda root: (shutil.rmtree(root), void(root.write_text("x")))[1],
        "dataset-missing",
    ),
    Case("no description", lambda root: description(root).unlink(), "description-missing"),
    Case("empty description", bytes_at(description, b""), "json-empty"),
    Case("key twice", bytes_at(description, b'{"Name": "a", "Name": "b"}'), "json-duplicate-key"),
    Case("NaN in JSON", bytes_at(description, b'{"Name": "a", "X": NaN}'), "json-not-finite"),
    Case("name is a number", bytes_at(description, b'{"Name": 1}'), "json-value"),
    Case("UTF-16", bytes_at(description, '{"Name": "a"}'.encode("utf-16")), "text-encoding"),
    Case("nested too deep", bytes_at(description, b'{"a":' * 50_000), "json-syntax"),
    Case(
        "byte order mark",
        bytes_at(description, b'\xef\xbb\xbf{"Name": "a"}'),
        "text-bom",
        0,
        0,
        0,
        harmless=True,
    ),
    Case("no subject", lambda root: shutil.rmtree(root / "sub-A"), "dataset-empty"),
    Case(
        "HTML in a folder's name",
        lambda root: rename_subject(root, "sub-<img src=x onerror=alert(1)>"),
        "participant-id",
    ),
    Case("dots in a folder's name", lambda root: rename_subject(root, "sub-.."), "participant-id"),
    Case(
        "HTML in the table",
        bytes_at(participants, b"participant_id\n<script>alert(1)</script>\n"),
        "participant-id",
    ),
    Case(
        "path in the table",
        bytes_at(participants, b"participant_id\nA\n../../etc/passwd\n"),
        "participant-id",
    ),
    Case(
        "listed twice",
        bytes_at(participants, b"participant_id\nA\nsub-A\n"),
        "participant-duplicate",
    ),
    Case(
        "no table of participants",
        lambda root: participants(root).unlink(),
        "participants-missing",
        0,
        0,
        0,
        harmless=True,
    ),
    Case("subject linked from outside", subject_elsewhere, "path-outside"),
    Case("scan linked from outside", scan_elsewhere, "path-outside"),
    Case("scan missing", lambda root: scan(root).unlink(), "scan-missing"),
    Case("scan is a folder", scan_is_a_folder, "path-not-a-file"),
    Case("scan is a pipe", scan_is_a_pipe, "path-not-a-file"),
    Case(
        "two scans",
        lambda root: void(shutil.copy(scan(root), scan(root, suffix=".ply"))),
        "scan-ambiguous",
    ),
    Case("sidecar missing", lambda root: sidecar(root).unlink(), "sidecar-missing"),
    Case("no unit", edit_json(sidecar, Units=None), "json-key-missing"),
    Case("unknown unit", edit_json(sidecar, Units="furlong"), "json-value"),
    Case(
        "no side",
        both(
            bytes_at(participants, b"participant_id\nA\n"),
            *(
                edit_json(lambda root, p=pose: sidecar(root, p), Side=None)
                for pose in ("flex000", "flex090", "flex090worn")
            ),
        ),
        "side-missing",
    ),
    Case("two sides", edit_json(sidecar, Side="left"), "side-contradiction"),
    Case(
        "0 and 90 swapped in the sidecars",
        both(
            edit_json(sidecar, FlexionAngle=0),
            edit_json(lambda root: sidecar(root, "flex000"), FlexionAngle=90),
        ),
        "flexion-contradiction",
    ),
    Case("0 and 90 swapped in the files", files_swapped, "poses-swapped"),
    Case("no second pose", acquisition_gone, "acquisition-missing"),
    Case(
        "patch larger than the grid",
        bytes_at(description, b'{"Name": "a", "Patch": {"Rows": 20}}'),
        "patch-outside-grid",
    ),
    Case(
        "misspelt key of the grid",
        bytes_at(description, b'{"Name": "a", "Grid": {"Pitch": 10}}'),
        "json-key-unknown",
    ),
    Case(
        "absurd grid",
        bytes_at(description, b'{"Name": "a", "Grid": {"Rows": 1000000000}}'),
        "json-value",
    ),
    Case(
        "another grid than drawn",
        bytes_at(description, b'{"Name": "a", "Grid": {"Rows": 18}}'),
        "nodes-edge-missing",
    ),
    Case(
        "region table of another patch",
        bytes_at(description, b'{"Name": "a", "Regions": [["a", "b"], ["c", "d"]]}'),
        "regions-shape",
    ),
)
