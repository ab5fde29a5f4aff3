"""Scans against their nodes: units, pieces, winding."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from small_limb import Limb, write_dataset, write_nodes, write_obj

from kiribench.dataset import Dataset
from kiribench.surface.scan_check import ScanCheck, check_scan

SURF = "sub-A/surf"


def checked(root: Path, pose: str = "flex090") -> ScanCheck:
    check = check_scan(Dataset.open(root).subject("A"), pose)
    assert check is not None
    return check


def codes(check: ScanCheck) -> set[str]:
    return {fault.code for fault in check.faults}


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return write_dataset(tmp_path / "limb")


def test_a_good_scan(dataset: Path) -> None:
    check = checked(dataset)
    assert check.faults == ()
    assert check.file == f"{SURF}/sub-A_acq-flex090_scan.obj"
    assert check.health is not None
    assert check.health.usable
    assert check.offset_mm is not None
    assert check.offset_mm[1] < 1e-5
    assert checked(dataset, "flex090worn").faults == ()


@pytest.mark.parametrize("real", ["mm", "cm", "m", "in"])
@pytest.mark.parametrize("declared", ["mm", "cm", "m", "in"])
def test_wrong_units_are_named(dataset: Path, real: str, declared: str) -> None:
    per_unit = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
    vertices, faces = Limb().mesh("flex090")
    write_obj(dataset / SURF / "sub-A_acq-flex090_scan.obj", vertices / per_unit[real], faces)
    (dataset / SURF / "sub-A_acq-flex090_scan.json").write_text(
        json.dumps({"Units": declared, "FlexionAngle": 90, "Side": "right"})
    )
    faults = [fault for fault in checked(dataset).faults if fault.code == "scan-units"]
    if real == declared:
        assert faults == []
    else:
        assert len(faults) == 1
        assert f"is in {real}, not in {declared}" in faults[0].what


def test_another_frame_is_not_taken_for_another_unit(dataset: Path) -> None:
    write_nodes(
        dataset / SURF / "sub-A_acq-flex090_nodes.tsv", Limb().nodes("flex090")[..., [1, 2, 0]]
    )
    assert "nodes-off-surface" in codes(checked(dataset))
    assert "scan-units" not in codes(checked(dataset))


def test_nodes_on_two_pieces(dataset: Path) -> None:
    limb = Limb()
    vertices, faces = limb.mesh("flex090")
    row = faces.min(axis=1) // (limb.mesh_columns + 1)
    kept = faces[row != row.max() // 2 + 1]
    write_obj(dataset / SURF / "sub-A_acq-flex090_scan.obj", vertices, kept)
    assert {"nodes-on-pieces", "mesh-pieces"} <= codes(checked(dataset))


def flat_dataset(root: Path) -> Path:
    """A plate that bulges by 1 mm over its 180 mm: too flat to show its outside."""
    for pose in ("flex000", "flex090"):
        vertices, faces = Limb(radius_mm=4000.0).mesh("flex000")
        stem = root / SURF / f"sub-A_acq-{pose}"
        write_obj(Path(f"{stem}_scan.obj"), vertices, faces)
        write_nodes(Path(f"{stem}_nodes.tsv"), Limb(radius_mm=4000.0).nodes("flex000"))
    for path in (root / SURF).glob("*worn*"):
        path.unlink()
    return root


def test_on_a_flat_surface_winding_and_mirroring_cannot_be_told_apart(dataset: Path) -> None:
    root = flat_dataset(dataset)
    assert codes(checked(root)) == set()
    vertices, faces = Limb(radius_mm=4000.0).mesh("flex000")
    scan = root / SURF / "sub-A_acq-flex090_scan.obj"
    write_obj(scan, vertices, faces[:, ::-1])
    (fault,) = (f for f in checked(root).faults if f.code == "winding-or-mirrored")
    assert fault.severity == "warning"
    write_obj(scan, vertices, faces)
    nodes = Limb(radius_mm=4000.0).nodes("flex000")[:, ::-1]
    write_nodes(root / SURF / "sub-A_acq-flex090_nodes.tsv", nodes)
    assert "winding-or-mirrored" in codes(checked(root))


@pytest.mark.parametrize("repaired", [False, True])
def test_face_beyond_the_file_is_reported_with_its_row(dataset: Path, repaired: bool) -> None:
    if repaired:
        vertices, faces = Limb().mesh("flex090")
        faces[7] = faces[7, [0, 0, 1]]
        write_obj(dataset / SURF / "sub-A_acq-flex090_scan.obj", vertices, faces)
    path = dataset / SURF / "sub-A_acq-flex090_nodes.tsv"
    header, *rows = path.read_text().splitlines()
    count = len(Limb().mesh("flex090")[1])
    rows = [f"{row}\tn/a\tn/a\tn/a\tn/a" for row in rows]
    rows[4] = rows[4].replace("n/a\tn/a\tn/a\tn/a", f"{count}\t1\t0\t0")
    path.write_text("\n".join([f"{header}\tface\tb0\tb1\tb2", *rows]))
    faults = [fault for fault in checked(dataset).faults if fault.code == "nodes-face-range"]
    assert [(fault.row, fault.got, fault.expected) for fault in faults] == [
        (6, str(count), f"0 to {count - 1}")
    ]


def test_missing_scan_or_sidecar_gives_no_second_report(dataset: Path) -> None:
    (dataset / SURF / "sub-A_acq-flex090_scan.json").write_text("{}")
    assert check_scan(Dataset.open(dataset).subject("A"), "flex090") is None
    assert check_scan(Dataset.open(dataset).subject("A"), "flex000") is not None


def test_offsets_are_distances_from_the_scan(dataset: Path) -> None:
    base = Limb().nodes("flex000")
    outward = base * [1, 1, 0] / 57.0
    write_nodes(dataset / SURF / "sub-A_acq-flex000_nodes.tsv", base + 0.4 * outward)
    check = checked(dataset, "flex000")
    assert check.offset_mm is not None
    # Above a vertex the closest point of the polyhedron is the vertex itself.
    np.testing.assert_allclose(check.offset_mm, 0.4, rtol=0, atol=2e-6)
