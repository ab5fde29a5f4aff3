"""Nodes tables put on scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from curved_surfaces import patch_mesh, sphere_map

from kiribench.errors import NodesError
from kiribench.schema.nodes import NodesTable
from kiribench.surface.mesh import Mesh
from kiribench.surface.nodes import NAMED_NODES, locate_nodes
from kiribench.surface.repair import repair_mesh

MAP = sphere_map(50.0)


def table(
    xyz: np.ndarray,
    *,
    face: np.ndarray | None = None,
    barycentric: np.ndarray | None = None,
    missing: tuple[int, ...] = (),
) -> NodesTable:
    """A table of a (rows, columns, 3) grid."""
    rows, columns = xyz.shape[:2]
    row, col = np.divmod(np.arange(rows * columns, dtype=np.int32), columns)
    flat = xyz.reshape(-1, 3).copy()
    status = ["missing" if k in missing else "ok" for k in range(len(flat))]
    flat[list(missing)] = np.nan
    return NodesTable(
        Path("sub-X_nodes.tsv"),
        (rows, columns),
        row,
        col.astype(np.int32),
        flat,
        face,
        barycentric,
        np.linspace(0.1, 0.4, len(flat)),
        "column",
        tuple(status),
        np.arange(2, len(flat) + 2, dtype=np.int32),
    )


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return patch_mesh(MAP, (20.0, 20.0), 1.0)


def grid() -> np.ndarray:
    u, v = np.meshgrid([-15.0, 0.0, 15.0], [-7.5, 7.5], indexing="ij")
    return MAP(np.stack([u, v], axis=-1))


def test_positions_go_to_the_closest_point(mesh: Mesh) -> None:
    nodes = locate_nodes(mesh, table(grid()))
    assert nodes.present.all()
    assert nodes.cells_present.shape == (2, 1)
    # Chords of 1.4 mm on a radius of 50 mm stand at most L^2 / 8R = 0.005 mm off.
    np.testing.assert_allclose(nodes.positions_mm, grid(), atol=0.01)
    assert float(np.nanmax(nodes.offset_mm)) < 0.01
    assert nodes.sd_mm[0, 1] == pytest.approx(0.1 + 0.3 / 5)


def test_a_missing_node_takes_its_cells(mesh: Mesh) -> None:
    nodes = locate_nodes(mesh, table(grid(), missing=(0,)))
    assert nodes.present.tolist() == [[False, True], [True, True], [True, True]]
    assert nodes.cells_present.tolist() == [[False], [True]]
    assert np.isnan(nodes.positions_mm[0, 0]).all()
    np.testing.assert_allclose(nodes.positions_mm[0, 1], grid()[0, 1], atol=0.01)
    part = nodes.window(1, 0, (2, 2))
    assert part.present.all()
    np.testing.assert_array_equal(part.positions_mm, nodes.positions_mm[1:])
    np.testing.assert_array_equal(
        part.points.positions_mm(mesh)[part.index.ravel()], nodes.positions_mm[1:].reshape(-1, 3)
    )


def test_faces_and_weights_win_over_the_closest_point(mesh: Mesh) -> None:
    face = np.array([10, -1, 20, 30, 40, 50], dtype=np.int32)
    weights = np.tile([0.2, 0.3, 0.5], (6, 1))
    weights[1] = np.nan
    xyz = grid().reshape(-1, 3)
    inside = np.einsum("c,kcx->kx", [0.2, 0.3, 0.5], mesh.corners_mm[np.maximum(face, 0)])
    inside[1] = xyz[1]
    nodes = locate_nodes(mesh, table(inside.reshape(3, 2, 3) + 0.3, face=face, barycentric=weights))
    kept = face >= 0
    np.testing.assert_array_equal(nodes.points.faces[kept], face[kept])
    np.testing.assert_allclose(nodes.points.barycentric[kept], weights[kept])
    assert float(nodes.offset_mm[0, 0]) == pytest.approx(0.3 * np.sqrt(3.0))


def test_repaired_scans_keep_the_places_on_their_faces(mesh: Mesh) -> None:
    # One face wound the other way and a duplicate in front: repair renumbers and turns.
    faces = mesh.faces.copy()
    faces[100] = faces[100][::-1]
    given = Mesh(mesh.vertices_mm, np.concatenate([faces[:1], faces]).astype(np.int32))
    repaired = repair_mesh(given)
    assert not repaired.unchanged
    face = np.array([101, 1, 21, 31, 41, 51], dtype=np.int32)
    weights = np.tile([0.2, 0.3, 0.5], (6, 1))
    inside = np.einsum("kc,kcx->kx", weights, given.corners_mm[face]).reshape(3, 2, 3)
    nodes = locate_nodes(
        repaired.mesh, table(inside, face=face, barycentric=weights), repaired=repaired
    )
    np.testing.assert_allclose(nodes.positions_mm, inside, atol=1e-9)


def test_nodes_of_another_frame_are_all_named(mesh: Mesh) -> None:
    with pytest.raises(NodesError) as caught:
        locate_nodes(mesh, table(grid() + np.array([0.0, 0.0, 30.0])))
    faults = caught.value.faults
    assert len(faults) == 6 <= NAMED_NODES
    assert {fault.code for fault in faults} == {"nodes-off-surface"}
    assert sorted(fault.row or 0 for fault in faults) == [2, 3, 4, 5, 6, 7]


def test_a_face_that_disagrees_with_its_position_is_refused(mesh: Mesh) -> None:
    face = np.zeros(6, dtype=np.int32)
    weights = np.tile([1.0, 0.0, 0.0], (6, 1))
    with pytest.raises(NodesError) as caught:
        locate_nodes(mesh, table(grid(), face=face, barycentric=weights))
    assert caught.value.code == "nodes-face-mismatch"


def test_a_face_that_the_scan_has_not_is_refused(mesh: Mesh) -> None:
    face = np.full(6, len(mesh.faces), dtype=np.int32)
    weights = np.tile([1.0, 0.0, 0.0], (6, 1))
    with pytest.raises(NodesError) as caught:
        locate_nodes(mesh, table(grid(), face=face, barycentric=weights))
    assert {fault.code for fault in caught.value.faults} == {"nodes-face-range"}


def test_moved_nodes_stay_on_their_faces(mesh: Mesh) -> None:
    nodes = locate_nodes(mesh, table(grid()))
    shifted = Mesh(mesh.vertices_mm + np.array([1.0, 2.0, 3.0]), mesh.faces)
    np.testing.assert_allclose(
        nodes.moved(shifted).positions_mm,
        nodes.positions_mm + np.array([1.0, 2.0, 3.0]),
        atol=1e-12,
    )
