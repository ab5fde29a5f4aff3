"""Read a scan of any format that scanners write, into millimetres."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from kiribench.errors import Fault, MeshError
from kiribench.surface.files import regular_file
from kiribench.surface.mesh import Mesh
from kiribench.surface.obj import read_obj

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
"""Millimetres in each unit that a scan's sidecar may name."""

OTHER_SUFFIXES = (".ply", ".stl", ".glb", ".gltf")
SUFFIXES = (".obj", *OTHER_SUFFIXES)
"""The endings of the formats that are read."""


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan as read: the mesh in millimetres, and what was odd about its file.

    Attributes:
        mesh: the mesh in mm; not yet checked or repaired.
        faults: warnings (refused paths, missing pictures, ...); an error is raised instead.
    """

    mesh: Mesh
    faults: tuple[Fault, ...]


def read_scan(path: Path, *, units: str = "mm") -> Scan:
    """Read the scan at ``path`` and scale it to millimetres.

    Args:
        path: an OBJ, PLY, STL, GLB or glTF file.
        units: the unit of the file's coordinates: ``mm``, ``cm``, ``m`` or ``in``. No format
            but glTF has a unit of its own, and scanners ignore that one too: the sidecar's
            unit is what counts, and ``kiribench validate`` holds it against the nodes and
            the drawn pitch.

    Raises:
        MeshError: ``mesh-unknown-unit``, ``mesh-unknown-format``, ``mesh-unreadable`` and
            the codes of :func:`kiribench.surface.obj.read_obj`, with file and line.
    """
    scale = mm_per_unit(units, file=path)
    suffix = path.suffix.lower()
    if suffix == ".obj":
        content = read_obj(path)
        content.vertices.__imul__(scale)
        mesh = Mesh(
            vertices_mm=content.vertices,
            faces=content.faces,
            uv=content.uv,
            face_uv=content.face_uv,
            colours=content.colours,
            texture=content.texture,
        )
        return Scan(mesh, content.faults)
    if suffix not in OTHER_SUFFIXES:
        raise MeshError(
            "mesh-unknown-format",
            "The scan's format is not known by its ending.",
            remedy="Export the scan as OBJ (best), PLY, STL or glTF.",
            file=path,
            got=repr(path.suffix),
            expected=", ".join(SUFFIXES),
        )
    from kiribench.surface.other_formats import read_other

    scan, faults = read_other(regular_file(path))
    return Scan(replace(scan, vertices_mm=scan.vertices_mm * scale), faults)


def read_mesh(path: Path, *, units: str = "mm") -> Mesh:
    """The mesh of :func:`read_scan` alone, in mm; its warnings are dropped."""
    return read_scan(path, units=units).mesh


def mm_per_unit(units: str, *, file: Path | str | None = None) -> float:
    """Millimetres in one of ``units``.

    Raises:
        MeshError: ``mesh-unknown-unit``; set ``Units`` in the scan's sidecar to one of
            mm, cm, m, in.
    """
    if units not in MM_PER_UNIT:
        raise MeshError(
            "mesh-unknown-unit",
            "The unit of the scan is not known.",
            remedy='Set "Units" in the scan\'s JSON sidecar to the unit of its coordinates.',
            file=file,
            got=repr(units),
            expected=", ".join(MM_PER_UNIT),
        )
    return MM_PER_UNIT[units]
