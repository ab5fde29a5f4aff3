"""Reads one subject's files and collects everything that is wrong with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from kiribench.dataset.files import Folder, find_scans, near_names, present, unreadable
from kiribench.dataset.poses import pose_faults, table_faults
from kiribench.dataset.subject import Acquisition, Subject
from kiribench.errors import DatasetError, Fault
from kiribench.schema.layout import (
    ACQUISITIONS,
    NOMINAL_FLEXION_DEG,
    PATCH_ACQUISITIONS,
    Layout,
    LayoutMetadata,
)
from kiribench.schema.nodes import NodesTable
from kiribench.schema.nodes_parse import parse_nodes
from kiribench.schema.sidecars import NodesSidecar, ScanSidecar, Side
from kiribench.schema.strict_json import parse_json, parse_model
from kiribench.schema.tsv import parse_tsv

FLEXION_TOLERANCE_DEG = 15.0
"""Beyond it the pose is not what its name says, and a warning gives the angle."""

FLEXION_SWAP_DEG = 45.0
"""Beyond it the angle is nearer to the other pose than to its own: an error."""


def read_subject(
    folder: Folder, participant: str, metadata: LayoutMetadata, listed_side: Side | None
) -> Subject:
    """The subject with all faults of its files; scans are found but not opened."""
    try:
        return _read_subject(folder, participant, metadata, listed_side)
    except OSError as error:  # a folder that may not be listed
        fault = unreadable(error, f"sub-{participant}")
        layout = Layout.resolve(metadata)
        return Subject(folder.root, participant, listed_side, layout, {}, (fault,))


def _read_subject(
    folder: Folder, participant: str, metadata: LayoutMetadata, listed_side: Side | None
) -> Subject:
    root = folder.root / f"sub-{participant}"
    layout, faults = _layout(folder, root, metadata, participant)
    acquisitions: dict[str, Acquisition] = {}
    for name in ACQUISITIONS:
        found = _read_acquisition(folder, root / "surf", participant, name, layout)
        if found is not None:
            acquisitions[name] = found
    side, siding = _side(participant, listed_side, acquisitions)
    faults += siding
    poses = {name: found.nodes for name, found in acquisitions.items() if found.nodes is not None}
    if layout is None:
        layout = Layout.resolve(metadata)
    faults += pose_faults(poses, side, layout, folder)
    return Subject(folder.root, participant, side, layout, acquisitions, tuple(faults))


def resolve_layout(
    value: dict[str, Any], base: tuple[LayoutMetadata, ...], *, file: str
) -> tuple[LayoutMetadata | None, Layout | None, tuple[Fault, ...]]:
    """The layout keys of a JSON object on top of ``base``; None with faults if wrong."""
    metadata, faults = parse_model(LayoutMetadata, value, file=file)
    if metadata is None:
        return None, None, faults
    try:
        layout = Layout.resolve(*base, metadata)
    except DatasetError as error:
        return metadata, None, faults + tuple(replace(f, file=file) for f in error.faults)
    return metadata, layout, faults


def _layout(
    folder: Folder, root: Path, metadata: LayoutMetadata, participant: str
) -> tuple[Layout | None, list[Fault]]:
    path = root / f"sub-{participant}_layout.json"
    if not present(path):
        return Layout.resolve(metadata), []
    data, faults = folder.read(path)
    if data is None:
        return None, list(faults)
    name = folder.name(path)
    value, parsing = parse_json(data, file=name)
    if value is None:
        return None, [*faults, *parsing]
    _, layout, laying = resolve_layout(value, (metadata,), file=name)
    return layout, [*faults, *parsing, *laying]


def _read_acquisition(
    folder: Folder, surf: Path, participant: str, name: str, layout: Layout | None
) -> Acquisition | None:
    stem = f"sub-{participant}_acq-{name}"
    scans = find_scans(surf, f"{stem}_scan")
    paths = {
        "sidecar": surf / f"{stem}_scan.json",
        "nodes": surf / f"{stem}_nodes.tsv",
        "nodes sidecar": surf / f"{stem}_nodes.json",
    }
    if not scans and not any(present(path) for path in paths.values()):
        return None
    faults: list[Fault] = []
    files = [path for path in (*scans, *paths.values()) if folder.usable(path)]
    scan = _one_scan(folder, surf, stem, scans, faults)
    sidecar = _scan_sidecar(folder, paths["sidecar"], name, faults)
    nodes = _nodes(folder, paths["nodes"], paths["nodes sidecar"], name, layout, faults)
    return Acquisition(name, scan, sidecar, nodes, tuple(files), tuple(faults))


def _one_scan(
    folder: Folder, surf: Path, stem: str, scans: tuple[Path, ...], faults: list[Fault]
) -> Path | None:
    if not scans:
        near = near_names(surf, f"{stem}_scan.obj")
        faults.append(
            Fault(
                "scan-missing",
                "The scan is missing.",
                "Add it as .obj, .ply, .stl, .glb or .gltf.",
                file=folder.name(surf / f"{stem}_scan.obj"),
                got=f"similar names: {', '.join(near)}" if near else None,
            )
        )
        return None
    if len(scans) > 1:
        faults.append(
            Fault(
                "scan-ambiguous",
                "There are two scans of one acquisition.",
                "Keep one of them.",
                file=folder.name(scans[0]),
                got=", ".join(path.name for path in scans),
                expected="one file",
            )
        )
        return None
    fault = folder.refuse(scans[0])
    if fault is not None:
        faults.append(fault)
        return None
    if scans[0].stat().st_size == 0:
        faults.append(
            Fault(
                "scan-empty",
                "The file is empty.",
                "Export the scan again.",
                file=folder.name(scans[0]),
            )
        )
        return None
    return scans[0]


def _scan_sidecar(
    folder: Folder, path: Path, acquisition: str, faults: list[Fault]
) -> ScanSidecar | None:
    name = folder.name(path)
    if not present(path):
        faults.append(
            Fault(
                "sidecar-missing",
                "The scan has no sidecar, so its unit is not known.",
                'Write {"Units": "mm", "FlexionAngle": 0, "Side": "left"} with the true values.',
                file=name,
            )
        )
        return None
    data, reading = folder.read(path)
    faults += reading
    if data is None:
        return None
    value, parsing = parse_json(data, file=name)
    faults += parsing
    if value is None:
        return None
    sidecar, validating = parse_model(ScanSidecar, value, file=name)
    faults += validating
    if sidecar is not None:
        faults += _flexion(sidecar.flexion_angle, acquisition, name)
    return sidecar


def _flexion(angle: float | None, acquisition: str, file: str) -> list[Fault]:
    nominal = NOMINAL_FLEXION_DEG[acquisition]
    if angle is None:
        return [
            Fault(
                "flexion-missing",
                "The sidecar does not say the flexion angle; the file name's is taken.",
                f"Add FlexionAngle, about {nominal:g}.",
                file=file,
                column="FlexionAngle",
                severity="warning",
            )
        ]
    off = abs(angle - nominal)
    if off <= FLEXION_TOLERANCE_DEG:
        return []
    swapped = off > FLEXION_SWAP_DEG
    return [
        Fault(
            "flexion-contradiction" if swapped else "flexion-off",
            "The flexion angle contradicts the acquisition's name: are the scans of 0 and 90 "
            "degrees swapped?"
            if swapped
            else "The flexion angle is not what the acquisition's name says.",
            "Swap the files back, or correct FlexionAngle."
            if swapped
            else "Check the angle; results are labelled by the file name.",
            file=file,
            column="FlexionAngle",
            got=f"{angle:g}",
            expected=f"about {nominal:g}",
            severity="error" if swapped else "warning",
        )
    ]


def _nodes(
    folder: Folder,
    path: Path,
    sidecar_path: Path,
    acquisition: str,
    layout: Layout | None,
    faults: list[Fault],
) -> NodesTable | None:
    node_sd_mm: float | None = None
    if present(sidecar_path):
        data, reading = folder.read(sidecar_path)
        faults += reading
        if data is not None:
            value, parsing = parse_json(data, file=folder.name(sidecar_path))
            faults += parsing
            if value is not None:
                sidecar, validating = parse_model(
                    NodesSidecar, value, file=folder.name(sidecar_path)
                )
                faults += validating
                node_sd_mm = sidecar.node_sd_mm if sidecar is not None else None
    if not present(path):
        near = near_names(path.parent, path.name)
        what = "the patch's cell corners" if acquisition in PATCH_ACQUISITIONS else "the grid"
        faults.append(
            Fault(
                "nodes-missing",
                f"The nodes of {what} are missing.",
                "Write the table with row, col, x_mm, y_mm, z_mm, separated by tabs.",
                file=folder.name(path),
                got=f"similar names: {', '.join(near)}" if near else None,
            )
        )
        return None
    data, reading = folder.read(path)
    faults += reading
    if data is None:
        return None
    table, parsing = parse_tsv(data, file=folder.name(path))
    faults += parsing
    if table is None or layout is None:  # a wrong layout is reported; it judges no table
        return None
    nodes, checking = parse_nodes(
        table, path, layout.node_shape(acquisition), node_sd_mm=node_sd_mm
    )
    faults += checking
    if nodes is None or any(fault.severity == "error" for fault in parsing):
        return None
    pitch_mm = layout.patch.cell_mm if acquisition in PATCH_ACQUISITIONS else layout.grid.pitch_mm
    faults += table_faults(nodes, acquisition, pitch_mm, folder.name(path))
    return nodes


def _side(
    participant: str, listed: Side | None, acquisitions: dict[str, Acquisition]
) -> tuple[Side | None, list[Fault]]:
    said: dict[str, Side] = {} if listed is None else {"participants.tsv": listed}
    for name, found in acquisitions.items():
        if found.sidecar is not None and found.sidecar.side is not None:
            file = f"sub-{participant}/surf/sub-{participant}_acq-{name}_scan.json"
            said[file] = found.sidecar.side
    if len(set(said.values())) > 1:
        return None, [
            Fault(
                "side-contradiction",
                f"The files of participant {participant} do not agree on the side.",
                "Correct the wrong one: the side decides where lateral and medial are.",
                file=next(iter(said)),
                column="Side",
                got=", ".join(f"{side} in {file}" for file, side in said.items()),
                expected="one side",
            )
        ]
    if not said:
        if not any(found.sidecar is not None for found in acquisitions.values()):
            return None, []  # no sidecar was readable, which is reported already
        return None, [
            Fault(
                "side-missing",
                f"Nothing says the side of participant {participant}.",
                "Add Side to the scans' sidecars, or a column side to participants.tsv: left, "
                "right, or none for a body part that is not one of a pair.",
                file=f"sub-{participant}/surf",
                column="Side",
            )
        ]
    return next(iter(said.values())), []
