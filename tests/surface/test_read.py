"""Formats and units: the same surface comes back from every format, in millimetres."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scan_zoo import sound_mesh, write_obj, write_other

from kiribench.errors import MeshError
from kiribench.surface.read import MM_PER_UNIT, read_mesh, read_scan
from kiribench.surface.repair import repair_mesh

SOUND = sound_mesh()
# STL and glTF hold single precision: half a unit in the last place of 150 mm.
SINGLE_MM = 150 * 2.0**-24


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".glb"])
def test_other_formats_hold_the_same_surface(tmp_path: Path, suffix: str) -> None:
    mesh = read_mesh(write_other(tmp_path / "scan", SOUND, suffix))
    assert mesh.faces.dtype == np.int32
    assert mesh.vertices_mm.dtype == np.float64
    assert np.abs(mesh.corners_mm - SOUND.corners_mm).max() <= SINGLE_MM


def test_stl_is_welded_by_repair(tmp_path: Path) -> None:
    mesh = read_mesh(write_other(tmp_path / "scan", SOUND, ".stl"))
    repaired = repair_mesh(mesh)
    assert len(repaired.mesh.vertices_mm) == len(SOUND.vertices_mm)
    assert len(repaired.actions) == 1


@pytest.mark.parametrize(("units", "scale"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("in", 25.4)])
@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_units_scale_to_mm(tmp_path: Path, units: str, scale: float, suffix: str) -> None:
    assert set(MM_PER_UNIT) == {"mm", "cm", "m", "in"}
    write = write_obj if suffix == ".obj" else write_other
    path = write(tmp_path / "scan", SOUND, *([] if suffix == ".obj" else [suffix]))  # type: ignore[operator]
    plain = read_mesh(path).vertices_mm
    assert np.allclose(read_mesh(path, units=units).vertices_mm, scale * plain, rtol=1e-15)


@pytest.mark.parametrize("units", ["inch", "MM", "", "um", "parsec"])
def test_unknown_units_are_refused(tmp_path: Path, units: str) -> None:
    with pytest.raises(MeshError) as caught:
        read_scan(write_obj(tmp_path / "scan", SOUND), units=units)
    assert caught.value.code == "mesh-unknown-unit"
    assert caught.value.faults[0].expected == "mm, cm, m, in"


def test_scene_is_flattened_with_its_transforms(tmp_path: Path) -> None:
    """Two instances, one moved and one mirrored: the mirrored one keeps facing outwards."""
    import trimesh

    box = trimesh.creation.box((10, 20, 30))
    scene = trimesh.Scene()
    moved = trimesh.transformations.translation_matrix((100, 0, 0))
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored[0, 3] = -100
    scene.add_geometry(box, transform=moved)
    scene.add_geometry(box, transform=mirrored)
    path = tmp_path / "scan.glb"
    path.write_bytes(scene.export(file_type="glb"))
    mesh = read_mesh(path)
    assert len(mesh.faces) == 24
    assert np.allclose(mesh.vertices_mm.min(axis=0), (-105, -10, -15), atol=1e-5)
    assert np.allclose(mesh.vertices_mm.max(axis=0), (105, 10, 15), atol=1e-5)
    # The enclosed volume is positive only where faces are wound outwards.
    a, b, c = np.moveaxis(mesh.corners_mm, 1, 0)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    right = mesh.corners_mm[:, :, 0].mean(axis=1) > 0
    assert volume[right].sum() == pytest.approx(6000, rel=1e-6)
    assert volume[~right].sum() == pytest.approx(6000, rel=1e-6)


def test_ply_keeps_vertex_colours(tmp_path: Path) -> None:
    import trimesh

    colours = np.arange(4 * len(SOUND.vertices_mm)).reshape(-1, 4) % 251
    shape = trimesh.Trimesh(
        SOUND.vertices_mm, SOUND.faces, vertex_colors=colours.astype(np.uint8), process=False
    )
    path = tmp_path / "scan.ply"
    path.write_bytes(shape.export(file_type="ply"))
    mesh = read_mesh(path)
    assert mesh.colours is not None
    assert np.array_equal(mesh.colours, colours[:, :3])


def test_importing_the_reader_imports_nothing_heavy() -> None:
    import subprocess
    import sys

    code = (
        "import sys, kiribench.surface.read;"
        "print([name for name in ('trimesh', 'numba', 'scipy', 'pandas') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
