"""One acquisition ready for measuring: scan repaired, denoised if need be, nodes on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from kiribench.dataset import Subject
from kiribench.errors import DatasetError, Fault
from kiribench.surface.denoise import AUTO_LENGTHENING, denoise_if_needed, estimate_noise
from kiribench.surface.denoise import denoise as denoised_mesh
from kiribench.surface.mesh import Mesh
from kiribench.surface.nodes import LocatedNodes, locate_nodes
from kiribench.surface.read import read_scan
from kiribench.surface.repair import repair_mesh
from kiribench.surface.topology import Topology, topology

Denoise = Literal["auto", "always", "never"]


@dataclass(frozen=True, eq=False)
class Acquired:
    """A scan and its nodes.

    Attributes:
        name: acquisition name.
        mesh: repaired, in mm.
        topology: of ``mesh``.
        nodes: on ``mesh``.
        denoised: whether ``mesh`` was denoised.
        notes: facts for the reader. warnings: what is doubtful.
    """

    name: str
    mesh: Mesh
    topology: Topology
    nodes: LocatedNodes
    denoised: bool
    notes: tuple[str, ...]
    warnings: tuple[Fault, ...]


def acquire(subject: Subject, name: str, *, denoise: Denoise | None = "auto") -> Acquired:
    """Load, repair and, where asked or needed, denoise a scan, and put its nodes on it.

    The nodes are found on the scan as it is and keep their faces; denoising moves the
    surface under them along its normals only.

    Args:
        subject: has the acquisition.
        name: acquisition name.
        denoise: ``auto`` denoises a scan whose noise makes paths longer by more than
            ``AUTO_LENGTHENING``; ``always``; ``never`` only says how noisy it is; None
            does not look, for a scan along which nothing is measured.

    Raises:
        DatasetError, MeshError, NodesError: what is wrong with the files.
    """
    table = subject.nodes(name)
    sidecar = subject.scan_sidecar(name)
    path = subject.scan_path(name)
    if path is None:
        raise DatasetError(
            "acquisition-missing",
            f"Participant {subject.id} has no scan for {name}.",
            remedy=f"Add sub-{subject.id}_acq-{name}_scan.obj.",
        )
    file = path.relative_to(subject.root).as_posix()
    scan = read_scan(path, units=sidecar.units)
    repaired = repair_mesh(scan.mesh, file=file)
    nodes = locate_nodes(repaired.mesh, table, repaired=repaired)
    notes = [f"{name}: {action}" for action in repaired.actions]
    if nodes.sd_source == "default":
        sd = float(np.nanmedian(nodes.sd_mm))
        notes.append(f"{name}: node uncertainty is not given; {sd:g} mm is assumed.")
    mesh, applied = repaired.mesh, False
    if denoise == "always":
        mesh, applied = denoised_mesh(mesh), True
        notes.append(f"{name}: denoised, as asked.")
    elif denoise is not None:
        if denoise == "auto":
            decided = denoise_if_needed(mesh)
            mesh, applied, estimate = decided.mesh, decided.applied, decided.estimate
        else:
            estimate = estimate_noise(mesh)
        notes.append(
            f"{name}: scan noise {estimate.sd_mm:.3f} mm lengthens paths by "
            f"{100 * estimate.predicted_lengthening:.2f} % as predicted; "
            + (
                "denoised."
                if applied
                else f"not denoised (limit {100 * AUTO_LENGTHENING:g} %)."
                if denoise == "auto"
                else "not denoised, as asked."
            )
        )
    return Acquired(
        name=name,
        mesh=mesh,
        topology=topology(mesh),
        nodes=nodes.moved(mesh) if applied else nodes,
        denoised=applied,
        notes=tuple(notes),
        warnings=tuple(scan.faults),
    )
