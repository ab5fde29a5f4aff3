"""Copies of a subject in which nothing that matters has changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kiribench.dataset import Dataset, Subject
from kiribench.schema.sidecars import MM_PER_UNIT
from kiribench.surface.mesh import FloatArray, IntArray
from kiribench.surface.read import read_mesh

Remake = Callable[[FloatArray, IntArray], tuple[FloatArray, IntArray]]


@dataclass(frozen=True)
class Variant:
    """How a copy differs.

    Attributes:
        name: of the invariant.
        motion: (4, 4) applied to scans and nodes alike, mm; may mirror.
        units: of the copied scans.
        remake: another triangulation of the same surface, or None.
        overlap_bound, strain_bound: how much overlaps and stretches may change.
        why: the reason of the bounds.
    """

    name: str
    motion: FloatArray
    units: str
    remake: Remake | None
    overlap_bound: float
    strain_bound: float
    why: str

    @property
    def mirrors(self) -> bool:
        """Whether a left leg becomes a right one."""
        return bool(np.linalg.det(self.motion[:3, :3]) < 0.0)


def split_faces(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Every face split into four at the middles of its edges: the same surface."""
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(ends, axis=0, return_inverse=True)
    middle = (len(vertices) + inverse.reshape(-1, 3)).astype(np.int32)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    split = np.concatenate(
        [
            np.stack([a, ab, ca], axis=1),
            np.stack([ab, b, bc], axis=1),
            np.stack([ca, bc, c], axis=1),
            np.stack([ab, bc, ca], axis=1),
        ]
    )
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), split


def _moved() -> FloatArray:
    angle = np.deg2rad(35.0)
    motion = np.eye(4)
    motion[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    motion[:3, 3] = [120.0, -340.0, 75.0]
    return motion


VARIANTS = (
    Variant(
        "rigid-motion",
        _moved(),
        "mm",
        None,
        1e-4,
        1e-6,
        "files are rounded to 1e-6 mm; registration stops within 1e-3 mm",
    ),
    Variant(
        "units",
        np.eye(4),
        "m",
        None,
        1e-4,
        1e-6,
        "files are rounded to 1e-6 mm; registration stops within 1e-3 mm",
    ),
    Variant(
        "mirror",
        np.diag([-1.0, 1.0, 1.0, 1.0]),
        "mm",
        None,
        1e-3,
        1e-6,
        "lateral and medial swap; registration draws other skin points, some 0.003 mm",
    ),
    Variant(
        "remeshing",
        np.eye(4),
        "mm",
        split_faces,
        2e-3,
        1e-6,
        "the surface is the same; registration and the skin's normals see other samples of it",
    ),
)


def write_variant(subject: Subject, dataset: Dataset, variant: Variant, root: Path) -> Dataset:
    """Write the copy of one subject as a dataset of its own.

    Args:
        subject: to copy. dataset: that it is from.
        variant: the difference. root: an empty folder.
    """
    description = json.loads((dataset.root / "dataset_description.json").read_text("utf-8"))
    (root / "dataset_description.json").write_text(json.dumps(description), "utf-8")
    override = subject.root / f"sub-{subject.id}" / f"sub-{subject.id}_layout.json"
    folder = root / f"sub-{subject.id}" / "surf"
    folder.mkdir(parents=True)
    if override.is_file():
        (folder.parent / override.name).write_bytes(override.read_bytes())
    side = subject.side
    if variant.mirrors and side in ("left", "right"):
        side = "right" if side == "left" else "left"
    for name in subject.acquisitions:
        _write_scan(subject, name, variant, folder, side)
        _write_nodes(subject, name, variant, folder)
    return Dataset.open(root)


def _apply(motion: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ motion[:3, :3].T + motion[:3, 3])


def _write_scan(
    subject: Subject, name: str, variant: Variant, folder: Path, side: str | None
) -> None:
    sidecar = subject.scan_sidecar(name)
    path = subject.scan_path(name)
    if path is None:
        raise ValueError(f"{subject.id} has no scan {name}")
    mesh = read_mesh(path, units=sidecar.units)
    vertices, faces = mesh.vertices_mm, mesh.faces
    if variant.remake is not None:
        vertices, faces = variant.remake(vertices, faces)
    vertices = _apply(variant.motion, vertices) / MM_PER_UNIT[variant.units]
    if variant.mirrors:
        faces = faces[:, ::-1]
    digits = 6 + round(np.log10(MM_PER_UNIT[variant.units]))
    stem = f"sub-{subject.id}_acq-{name}"
    lines = ["v " + " ".join(f"{x:.{digits}f}" for x in row) for row in vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in row) for row in faces.tolist()]
    (folder / f"{stem}_scan.obj").write_text("\n".join(lines) + "\n", "ascii")
    extra = sidecar.model_extra or {}
    entries = {key: extra[key] for key in ("RegisteredTo",) if key in extra}
    entries |= {"Units": variant.units, "FlexionAngle": sidecar.flexion_angle, "Side": side}
    kept = {key: value for key, value in entries.items() if value is not None}
    (folder / f"{stem}_scan.json").write_text(json.dumps(kept), "utf-8")


def _write_nodes(subject: Subject, name: str, variant: Variant, folder: Path) -> None:
    table = subject.nodes(name)
    moved = _apply(variant.motion, table.xyz_mm)
    lines = ["row\tcol\tx_mm\ty_mm\tz_mm\tsd_mm\tstatus"]
    for k in range(len(table)):
        place = "\t".join("n/a" if np.isnan(x) else f"{x:.6f}" for x in moved[k])
        lines.append(
            f"{table.row[k]}\t{table.col[k]}\t{place}\t{table.sd_mm[k]:.6g}\t{table.status[k]}"
        )
    stem = f"sub-{subject.id}_acq-{name}"
    (folder / f"{stem}_nodes.tsv").write_text("\n".join(lines) + "\n", "utf-8")
