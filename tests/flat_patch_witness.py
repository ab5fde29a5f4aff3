"""The mesh of a worn patch on a stretched plane as a CalculiX deck: CPS8R on the same nodes."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kiribench.fem.wear_mesh import PatchMesh


@dataclass(frozen=True, eq=False)
class Witness:
    """Deformed nodes (U, 2) mm, NaN at the centres of elements, which CPS8R lacks."""

    x_mm: np.ndarray
    cpu_seconds: float


def pull_patch(
    mesh: PatchMesh,
    folder: Path,
    *,
    stretch: float,
    steps: int,
    mu_mpa: float = 0.207,
    bulk_over_mu: float = 100.0,
    thickness_mm: float = 0.01,
) -> Witness:
    """Hold the proximal edge, move the distal one along; one thread."""
    if mesh.template.order != 2:
        raise ValueError("CPS8R needs nine-node quads")
    around = np.array([0, 2, 8, 6, 1, 5, 7, 3])
    quads = mesh.nodes[:, mesh.template.elements[:, around]]
    # A facet's mirror image is walked the other way round.
    backwards = np.array([0, 3, 2, 1, 7, 6, 5, 4])
    quads[mesh.mirrored] = quads[mesh.mirrored][..., backwards]
    used, flat = np.unique(quads, return_inverse=True)
    elements = flat.reshape(-1, 8) + 1
    points = mesh.points_mm[used]
    length = mesh.cut_map.size_mm[1]
    held = np.flatnonzero(points[:, 1] < 1e-9) + 1
    moved = np.flatnonzero(points[:, 1] > length - 1e-9) + 1
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i + 1},{x:.14g},{y:.14g},0." for i, (x, y) in enumerate(points)]
    lines += ["*ELEMENT, TYPE=CPS8R, ELSET=EALL"]
    lines += [f"{e + 1}," + ",".join(map(str, row)) for e, row in enumerate(elements)]
    for name, nodes in (("HELD", held), ("MOVED", moved)):
        lines += [f"*NSET, NSET={name}"]
        lines += [",".join(map(str, nodes[k : k + 12])) + "," for k in range(0, len(nodes), 12)]
    lines += [
        "*MATERIAL, NAME=RUBBER",
        "*HYPERELASTIC, NEO HOOKE",
        f"{mu_mpa / 2:.10g},{2 / (bulk_over_mu * mu_mpa):.10g}",
        "*SOLID SECTION, ELSET=EALL, MATERIAL=RUBBER",
        f"{thickness_mm:g}",
        "*BOUNDARY",
        "HELD,1,2,0.",
        "MOVED,1,1,0.",
        "*STEP, NLGEOM, INC=2000",
        "*STATIC",
        f"{1 / steps:.6g},1.,1e-6,{1 / steps:.6g}",
        "*BOUNDARY",
        f"MOVED,2,2,{length * (stretch - 1):.12g}",
        "*NODE PRINT, NSET=NALL, FREQUENCY=1000",
        "U",
        "*END STEP",
    ]
    (folder / "patch.inp").write_text("\n".join(lines) + "\n")
    ran = subprocess.run(
        ["bash", "-c", "export OMP_NUM_THREADS=1; time -p ccx patch > patch.out"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    spent = sum(float(part) for part in re.findall(r"^(?:user|sys) ([\d.]+)", ran.stderr, re.M))
    text = (folder / "patch.dat").read_text()
    block = re.findall(r"displacements[^\n]*\n\n((?:\s+\d+[^\n]*\n)+)", text)[-1]
    rows = np.array([[float(v) for v in line.split()] for line in block.splitlines()])
    x = np.full(mesh.points_mm.shape, np.nan)
    x[used[rows[:, 0].astype(np.int64) - 1]] = (
        points[rows[:, 0].astype(np.int64) - 1] + rows[:, 1:3]
    )
    return Witness(x, spent)
