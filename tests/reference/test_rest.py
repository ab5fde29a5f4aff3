"""Skin that is not flat at 0 degrees: laid by a rest map, or refused, from the command on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from elbow import elbow_design
from small_limb import ELBOW, write_elbow_dataset, write_nodes

from kiribench.cli import main
from kiribench.dataset import Dataset
from kiribench.design.skin import skin_of
from kiribench.fem.wear_skin import flatness
from kiribench.schema.patch_design import write_design


def _bowl(folder: Path, depth_mm: float) -> Path:
    """The elbow, whose 0-degree skin has a round hollow in its middle."""
    root = write_elbow_dataset(folder)
    nodes = ELBOW.nodes("flex000")
    row, column = (
        np.indices(nodes.shape[:2]) - np.array([ELBOW.rows, ELBOW.columns])[:, None, None] / 2
    )
    square = (row**2 + column**2) * ELBOW.pitch_mm**2
    nodes[..., 1] -= depth_mm * np.exp(-square / (2 * 14.0**2))
    write_nodes(root / "sub-E1" / "surf" / "sub-E1_acq-flex000_nodes.tsv", nodes)
    return root


def _check(root: Path, folder: Path, *tokens: str) -> int:
    table = write_design(folder / "design", elbow_design(0.6, 0.6))
    return main(
        ["check", str(table), "--subject", str(root), "--elements-per-facet", "6", "--samples",
         "100", "--no-uniform", "--no-placement", "--quiet", *tokens]
    )  # fmt: skip


def test_a_bowl_is_laid_by_a_rest_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = _bowl(tmp_path / "data", 15.0)
    skin = skin_of(Dataset.open(root).subject("E1"))
    rest = skin.rest
    assert rest is not None
    assert not rest.flatness.flat
    curvature = rest.flatness.gauss_curvature
    assert np.unravel_index(curvature.argmax(), curvature.shape) == (2, 1)
    assert _check(root, tmp_path, "--out", str(tmp_path / "out")) == 0
    out = capsys.readouterr().out
    assert "The skin at 0 degrees is not flat" in out
    said = json.loads((tmp_path / "out" / "check.json").read_text())["designs"][0]["rest"]
    assert said["largest_strain"] == pytest.approx(rest.largest_strain, rel=1e-9)
    assert said["mismatch"] > 0.03
    assert (
        "laid on it with the least strain" in (tmp_path / "out" / "sub-E1_check.html").read_text()
    )
    # What sticks lies where it was laid: by the map, not by the grid.
    assert _check(root, tmp_path, "--friction", "stick", "--json") == 0
    stuck = json.loads(capsys.readouterr().out)["designs"][0]
    assert stuck["share"]["iou"]["mean"] < 0.99


def test_a_tube_needs_none(tmp_path: Path) -> None:
    skin = skin_of(Dataset.open(write_elbow_dataset(tmp_path / "data")).subject("E1"))
    assert skin.rest_nodes_mm is not None
    assert flatness(skin.rest_nodes_mm, 10.0).flat
    assert skin.rest is None


def test_a_deep_bowl_is_refused_with_its_curvature(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = _bowl(tmp_path / "data", 32.0)
    assert _check(root, tmp_path) == 3
    err = capsys.readouterr().err
    assert "skin-not-flat" in err
    assert "Gauss curvature under the patch is" in err
