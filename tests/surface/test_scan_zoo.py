"""Every broken scan ends in its named fault: no crash, no hang, no wrong number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scan_zoo import CASES, Case, sound_mesh, write_obj

from kiribench.errors import Fault, MeshError
from kiribench.surface.health import check_mesh
from kiribench.surface.read import read_scan
from kiribench.surface.repair import repair_mesh

SOUND = sound_mesh()


def faults_of(path: Path) -> tuple[Fault, ...]:
    """All faults on the way of a scan into the program; errors are raised."""
    scan = read_scan(path)
    health = check_mesh(scan.mesh, file=path.name)
    repaired = repair_mesh(scan.mesh, file=path.name)
    assert health.usable  # what is repaired was not called an error
    again = repair_mesh(repaired.mesh)
    assert again.unchanged
    assert np.isfinite(repaired.mesh.vertices_mm).all()
    return scan.faults + health.faults


@pytest.mark.timeout(30)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_broken_scan_ends_in_its_fault(case: Case, tmp_path: Path) -> None:
    folder = tmp_path / "surf"
    folder.mkdir()
    path = case.write(folder / "scan", SOUND)
    if case.exit_code == 0:
        faults = faults_of(path)
        assert case.code in {fault.code for fault in faults}
        assert all(fault.severity == "warning" for fault in faults)
    else:
        with pytest.raises(MeshError) as caught:
            faults_of(path)
        assert caught.value.code == case.code
        assert caught.value.exit_code == case.exit_code
        fault = caught.value.faults[0]
        assert fault.remedy
        assert path.name in (fault.file or "")


def test_zoo_is_large_and_its_names_are_unique() -> None:
    assert len(CASES) >= 25
    assert len({case.name for case in CASES}) == len(CASES)


def test_sound_mesh_has_no_fault(tmp_path: Path) -> None:
    assert faults_of(write_obj(tmp_path / "scan", SOUND)) == ()


def test_errors_of_the_check_are_what_repair_refuses(tmp_path: Path) -> None:
    seen = set()
    for row, case in enumerate(CASES):
        folder = tmp_path / str(row)
        folder.mkdir()
        path = case.write(folder / "scan", SOUND)
        try:
            mesh = read_scan(path).mesh
        except MeshError:
            continue
        errors = {fault.code for fault in check_mesh(mesh).faults if fault.severity == "error"}
        try:
            repair_mesh(mesh)
            refused: set[str] = set()
        except MeshError as error:
            refused = {fault.code for fault in error.faults}
        assert errors == refused
        seen |= refused
    assert len(seen) >= 7
