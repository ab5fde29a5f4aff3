"""Everything that can be known to be wrong with one acquisition's scan and its nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from kiribench.dataset import NodesTable, Subject
from kiribench.dataset.poses import handedness
from kiribench.errors import Fault, KiribenchError
from kiribench.surface.health import MeshHealth, check_mesh
from kiribench.surface.mesh import FloatArray, Mesh
from kiribench.surface.nodes import LocatedNodes, locate_nodes
from kiribench.surface.read import MM_PER_UNIT, read_scan
from kiribench.surface.repair import repair_mesh
from kiribench.surface.topology import topology

UNIT_REACH = 0.03
"""Largest median distance of the nodes from the next vertex, as a part of their extent: a
scan's vertices are dense, and a wrong unit misses by far more."""

WINDING_AGREEMENT = 0.8
"""Part of the nodes whose normals must agree before the winding is judged."""


@dataclass(frozen=True, eq=False)
class ScanCheck:
    """What the check of one acquisition found.

    Attributes:
        acquisition: its name.
        file: the scan, relative to the dataset.
        faults: warnings and errors, files relative to the dataset.
        health: of the mesh as read; None if it could not be read.
        repairs: what would be repaired on loading.
        offset_mm: (median, largest) distance of the nodes from the scan; None if unknown.
    """

    acquisition: str
    file: str
    faults: tuple[Fault, ...]
    health: MeshHealth | None = None
    repairs: tuple[str, ...] = ()
    offset_mm: tuple[float, float] | None = None


def check_scan(subject: Subject, acquisition: str) -> ScanCheck | None:
    """Check the scan of ``acquisition`` and where its nodes lie on it.

    None if the scan or its sidecar is missing or unreadable, which the subject's own faults
    say. Codes: those of ``read_scan``, ``check_mesh``, ``repair_mesh``, ``locate_nodes``;
    ``scan-units`` and ``mesh-winding-reversed`` (a warning).
    """
    found = subject.acquisitions.get(acquisition)
    if found is None or found.scan is None or found.sidecar is None:
        return None
    file = found.scan.relative_to(subject.root).as_posix()
    faults: list[Fault] = []
    health: MeshHealth | None = None
    repairs: tuple[str, ...] = ()
    offset: tuple[float, float] | None = None
    try:
        scan = read_scan(found.scan, units=found.sidecar.units)
        faults += scan.faults
        health = check_mesh(scan.mesh, file=file)
        faults += health.faults
        nodes = found.nodes
        if any(fault.code == "nodes-spacing" for fault in found.faults):
            nodes = None  # in the wrong unit: their places on the scan would only mislead
        if nodes is not None:
            faults += _units(nodes, scan.mesh, found.sidecar.units, file)
        if not any(fault.severity == "error" for fault in faults):
            repaired = repair_mesh(scan.mesh, file=file)
            repairs = repaired.actions
            if nodes is not None:
                located = locate_nodes(repaired.mesh, nodes, repaired=repaired)
                distances = located.offset_mm[located.present]
                offset = (float(np.median(distances)), float(distances.max()))
                faults += _pieces(repaired.mesh, located, str(nodes.file))
                faults += _winding(repaired.mesh, located, subject, file)
    except KiribenchError as error:
        faults += error.faults
    return ScanCheck(
        acquisition, file, relative_faults(faults, subject.root), health, repairs, offset
    )


def relative_faults(faults: Iterable[Fault], root: Path) -> tuple[Fault, ...]:
    """The faults with files relative to ``root``, each once."""
    prefixes = (f"{root.resolve().as_posix()}/", f"{root.as_posix()}/")
    listed: dict[Fault, None] = {}
    for fault in faults:
        name = fault.file
        if name is not None:
            for prefix in prefixes:
                name = name.removeprefix(prefix)
            fault = replace(fault, file=name)
        listed[fault] = None
    return tuple(listed)


def _units(nodes: NodesTable, mesh: Mesh, declared: str, file: str) -> list[Fault]:
    """``scan-units`` if the nodes lie on the scan only in another unit than declared."""
    seen = nodes.xyz_mm[nodes.present]
    vertices = mesh.vertices_mm[np.isfinite(mesh.vertices_mm).all(axis=1)]
    if len(seen) < 3 or len(vertices) < 3:
        return []
    from scipy.spatial import cKDTree

    tree = cKDTree(vertices)
    reach = UNIT_REACH * _size(seen)
    if float(np.median(tree.query(seen)[0])) <= reach:
        return []
    for unit, millimetres in MM_PER_UNIT.items():
        factor = millimetres / MM_PER_UNIT[declared]
        if float(np.median(tree.query(seen / factor)[0])) * factor <= reach:
            return [
                Fault(
                    "scan-units",
                    f"The scan is in {unit}, not in {declared}: only so do its nodes lie on it.",
                    f'Set "Units": "{unit}" in the scan\'s sidecar.',
                    file=file,
                    column="Units",
                    got=f"a scan {_size(vertices):.3g} mm across for nodes {_size(seen):.3g} mm "
                    "across",
                    expected="a scan that its nodes lie on",
                )
            ]
    return []


def _size(points: FloatArray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _pieces(mesh: Mesh, located: LocatedNodes, table: str) -> list[Fault]:
    """``nodes-on-pieces`` if the nodes lie on pieces of the scan that are not connected."""
    pieces = topology(mesh).components[located.points.faces]
    counts = np.unique(pieces, return_counts=True)[1]
    if len(counts) < 2:
        return []
    return [
        Fault(
            "nodes-on-pieces",
            "The nodes lie on pieces of the scan that are not connected, so no path leads from "
            "some to others.",
            "Close the gaps in the scanner's software; else set the nodes beyond the gap to "
            "missing.",
            file=table,
            got=f"{', '.join(str(n) for n in sorted(counts.tolist(), reverse=True))} nodes a piece",
            expected="all nodes on one piece",
        )
    ]


def _winding(mesh: Mesh, located: LocatedNodes, subject: Subject, file: str) -> list[Fault]:
    """Compare the mesh's normals with the outside that the grid and the side give."""
    expected = {"right": 1.0, "left": -1.0}.get(subject.side or "", 0.0)
    grid = located.positions_mm
    normals = np.full_like(grid, np.nan)
    normals[located.present] = mesh.face_normals[located.points.faces]
    distal = grid[1:, :-1] - grid[:-1, :-1]
    medial = grid[:-1, 1:] - grid[:-1, :-1]
    agree = np.sign(np.einsum("rcx,rcx->rc", np.cross(distal, medial), normals[:-1, :-1]))
    agree = agree[np.isfinite(agree)]
    if not expected or not len(agree):
        return []
    share = float(np.mean(agree == expected))
    if share > 1 - WINDING_AGREEMENT:
        return []
    shape = handedness(grid)
    if shape.decisive and np.sign(shape.bulge) != expected:
        return []  # the nodes themselves are mirrored, which is reported as such
    plain = (
        "The scan's faces are wound inside out: their normals point into the limb."
        if shape.decisive
        else "Either the scan's faces are wound inside out, or the grid is mirrored; on so flat a "
        "surface nothing tells which."
    )
    return [
        Fault(
            "mesh-winding-reversed" if shape.decisive else "winding-or-mirrored",
            plain + " Stretches and overlaps do not depend on the winding.",
            "Flip the normals when exporting the scan"
            + ("." if shape.decisive else "; else check Side and the order of the columns."),
            file=file,
            got=f"{1 - share:.0%} of the normals point inwards",
            severity="warning",
        )
    ]
