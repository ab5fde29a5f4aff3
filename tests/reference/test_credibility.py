"""Predicted against worn where the mismatch is known: the worn scan was made by another solver.

A tube is a plane rolled up, so a frictionless patch on it lies where it would lie in the plane.
The plane's answer comes from other elements and another solver (six-node triangles of the flat
patch; CalculiX), is rolled onto the tube and written as the scan and the nodes of a worn patch.
``conform`` reads these files; ``check`` never sees them.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flat_patch_witness import pull_patch
from small_limb import Limb, write_dataset, write_nodes
from tolerances import CREDIBLE_OVERLAP, CREDIBLE_RATIO

from kiribench.cli import main
from kiribench.fem.facet import MeshSpec
from kiribench.fem.patch import simulate_patch
from kiribench.fem.wear_measures import site_means
from kiribench.fem.wear_mesh import mesh_patch
from kiribench.lattice import CutMap
from kiribench.schema.patch_design import PatchDesign, write_design

STRETCH = 1.3
CELL = 15.0
ROWS, COLUMNS = 6, 4


@dataclass(frozen=True)
class Tube(Limb):
    """A straight limb whose flexed skin is stretched along, and not across."""

    def surface(self, s: np.ndarray, t: np.ndarray, pose: str) -> np.ndarray:
        return super().surface(s if pose == "flex000" else STRETCH * s, t, "flex000")


TUBE = Tube(rows=10, columns=8, patch_rows=ROWS, patch_columns=COLUMNS, radius_mm=60.0)


def _cuts() -> CutMap:
    """A soft half and a stiff half: cells in between are carried off their places."""
    a, b = np.random.default_rng(2).uniform(0.6, 0.85, (2, ROWS, COLUMNS))
    a[ROWS // 2 :] -= 0.4
    return CutMap(a, b, CELL)


def _triangles(cut_map: CutMap, folder: Path) -> np.ndarray:
    ends = np.linspace(0, (STRETCH - 1) * ROWS * CELL, 4)[1:]
    return np.asarray(simulate_patch(cut_map, ends, mesh=MeshSpec()).site_mm[-1][::2, ::2])


def _calculix(cut_map: CutMap, folder: Path) -> np.ndarray:
    mesh = mesh_patch(cut_map, 10, 2)
    witness = pull_patch(mesh, folder, stretch=STRETCH, steps=5)
    return site_means(mesh, witness.x_mm)[::2, ::2]


@pytest.mark.parametrize(
    "solver",
    [
        _triangles,
        pytest.param(
            _calculix,
            marks=[
                pytest.mark.slow,
                pytest.mark.calculix,
                pytest.mark.skipif(shutil.which("ccx") is None, reason="needs calculix-ccx"),
            ],
        ),
    ],
)
def test_predicted_and_worn_agree_where_the_worn_patch_is_a_solution(
    solver: Callable[[CutMap, Path], np.ndarray],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cut_map = _cuts()
    corners = solver(cut_map, tmp_path)
    root = write_dataset(tmp_path / "data", TUBE, ("T1",))
    about = {
        "Name": "a tube",
        "Grid": {"Rows": TUBE.rows, "Columns": TUBE.columns, "PitchMm": CELL},
        "Patch": {"Rows": ROWS, "Columns": COLUMNS},
        "Regions": [["all"] * COLUMNS] * ROWS,
    }
    (root / "dataset_description.json").write_text(json.dumps(about))
    across, along = np.moveaxis(corners, -1, 0)
    middle = np.array([COLUMNS, STRETCH * ROWS]) * CELL / 2
    rolled = TUBE.surface((along - middle[1]) / STRETCH, across - middle[0], "flex090")
    write_nodes(root / "sub-T1" / "surf" / "sub-T1_acq-flex090worn_nodes.tsv", rolled)
    design = PatchDesign(
        participant="T1", method="given", side="right", cell_mm=CELL, thickness_mm=2.0,
        strain_measure="log", a=cut_map.a, b=cut_map.b,
        region=np.full((ROWS, COLUMNS), "all"), reason=np.full((ROWS, COLUMNS), ""),
    )  # fmt: skip
    table = write_design(tmp_path / "design", design)

    def said(*tokens: object) -> dict[str, Any]:
        capsys.readouterr()
        assert main([*(str(token) for token in tokens), "--json", "--quiet"]) == 0
        return dict(json.loads(capsys.readouterr().out))

    quick = ("--samples", "100")
    worn = said("conform", root, *quick)["participants"][0]
    checked = said("check", table, "--subject", root, "--no-uniform", "--no-placement", *quick)
    predicted = checked["designs"][0]
    # The design is a mixed one: a constant answer could not agree.
    assert 0.3 < worn["satisfactory"] < 0.95
    assert worn["good"] > 0
    assert abs(predicted["satisfactory"] - worn["satisfactory"]) <= CREDIBLE_RATIO
    # The report says so.
    beside = checked["against_worn"]
    assert beside["worn_satisfactory"] == worn["satisfactory"]
    assert abs(beside["designs"][0]["points"]) <= 100 * CREDIBLE_RATIO
    assert "(within 5)" in checked["worn_scan"]
    for name in ("overlap_paper", "overlap_strict", "overlap_iou"):
        ours, theirs = ([cell[name] for cell in one["table"]] for one in (predicted, worn))
        np.testing.assert_allclose(ours, theirs, atol=CREDIBLE_OVERLAP)
    # Another design is not taken for this one.
    other = write_design(tmp_path / "other", replace(design, a=cut_map.a[::-1], b=cut_map.b[::-1]))
    mistaken = said(
        "check", other, "--subject", root, "--no-uniform", "--no-placement", *quick
    )["designs"][0]  # fmt: skip
    apart = [
        abs(one["overlap_paper"] - two["overlap_paper"])
        for one, two in zip(mistaken["table"], worn["table"], strict=True)
    ]
    assert max(apart) > 10 * CREDIBLE_OVERLAP
