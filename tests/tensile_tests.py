"""Rendered tensile tests of simulated and of mapped sheets, for the tests of ``tensile``.

Run as a script it renders the example of ``data/synthetic/tensile`` anew:
``.venv/bin/python tests/tensile_tests.py data/synthetic/tensile``.
"""

from __future__ import annotations

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np

from kiribench.fem.facet import MeshSpec
from kiribench.fem.sheet_motion import SheetSteps, follow_sheet
from kiribench.lattice import CutMap
from kiribench.synthetic.tensile_camera import Camera
from kiribench.synthetic.tensile_folder import Pulled, write_tensile_folder
from kiribench.synthetic.tensile_frames import Look, SheetMotion
from kiribench.synthetic.tensile_pattern import Speckle

CELL_MM = 10.0
GRIP_MM = 10.0
ROWS, COLUMNS = 8, 4
COARSE = MeshSpec(1.0, 1.0, 0.6)
THICKNESS_MM = 2.0


@lru_cache(maxsize=4)
def pulled_sheet(a: float, b: float, displacements_mm: tuple[float, ...]) -> SheetSteps:
    """A small sheet of uniform cuts, pulled."""
    return sheet_of(CutMap.uniform(a, b, ROWS, COLUMNS, CELL_MM), displacements_mm)


def sheet_of(
    cut_map: CutMap, displacements_mm: tuple[float, ...], mesh: MeshSpec = COARSE
) -> SheetSteps:
    return follow_sheet(cut_map, displacements_mm, grip_mm=GRIP_MM, mesh=mesh)


def pulled_of(
    steps: SheetSteps,
    displacements_mm: tuple[float, ...],
    which: tuple[int, ...],
    *,
    first: tuple[int, int] = (2, 1),
    shape: tuple[int, int] = (4, 2),
    middle: float = 0.5,
) -> Pulled:
    """Steps ``which`` of a sheet, and a block of its cells; the picture moves with the middle."""
    shift = [np.array([0.0, middle * displacements_mm[k]]) for k in which]
    motions = [
        SheetMotion(steps.rest_mm, steps.place_mm[k] - move, steps.triangles)
        for k, move in zip(which, shift, strict=True)
    ]
    r, c = first
    corner = np.array(
        [
            steps.corner_mm[k][r : r + shape[0] + 1, c : c + shape[1] + 1] - move
            for k, move in zip(which, shift, strict=True)
        ]
    )
    way = np.array([displacements_mm[k] for k in which])
    force = THICKNESS_MM * steps.force_n_per_mm[list(which)]
    return Pulled(motions, corner, way, force, 5.0 * np.arange(len(which)))


def speckle(seed: int = 3, grain_mm: float = 0.55) -> Speckle:
    """Speckle over the whole small sheet."""
    return Speckle.over((-2.0, -2.0), (42.0, 102.0), grain_mm=grain_mm, seed=seed)


def sheet_camera(**changes: object) -> Camera:
    """A camera on the middle of the small sheet."""
    given = {"width_px": 350, "height_px": 640, "px_per_mm": 7.0, "centre_mm": (20.0, 50.0)}
    return Camera(**{**given, **changes})  # type: ignore[arg-type]


EXAMPLE_MM = (0.0, 4.0, 9.0, 15.0, 22.0, 30.0, 40.0)


def write_example(folder: Path) -> Path:
    """The folder that is shipped: cuts of 80 %, with the machine's table.

    On the mesh that a comparison simulates on: a coarser one is off by .011 in Poisson's ratio.
    """
    cut_map = CutMap.uniform(0.8, 0.8, ROWS, COLUMNS, CELL_MM)
    pulled = pulled_of(sheet_of(cut_map, EXAMPLE_MM, MeshSpec()), EXAMPLE_MM, tuple(range(7)))
    look = Look(blur_px=0.6, noise=1.5, slope=(0.15, -0.1), vignette=0.1)
    sidecar = {
        "marker": "speckle",
        "cut": True,
        "cells": {"pitch_mm": CELL_MM},
        "Specimen": {"GripMm": GRIP_MM, "Ends": "held", "MuMpa": 0.207, "Row": 2, "Column": 1},
        "specimen": {
            "a_percent": 80,
            "b_percent": 80,
            "cell_mm": CELL_MM,
            "rows": ROWS,
            "columns": COLUMNS,
            "thickness_mm": THICKNESS_MM,
        },
    }
    return write_tensile_folder(folder, pulled, sheet_camera(), speckle(), look, sidecar, seed=11)


if __name__ == "__main__":
    write_example(Path(sys.argv[1]))
