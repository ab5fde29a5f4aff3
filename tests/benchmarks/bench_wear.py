"""The worn patch against CalculiX on the same flat mesh; its cost on a knee, and how it grows.

Run as a script: ``python tests/benchmarks/bench_wear.py [--repeats 3] [--growth]
[--convergence]``. Ours and CalculiX (CPS8R on the same nodes) take turns on one thread; medians of
processor time are compared. Exit code 1 where a bound is missed: 5 times less than CalculiX; one
check of 12 x 6 cells at 10 divisions a facet edge on a knee in 5 CPU s.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from curved_skins import knee  # noqa: E402
from flat_patch_witness import pull_patch  # noqa: E402

from kiribench.fem.gauge import cell_stretches  # noqa: E402
from kiribench.fem.surface_map import Cylinder, Plane  # noqa: E402
from kiribench.fem.wear import WearSpec, wear_patch, wear_sensitivities  # noqa: E402
from kiribench.fem.wear_measures import site_means  # noqa: E402
from kiribench.fem.wear_mesh import mesh_patch  # noqa: E402
from kiribench.lattice import CutMap  # noqa: E402

STRETCH = 1.3


def random_map(rows: int, columns: int, seed: int = 0) -> CutMap:
    a, b = np.random.default_rng(seed).uniform(0.3, 0.85, (2, rows, columns))
    return CutMap(a, b, 15.0)


def against_calculix(repeats: int) -> bool:
    """Same nodes; CalculiX in as few steps as it takes (it cuts them back where it must)."""
    print(f"CalculiX CPS8R, flat patch to a strain of {STRETCH - 1:.1f}, one thread")
    passed = True
    for rows, columns, count in ((3, 2, 10), (6, 4, 10), (12, 6, 6)):
        cut_map = random_map(rows, columns)
        plane = Plane(1.0, STRETCH)
        spec = WearSpec(count)
        mesh = mesh_patch(cut_map, count, 2)
        worn = wear_patch(cut_map, plane, (0.0, 0.0), spec)
        ours, theirs = [], []
        difference = 0.0
        for _ in range(repeats):
            worn = wear_patch(cut_map, plane, (0.0, 0.0), spec)
            ours.append(worn.cpu_seconds)
            with tempfile.TemporaryDirectory() as folder:
                witness = pull_patch(mesh, Path(folder), stretch=STRETCH, steps=3)
            theirs.append(witness.cpu_seconds)
            cells = cell_stretches(site_means(mesh, witness.x_mm)[::2, ::2], 15.0)
            difference = max(
                np.abs(cells.longitudinal - worn.longitudinal_stretch).max(),
                np.abs(cells.lateral - worn.lateral_stretch).max(),
            )
        ratio = float(np.median(theirs) / np.median(ours))
        good = ratio >= 5 and difference < 0.005
        passed &= good
        print(
            f"  {rows} x {columns} cells {2 * len(mesh.points_mm):6d} dof  ours "
            f"{np.median(ours):6.3f} s  ccx {np.median(theirs):6.2f} s  ratio {ratio:5.1f} (>= 5)  "
            f"strain difference {difference:.4f} (< .005)  {'ok' if good else 'MISSED'}"
        )
    return passed


def on_a_knee(repeats: int) -> bool:
    """Random designs on the shipped knees: one check, and the derivatives."""
    spent, derivatives, iterations = [], [], []
    wear_sensitivities(random_map(12, 6), knee("S1"), (45.0, 30.0))
    for seed in range(repeats):
        for participant in ("S1", "S2", "S3"):
            found = wear_sensitivities(random_map(12, 6, seed), knee(participant), (45.0, 30.0))
            spent.append(found.worn.cpu_seconds)
            derivatives.append(found.cpu_seconds)
            iterations.append(found.worn.newton_iterations)
    good = float(np.median(spent)) < 5
    print(
        f"12 x 6 cells on knees, 10 divisions: check {np.median(spent):.2f} CPU s, at most "
        f"{np.max(spent):.2f} (< 5), {min(iterations)}-{max(iterations)} iterations; "
        f"derivatives {np.median(derivatives):.2f} CPU s  {'ok' if good else 'MISSED'}"
    )
    return good


def growth() -> None:
    """Cost per Newton iteration as cells and mesh grow, with the fitted exponents."""
    skin = Cylinder(60.0, 1.05, 1.3)
    print("growth: CPU s per Newton iteration on a cylinder, set-up and report included")
    for title, cases in (
        ("cells", [(6, 3, 10), (12, 6, 10), (18, 9, 10), (24, 12, 10)]),
        ("divisions", [(6, 3, 8), (6, 3, 12), (6, 3, 16), (6, 3, 24)]),
    ):
        sizes, spent = [], []
        for rows, columns, count in cases:
            cut_map = random_map(rows, columns)
            wear_patch(cut_map, skin, (0.0, 0.0), WearSpec(count))
            began = time.process_time()
            worn = wear_patch(cut_map, skin, (0.0, 0.0), WearSpec(count))
            cost = (time.process_time() - began) / worn.newton_iterations
            sizes.append(rows * columns if title == "cells" else count)
            spent.append(cost)
            print(f"  {rows:3d} x {columns:2d} cells {count:3d} divisions {cost:7.3f}")
        print(f"  exponent with {title} {np.polyfit(np.log(sizes), np.log(spent), 1)[0]:.2f}")


def convergence() -> None:
    """Corners and stretches on knees against the finest mesh."""
    print("mesh: largest (root mean square) difference from 24 divisions")
    for title, cut_map in (
        ("uniform .8", CutMap.uniform(0.8, 0.8, 12, 6, 15.0)),
        ("random .3-.85", random_map(12, 6)),
    ):
        skin = knee("S2")
        fine = wear_patch(cut_map, skin, (45.0, 30.0), WearSpec(24))
        for count in (8, 10, 12, 16):
            worn = wear_patch(cut_map, skin, (45.0, 30.0), WearSpec(count))
            corner = np.linalg.norm(worn.corner_q_mm - fine.corner_q_mm, axis=2)
            strain = np.concatenate(
                [
                    worn.longitudinal_stretch - fine.longitudinal_stretch,
                    worn.lateral_stretch - fine.lateral_stretch,
                ]
            )
            print(
                f"  {title:14s} {count:3d} divisions: corners {corner.max():.3f} "
                f"({np.sqrt(np.mean(corner**2)):.3f}) mm, strains {np.abs(strain).max():.4f} "
                f"({np.sqrt(np.mean(strain**2)):.4f}), energy "
                f"{worn.energy_mj / fine.energy_mj - 1:+.2%}, {worn.cpu_seconds:.1f} CPU s"
            )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--growth", action="store_true", help="also the growth exponents")
    parser.add_argument("--convergence", action="store_true", help="also the mesh error")
    options = parser.parse_args()
    passed = against_calculix(options.repeats)
    passed &= on_a_knee(options.repeats)
    if options.growth:
        growth()
    if options.convergence:
        convergence()
    return 0 if passed else 1


if __name__ == "__main__":
    raise SystemExit(main())
