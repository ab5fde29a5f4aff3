"""Measure the strain of one participant from the two bare scans."""

from __future__ import annotations

import numpy as np

from kiribench.dataset import Subject
from kiribench.errors import DatasetError
from kiribench.strain.field import Pose, strain_field
from kiribench.strain.measures import check_measure, check_min_strain
from kiribench.strain.result import StrainField, StrainMeasure
from kiribench.surface.acquisition import Acquired, Denoise, acquire
from kiribench.surface.cells import cell_frames, cells_around_hole, flat_corners, grid_sides

REFERENCE, DEFORMED = "flex000", "flex090"


def pose_of(acquired: Acquired) -> Pose:
    """Geodesic edges and flattened corners of a node grid on its scan.

    Raises:
        PathError: no path joins two adjacent nodes, or a cell's centre and its corner.
    """
    mesh, nodes, topology = acquired.mesh, acquired.nodes, acquired.topology
    sides = grid_sides(mesh, nodes, topology)
    frames = cell_frames(mesh, nodes, topology)
    corners = flat_corners(mesh, nodes, frames, topology)
    behind = nodes.cells_present & ~np.isfinite(corners).all(axis=(-1, -2))
    return Pose(
        name=acquired.name,
        longitudinal_mm=sides.longitudinal_mm,
        lateral_mm=sides.lateral_mm,
        corners=corners,
        sd_mm=nodes.sd_mm,
        denoised=acquired.denoised,
        around_hole=cells_around_hole(mesh, sides, topology) | behind,
    )


def measure_subject(
    subject: Subject,
    *,
    strain_measure: StrainMeasure = "log",
    min_strain: float = 0.03,
    denoise: Denoise = "auto",
) -> StrainField:
    """Measure every cell of the drawn grid between flex000 and flex090.

    Args:
        subject: with both acquisitions complete.
        strain_measure: of the strains and of Poisson's ratio.
        min_strain: Poisson's ratio is masked below it.
        denoise: ``auto``, ``always`` or ``never``.

    Raises:
        DatasetError, MeshError, NodesError, PathError: what is wrong with the input.
        UsageError: what is wrong with the options.
    """
    check_measure(strain_measure)
    check_min_strain(min_strain)
    subject.require(REFERENCE, DEFORMED)
    acquired = [acquire(subject, name, denoise=denoise) for name in (REFERENCE, DEFORMED)]
    field = strain_field(
        subject.id,
        pose_of(acquired[0]),
        pose_of(acquired[1]),
        strain_measure=strain_measure,
        min_strain=min_strain,
        notes=tuple(note for one in acquired for note in one.notes),
        warnings=tuple(fault for one in acquired for fault in one.warnings),
    )
    if not field.measured.any():
        raise DatasetError(
            "measure-no-cell",
            f"Participant {subject.id} has no cell with all four nodes in both poses.",
            remedy="Complete the nodes tables of flex000 and flex090.",
            file=f"sub-{subject.id}/surf",
        )
    return field
