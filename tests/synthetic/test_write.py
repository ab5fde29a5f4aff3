"""The committed dataset is what the generator makes, byte for byte, and says what it holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic_subjects import stored_subject
from tolerances import NODE_FILE_MM, SCAN_FILE_MM

from kiribench.dataset import Dataset, check_dataset
from kiribench.errors import UsageError
from kiribench.provenance import file_sha256
from kiribench.surface.read import read_mesh
from kiribench.synthetic import STORED, Imperfections, write_dataset
from kiribench.synthetic.truth_tables import number

COMMITTED = Path(__file__).parents[2] / "data" / "synthetic"


RECORDS = COMMITTED / "derivatives" / "kiribench"
"""What the analysis made of the data; not the generator's."""

OTHERS = (COMMITTED / "design_space", COMMITTED / "tensile")
"""Tables of the design space and pictures of a pulled sheet, beside the subjects; other tests
judge them."""


def _files(root: Path) -> list[Path]:
    left_out = (RECORDS, *OTHERS)
    return [
        path
        for path in sorted(root.rglob("*"))
        if path.is_file() and not any(folder in path.parents for folder in left_out)
    ]


def _hashes(root: Path) -> dict[str, str]:
    return {str(path.relative_to(root)): file_sha256(path) for path in _files(root)}


def test_a_fresh_generation_equals_the_committed_files(tmp_path: Path) -> None:
    write_dataset(tmp_path / "fresh", list(STORED.values()))
    assert _hashes(tmp_path / "fresh") == _hashes(COMMITTED)


def test_the_committed_files_are_small_enough() -> None:
    files = [*_files(COMMITTED), *(p for p in RECORDS.rglob("*") if p.is_file())]
    assert sum(p.stat().st_size for p in files) < 10_000_000


def test_the_dataset_is_valid_and_has_both_sides() -> None:
    assert check_dataset(COMMITTED) == ()
    dataset = Dataset.open(COMMITTED)
    assert dataset.participants == ("S1", "S2", "S3")
    assert [dataset.subject(p).side for p in dataset.participants] == ["right", "left", "right"]


@pytest.mark.parametrize("acquisition", ["flex000", "flex090", "flex090worn"])
def test_files_hold_the_scans_and_nodes_in_memory(acquisition: str) -> None:
    person = stored_subject("S2")
    folder = Dataset.open(COMMITTED).subject("S2")
    path = folder.scan_path(acquisition)
    assert path is not None
    mesh = read_mesh(path)
    scan = person.scans[acquisition]
    np.testing.assert_array_equal(mesh.faces, scan.faces)
    np.testing.assert_allclose(mesh.vertices_mm, scan.vertices_mm, atol=SCAN_FILE_MM)
    # Texture coordinates are the material coordinates: s to medial, t upwards.
    assert mesh.uv is not None and mesh.texture is not None and mesh.texture.is_file()
    half = np.array(person.half_extent_mm)
    material = (mesh.uv * [2.0, -2.0] + [-1.0, 1.0]) * half
    np.testing.assert_allclose(material, scan.q, atol=1e-4 * half.max())
    nodes = folder.nodes(acquisition)
    np.testing.assert_allclose(
        nodes.grid_xyz_mm(), person.nodes[acquisition].xyz_mm, atol=NODE_FILE_MM
    )
    assert (nodes.sd_mm == 0.1).all() and nodes.sd_source == "column"


@pytest.mark.parametrize("label", STORED)
def test_truth_tables_hold_the_truth_in_memory(label: str) -> None:
    person = stored_subject(label)
    folder = COMMITTED / "derivatives" / "truth" / f"sub-{label}"
    header, *lines = (folder / f"sub-{label}_overlap.tsv").read_text().splitlines()
    rows = [dict(zip(header.split("\t"), line.split("\t"), strict=True)) for line in lines]
    assert len(rows) == 72
    for row in rows:
        entry = int(row["row"]), int(row["col"])
        for kind in ("paper", "strict", "iou"):
            assert float(row[f"overlap_{kind}"]) == pytest.approx(
                getattr(person.overlap, kind)[entry], abs=6e-7
            )
        assert row["region"] == person.layout.regions.labels[entry[0]][entry[1]]
    record = json.loads((folder / f"sub-{label}_overlap.json").read_text())
    tally = record["Counts"]
    assert tally["Good"] + tally["Fair"] == {"S1": 66, "S2": 58, "S3": 56}[label]
    assert {k: v["Cells"] for k, v in tally["Regions"].items()} == {
        "S": 12,
        "LS": 8,
        "P": 16,
        "MS": 8,
        "LI": 8,
        "MI": 8,
        "I": 12,
    }
    grades = [row["grade"] for row in rows]
    assert [tally[g.capitalize()] for g in ("good", "fair", "poor")] == [
        grades.count(g) for g in ("good", "fair", "poor")
    ]
    # The recorded motion takes the bare frame to the worn one.
    motion = record["WornMotion"]
    worn = person.nodes["flex090worn"]
    bare = person.flexed.points_mm(worn.q) + 2.0 * person.flexed.normals(worn.q)
    moved = bare @ np.array(motion["Rotation"]).T + motion["TranslationMm"]
    np.testing.assert_allclose(moved, worn.xyz_mm, atol=1e-8)
    header, *lines = (folder / f"sub-{label}_strain.tsv").read_text().splitlines()
    columns = header.split("\t")
    assert columns[:6] == [
        "row",
        "col",
        "longitudinal_stretch",
        "lateral_stretch",
        "poisson_ratio",
        "shear",
    ]
    table = np.array([[float(x) for x in line.split("\t")] for line in lines])
    strain = person.strain
    for index, values in (
        (2, strain.longitudinal_stretch),
        (3, strain.lateral_stretch),
        (5, strain.shear),
    ):
        np.testing.assert_allclose(table[:, index], values.ravel(), atol=6e-7)


def test_missing_nodes_and_holes_reach_the_files(tmp_path: Path) -> None:
    flaws = Imperfections(edge_mm=8.0, missing_nodes=4, holes=1, noise_mm=0.05, node_noise_mm=0.2)
    write_dataset(tmp_path / "d", [STORED["S1"]], flaws)
    nodes = Dataset.open(tmp_path / "d").subject("S1").nodes("flex000")
    assert nodes.status.count("missing") == 4 and len(nodes) == 17 * 13
    assert (nodes.sd_mm == 0.2).all()
    description = json.loads((tmp_path / "d" / "dataset_description.json").read_text())
    assert description["Imperfections"]["holes"] == 1
    assert check_dataset(tmp_path / "d") == ()


def test_generated_subjects_are_not_mixed_with_other_files(tmp_path: Path) -> None:
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(UsageError, match="synth-not-empty"):
        write_dataset(tmp_path, [STORED["S1"]])
    assert [p.name for p in tmp_path.iterdir()] == ["note.txt"]


def test_numbers_have_no_negative_zero() -> None:
    assert number(-0.00001, 4) == "0.0000"
    assert number(-0.00006, 4) == "-0.0001"
    assert number(-10.0, 1) == "-10.0"
