"""The quarter of a tensile sheet in CalculiX, on the same six-node triangles."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kiribench.fem.gauge import cell_stretches, site_positions
from kiribench.fem.mesh import SheetMesh


@dataclass(frozen=True, eq=False)
class PulledSheet:
    """Stretches of the middle cells and nominal stress at each increment."""

    displacement_mm: np.ndarray
    longitudinal_stretch: np.ndarray
    lateral_stretch: np.ndarray
    nominal_stress_mpa: np.ndarray


def pull_in_calculix(
    mesh: SheetMesh,
    folder: Path,
    *,
    displacement_mm: float,
    steps: int,
    cell_mm: float = 10.0,
    mu_mpa: float = 0.207,
    bulk_over_mu: float = 500.0,
    thickness_mm: float = 0.01,
) -> PulledSheet:
    """Write the deck, run ``ccx`` on one thread and read the displacements of all nodes.

    The supports are written out here, not taken from ``quarter_equations``.
    """
    x, y = mesh.points_mm.T
    held = np.flatnonzero(y > y.max() - 1e-9)
    sets = {
        "TOP": held,
        "LEFT": mesh.boundary_nodes("left", ligaments_only=True),
        "BOTTOM": mesh.boundary_nodes("bottom", ligaments_only=True),
    }
    sets["LEFT"] = np.setdiff1d(sets["LEFT"], held)
    triangles = mesh.triangles()
    one, two = (mesh.points_mm[triangles[:, k]] - mesh.points_mm[triangles[:, 0]] for k in (1, 2))
    clockwise = one[:, 0] * two[:, 1] < one[:, 1] * two[:, 0]
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1, 5, 4, 3]]
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i + 1},{p:.12g},{q:.12g},0." for i, (p, q) in enumerate(zip(x, y, strict=True))]
    lines += ["*ELEMENT, TYPE=CPS6, ELSET=EALL"]
    lines += [f"{e + 1}," + ",".join(str(n + 1) for n in row) for e, row in enumerate(triangles)]
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}"]
        lines += [",".join(map(str, nodes[k : k + 12] + 1)) + "," for k in range(0, len(nodes), 12)]
    c10, d1 = mu_mpa / 2, 2 / (bulk_over_mu * mu_mpa)
    lines += [
        "*MATERIAL, NAME=RUBBER",
        "*HYPERELASTIC, NEO HOOKE",
        f"{c10:.10g},{d1:.10g}",
        "*SOLID SECTION, ELSET=EALL, MATERIAL=RUBBER",
        f"{thickness_mm:g}",
        "*BOUNDARY",
        "BOTTOM,2,2,0.",
        "LEFT,1,1,0.",
        "TOP,1,1,0.",
        "*STEP, NLGEOM, INC=2000",
        "*STATIC",
        f"{1 / steps:.6g},1.,1e-6,{1 / steps:.6g}",
        "*BOUNDARY",
        f"TOP,2,2,{displacement_mm / 2:.12g}",
        "*NODE PRINT, NSET=NALL",
        "U",
        "*NODE PRINT, NSET=TOP",
        "RF",
        "*END STEP",
    ]
    (folder / "sheet.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(
        ["bash", "-c", "export OMP_NUM_THREADS=1; ccx sheet > sheet.out"], cwd=folder, check=True
    )
    text = (folder / "sheet.dat").read_text()
    pulled, along, across, stress = [], [], [], []
    for title, body in re.findall(r"^ (\S[^\n]*time[^\n]*)\n\n((?:\s+\d+[^\n]*\n)+)", text, re.M):
        rows = np.array([[float(v) for v in line.split()] for line in body.splitlines()])
        if "displacements" in title:
            place = mesh.points_mm.copy()
            place[rows[:, 0].astype(int) - 1] += rows[:, 1:3]
            corners = site_positions(mesh, place)[:3:2, :3:2]
            corners[:, 0, 0] = corners[0, :, 1] = 0.0
            gauge = cell_stretches(corners, cell_mm)
            pulled.append(2 * float(place[held[0], 1] - y[held[0]]))
            along.append(float(gauge.longitudinal.mean()))
            across.append(float(gauge.lateral.mean()))
        else:
            stress.append(rows[:, 2].sum() / (x.max() * thickness_mm))
    return PulledSheet(*map(np.array, (pulled, along, across, stress)))
