"""Overlaps on curved surfaces: against closed forms, and against clipping on the mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from curved_surfaces import (
    cell,
    cylinder_map,
    flat_overlap,
    grid_uv,
    nodes_on,
    patch_mesh,
    sphere_map,
    spherical_overlap,
    three_overlaps,
)
from mesh_clipping import mesh_overlap
from scored_knees import SYNTHETIC, scored_knee
from tolerances import OVERLAP, SECOND_METHOD

from kiribench.cli import main
from kiribench.conformability.cells import CellScores, score_cells
from kiribench.conformability.outlines import flat_outlines
from kiribench.conformability.result import Conformability
from kiribench.conformability.score import ScoreOptions, patch_on_skin, score_subject
from kiribench.dataset import Dataset
from kiribench.surface.cells import grid_sides
from kiribench.surface.mesh import Mesh
from kiribench.surface.topology import topology

SURFACES = {
    "sphere 25": (sphere_map(25.0), 25.0),
    "sphere 40": (sphere_map(40.0), 40.0),
    "sphere 60": (sphere_map(60.0), 60.0),
    "cylinder 25": (cylinder_map(25.0), 25.0),
    "cylinder 57": (cylinder_map(57.0), 57.0),
}


def worn_uv(seed: int) -> np.ndarray:
    """Patch corners on the drawing plane: shifted, sheared, stretched, and each off a little."""
    grid = grid_uv(3, 3)
    affine = np.array([[0.92, 0.10], [-0.05, 1.06]])
    noise = np.random.default_rng(seed).normal(size=grid.shape)
    return grid @ affine.T + np.array([1.0, -0.7]) + 0.8 * noise


def scored(mesh: Mesh, skin: np.ndarray, patch: np.ndarray) -> CellScores:
    outlines = flat_outlines(mesh, nodes_on(mesh, skin), nodes_on(mesh, patch), topology(mesh))
    return score_cells(outlines, np.full((3, 3), "", dtype="<U32"), "paper", "global")


def overlaps_of(scores: CellScores) -> np.ndarray:
    o = scores.overlap
    return np.stack([o.paper, o.strict, o.iou], axis=-1)


def truth(name: str, patch_uv: np.ndarray) -> np.ndarray:
    """(3, 3, 3) closed-form (paper, strict, iou) of every cell."""
    surface, radius = SURFACES[name]
    skin_uv = grid_uv(3, 3)
    out = np.empty((3, 3, 3))
    for r in range(3):
        for c in range(3):
            if name.startswith("sphere"):
                areas = spherical_overlap(
                    cell(surface(skin_uv) / radius, r, c), cell(surface(patch_uv) / radius, r, c)
                )
            else:
                areas = flat_overlap(cell(skin_uv, r, c), cell(patch_uv, r, c))
            out[r, c] = three_overlaps(areas)
    return out


@pytest.mark.parametrize("name", list(SURFACES))
@pytest.mark.parametrize("seed", [1, 2])
def test_overlap_agrees_with_the_closed_form(name: str, seed: int) -> None:
    surface, _ = SURFACES[name]
    mesh = patch_mesh(surface, (33.0, 33.0), 0.8)
    patch_uv = worn_uv(seed)
    found = overlaps_of(scored(mesh, surface(grid_uv(3, 3)), surface(patch_uv)))
    np.testing.assert_allclose(found, truth(name, patch_uv), atol=OVERLAP)


@pytest.mark.parametrize("name", ["sphere 25", "sphere 60", "cylinder 25"])
def test_overlap_agrees_with_clipping_on_the_mesh(name: str) -> None:
    surface, _ = SURFACES[name]
    mesh = patch_mesh(surface, (33.0, 33.0), 1.0)
    skin, patch = nodes_on(mesh, surface(grid_uv(3, 3))), nodes_on(mesh, surface(worn_uv(3)))
    table = topology(mesh)
    found = overlaps_of(scored(mesh, skin.positions_mm, patch.positions_mm))
    sides = grid_sides(mesh, skin, table), grid_sides(mesh, patch, table)
    clipped = np.array(
        [[three_overlaps(mesh_overlap(mesh, *sides, r, c)) for c in range(3)] for r in range(3)]
    )
    np.testing.assert_allclose(found, clipped, atol=SECOND_METHOD)


def test_a_patch_above_the_skin_is_projected_along_normals() -> None:
    # The same corners, 2 mm outside along the sphere's normals, must give the same cells;
    # where they are, they enclose 2/60 more in each direction.
    surface, radius = SURFACES["sphere 60"]
    mesh = patch_mesh(surface, (33.0, 33.0), 0.8)
    patch_uv = worn_uv(4)
    lifted = surface(patch_uv) * (radius + 2.0) / radius
    above = nodes_on(
        patch_mesh(lambda uv: surface(uv) * (radius + 2.0) / radius, (33.0, 33.0), 0.8), lifted
    )
    on, lift = patch_on_skin(mesh, lifted, above, 17.0)
    np.testing.assert_allclose(lift, 2.0, atol=0.01)
    np.testing.assert_allclose(on.positions_mm, surface(patch_uv), atol=0.03)
    found = overlaps_of(scored(mesh, surface(grid_uv(3, 3)), on.positions_mm))
    np.testing.assert_allclose(found, truth("sphere 60", patch_uv), atol=OVERLAP)


def test_a_perfect_fit_is_one_by_all_definitions() -> None:
    surface, _ = SURFACES["sphere 40"]
    mesh = patch_mesh(surface, (33.0, 33.0), 1.0)
    skin = surface(grid_uv(3, 3))
    scores = scored(mesh, skin, skin)
    np.testing.assert_allclose(overlaps_of(scores), 1.0, atol=1e-9)
    assert (scores.causes.main == "none").all()


def test_mirroring_the_leg_changes_nothing_but_the_sense_of_the_mesh() -> None:
    surface, _ = SURFACES["sphere 40"]
    mesh = patch_mesh(surface, (33.0, 33.0), 1.0)
    skin, patch = surface(grid_uv(3, 3)), surface(worn_uv(5))
    one = scored(mesh, skin, patch)
    mirror = np.array([1.0, -1.0, 1.0])
    other_mesh = Mesh(mesh.vertices_mm * mirror, np.ascontiguousarray(mesh.faces[:, ::-1]))
    other = scored(other_mesh, skin * mirror, patch * mirror)
    np.testing.assert_allclose(overlaps_of(other), overlaps_of(one), atol=1e-7)
    np.testing.assert_allclose(other.causes.shift_mm, one.causes.shift_mm, atol=1e-6)
    np.testing.assert_allclose(other.causes.rotation_deg, one.causes.rotation_deg, atol=1e-5)
    np.testing.assert_allclose(other.causes.shear, one.causes.shear, atol=1e-7)


def check_against_truth(root: Path, participant: str, result: Conformability) -> None:
    """Compare every cell of a scored synthetic subject with its closed form."""
    folder = root / "derivatives/truth" / f"sub-{participant}"
    lines = (folder / f"sub-{participant}_overlap.tsv").read_text().splitlines()
    header = lines[0].split("\t")
    rows = [dict(zip(header, line.split("\t"), strict=True)) for line in lines[1:]]
    assert len(rows) == 72
    for row in rows:
        at = int(row["row"]), int(row["col"])
        for name, values in (
            ("overlap_paper", result.overlap_paper),
            ("overlap_strict", result.overlap_strict),
            ("overlap_iou", result.overlap_iou),
        ):
            assert float(values[at]) == pytest.approx(float(row[name]), abs=OVERLAP)
        assert str(result.grade[at]) == row["grade"]
        assert str(result.region[at]) == row["region"]


@pytest.mark.xdist_group("scored-knees")
@pytest.mark.parametrize("participant", ["S1", "S2", "S3"])
def test_synthetic_knees_agree_with_their_truth(participant: str) -> None:
    result = scored_knee(participant).score
    check_against_truth(SYNTHETIC, participant, result)
    expected = {"S1": 66, "S2": 58, "S3": 56}[participant]
    assert result.whole.good + result.whole.fair == expected
    assert result.frame.method == "registered"
    # The scans lie in frames 20 mm and 8 degrees apart; the patch is 2 mm thick.
    assert result.frame.shift_mm > 10.0
    np.testing.assert_allclose(result.lift_off_mm, 2.0, atol=0.15)


@pytest.mark.slow
def test_finer_knees_agree_as_well(tmp_path: Path) -> None:
    assert main(["synth", "--edge-mm", "1.5", "--out", str(tmp_path), "--quiet"]) == 0
    for participant in ("S1", "S2", "S3"):
        subject = Dataset.open(tmp_path).subject(participant)
        result = score_subject(subject, ScoreOptions(samples=100))
        check_against_truth(tmp_path, participant, result)
