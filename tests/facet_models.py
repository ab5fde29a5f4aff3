"""Independent meshes of the periodic cell's facet, and CalculiX decks of them."""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True, eq=False)
class FacetModel:
    """A meshed facet with the periodic cell's supports.

    points (n, 2) mm, elements (m, 6 or 8), equation and pattern as the systems take them,
    top and right: nodes of these ligaments.
    """

    points: np.ndarray
    elements: np.ndarray
    equation: np.ndarray
    pattern: np.ndarray
    top: np.ndarray
    right: np.ndarray
    left: np.ndarray
    bottom: np.ndarray


def supported(points: np.ndarray, elements: np.ndarray, a: float, b: float) -> FacetModel:
    """Supports of the facet in [0, 5] x [0, 5] mm: mirror lines, the right one free to move."""
    half, near = 5.0, 1e-9
    x, y = points.T
    bottom = np.flatnonzero((y < near) & (x >= a * half - near))
    top = np.flatnonzero((y > half - near) & (x <= (1 - a) * half + near))
    left = np.flatnonzero((x < near) & (y <= (1 - b) * half + near))
    right = np.flatnonzero((x > half - near) & (y >= b * half - near))
    equation = np.zeros(points.shape, dtype=np.int64)
    equation[bottom, 1] = equation[top, 1] = equation[left, 0] = -1
    equation[right, 0] = -2
    free = equation == 0
    equation[free] = np.arange(free.sum())
    equation[equation == -2] = free.sum()
    pattern = np.zeros_like(points)
    pattern[top, 1] = half
    return FacetModel(points, elements, equation, pattern, top, right, left, bottom)


def uniform_triangles(count: int, a: float, b: float) -> FacetModel:
    """``count`` x ``count`` squares of two six-node triangles; no grading, no quarter points."""
    ticks = np.linspace(0, 5, 2 * count + 1)
    x, y = np.meshgrid(ticks, ticks)
    points = np.column_stack([x.ravel(), y.ravel()])
    wide = 2 * count + 1
    base = (2 * wide * np.arange(count)[:, None] + 2 * np.arange(count)[None, :]).ravel()[:, None]
    one = base + np.array([0, 2, 2 * wide + 2, 1, wide + 2, wide + 1])
    two = base + np.array([0, 2 * wide + 2, 2 * wide, wide + 1, 2 * wide + 1, wide])
    return supported(points, np.concatenate([one, two]), a, b)


def uniform_quads(count: int, a: float, b: float) -> FacetModel:
    """``count`` x ``count`` eight-node quads."""
    wide = 2 * count + 1
    ticks = np.linspace(0, 5, wide)
    x, y = np.meshgrid(ticks, ticks)
    points = np.column_stack([x.ravel(), y.ravel()])
    base = (2 * wide * np.arange(count)[:, None] + 2 * np.arange(count)[None, :]).ravel()[:, None]
    quads = base + np.array([0, 2, 2 * wide + 2, 2 * wide, 1, wide + 2, 2 * wide + 1, wide])
    used, flat = np.unique(quads, return_inverse=True)
    return supported(points[used], flat.reshape(quads.shape), a, b)


@dataclass(frozen=True, eq=False)
class CalculixResult:
    """Stretches and nominal stress at each increment, and the processor time of the run."""

    longitudinal_stretch: np.ndarray
    lateral_stretch: np.ndarray
    nominal_stress_mpa: np.ndarray
    cpu_seconds: float


def run_calculix(
    model: FacetModel,
    folder: Path,
    *,
    largest_strain: float,
    steps: int,
    mu_mpa: float = 0.207,
    bulk_over_mu: float = 100.0,
    thickness_mm: float = 0.01,
) -> CalculixResult:
    """Write the deck, run ``ccx`` on one thread and read what it prints."""
    kind = {6: "CPS6", 8: "CPS8R"}[model.elements.shape[1]]
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i + 1},{x:.12g},{y:.12g},0." for i, (x, y) in enumerate(model.points)]
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=EALL"]
    lines += [
        f"{e + 1}," + ",".join(str(n + 1) for n in row) for e, row in enumerate(model.elements)
    ]
    for name in ("top", "right", "left", "bottom"):
        nodes = getattr(model, name) + 1
        lines += [f"*NSET, NSET={name.upper()}"]
        lines += [",".join(map(str, nodes[k : k + 12])) + "," for k in range(0, len(nodes), 12)]
    master = int(model.right[0]) + 1
    lines += ["*NSET, NSET=MASTER", f"{master},"]
    for node in model.right[1:] + 1:
        lines += ["*EQUATION", "2", f"{node},1,1.,{master},1,-1."]
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
        "*STEP, NLGEOM, INC=2000",
        "*STATIC",
        f"{1 / steps:.6g},1.,1e-6,{1 / steps:.6g}",
        "*BOUNDARY",
        f"TOP,2,2,{5 * largest_strain:.12g}",
        "*NODE PRINT, NSET=MASTER",
        "U",
        "*NODE PRINT, NSET=TOP",
        "U, RF",
        "*END STEP",
    ]
    (folder / "cell.inp").write_text("\n".join(lines) + "\n")
    ran = subprocess.run(
        ["bash", "-c", "export OMP_NUM_THREADS=1; time -p ccx cell > cell.out"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    spent = sum(float(part) for part in re.findall(r"^(?:user|sys) ([\d.]+)", ran.stderr, re.M))
    text = (folder / "cell.dat").read_text()
    heights, widths, forces = [], [], []
    for title, body in re.findall(r"^ (\S[^\n]*time[^\n]*)\n\n((?:\s+\d+[^\n]*\n)+)", text, re.M):
        rows = np.array([[float(v) for v in line.split()] for line in body.splitlines()])
        if "MASTER" in title:
            widths.append(1 + rows[0, 1] / 5)
        elif "displacements" in title:
            heights.append(1 + rows[0, 2] / 5)
        else:
            forces.append(rows[:, 2].sum() / (5 * thickness_mm))
    return CalculixResult(np.array(heights), np.array(widths), np.array(forces), spent)
