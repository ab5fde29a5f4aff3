"""Strain on real and closed-form surfaces with known answers."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pygeodesic.geodesic
import pytest
from tolerances import (
    ANNY_EDGE_MM,
    ANNY_STRAIN_FROM_TABLE,
    CELL_STRAIN,
    DUODIC_STRAIN,
    MMP_MM,
    NOISE_FLOOR_SD,
)

from kiribench.strain.field import Pose, edge_stretches, strain_field
from kiribench.surface.cells import cell_frames, flat_corners, grid_sides
from kiribench.surface.locate import locate
from kiribench.surface.mesh import Mesh, SurfacePoints
from kiribench.surface.nodes import LocatedNodes
from kiribench.surface.read import read_mesh
from kiribench.surface.topology import topology

DATA = Path(__file__).parent.parent / "data"
ANNY = [
    f"{shape}_{skinning}"
    for shape in ("A_male_athletic", "B_female_average")
    for skinning in ("dqs", "lbs")
]


def nodes_at(mesh: Mesh, points: SurfacePoints, shape: tuple[int, int]) -> LocatedNodes:
    """The same material points on any mesh of the same faces."""
    index = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape)
    return LocatedNodes(
        points,
        index,
        np.full(shape, 0.25),
        np.zeros(shape),
        points.positions_mm(mesh).reshape(*shape, 3),
        "default",
    )


def vertex_points(mesh: Mesh, vertices: np.ndarray) -> SurfacePoints:
    """Vertices as points of one of their faces."""
    face = np.full(len(mesh.vertices_mm), -1)
    corner = np.zeros(len(mesh.vertices_mm), dtype=int)
    for k in range(3):
        face[mesh.faces[:, k]] = np.arange(len(mesh.faces))
        corner[mesh.faces[:, k]] = k
    wanted = vertices.ravel()
    return SurfacePoints(face[wanted].astype(np.int32), np.eye(3)[corner[wanted]])


def pose(name: str, mesh: Mesh, nodes: LocatedNodes) -> Pose:
    table = topology(mesh)
    sides = grid_sides(mesh, nodes, table)
    frames = cell_frames(mesh, nodes, table)
    return Pose(
        name,
        sides.longitudinal_mm,
        sides.lateral_mm,
        flat_corners(mesh, nodes, frames, table),
        nodes.sd_mm,
    )


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


# --- A cylinder that is stretched and rolled up tighter ------------------------------


@pytest.fixture(scope="module")
def cylinders() -> tuple[Pose, Pose]:
    vertices = np.arange(0, 81, 5)[:, None] + 81 * np.arange(0, 61, 5)[None, :]
    meshes = [
        read_mesh(DATA / "geodesic_benchmark" / f"cyl_pair_{name}.obj") for name in ("ref", "def")
    ]
    points = vertex_points(meshes[0], vertices)
    first, second = (
        pose(name, mesh, nodes_at(mesh, points, vertices.shape))
        for name, mesh in zip(("flex000", "flex090"), meshes, strict=True)
    )
    return first, second


def test_cylinder_pair_is_exact(cylinders: tuple[Pose, Pose]) -> None:
    field = strain_field("cyl", *cylinders, strain_measure="engineering")
    np.testing.assert_allclose(field.longitudinal_strain.value, 0.25, atol=CELL_STRAIN)
    # The smooth cylinders (R 57, 3 degrees a facet; R 40) stretch by .9 around; their
    # 60-sided polyhedra by the ratio of the chords, .899934. That is what lies on the mesh.
    turn = np.deg2rad(3.0)
    chord = (40.0 * np.sin(0.5 * turn * 0.9 * 57.0 / 40.0)) / (57.0 * np.sin(0.5 * turn))
    np.testing.assert_allclose(field.lateral_stretch.value, chord, atol=CELL_STRAIN)
    assert chord == pytest.approx(0.9, abs=7e-5)
    np.testing.assert_allclose(field.poisson_ratio.value, (1.0 - chord) / 0.25, atol=1e-5)
    assert float(field.poisson_ratio.value.mean()) == pytest.approx(0.4, abs=3e-4)


def test_cylinder_pair_has_no_shear_and_a_diagonal_gradient(
    cylinders: tuple[Pose, Pose],
) -> None:
    field = strain_field("cyl", *cylinders)
    np.testing.assert_allclose(field.shear.value, 0.0, atol=1e-9)
    np.testing.assert_allclose(field.rotation_deg, 0.0, atol=1e-7)
    np.testing.assert_allclose(field.gradient[..., 0, 0], 1.25, atol=CELL_STRAIN)
    np.testing.assert_allclose(
        field.gradient[..., 1, 1], field.lateral_stretch.value, atol=CELL_STRAIN
    )


# --- Knees of an independent body model -------------------------------------------------


@pytest.fixture(scope="module", params=ANNY)
def knee(request: pytest.FixtureRequest) -> tuple[str, tuple[Pose, Pose], tuple[Mesh, Mesh]]:
    name: str = request.param
    vertices = np.zeros((17, 13), dtype=int)
    for row in rows_of(DATA / "anny_knee" / f"{name}_markers.csv"):
        vertices[int(row["row"]), int(row["col"])] = int(row["vertex_id"])
    meshes = [read_mesh(DATA / "anny_knee" / f"{name}_{angle}deg.obj") for angle in ("00", "90")]
    points = vertex_points(meshes[0], vertices)
    poses = [
        pose(angle, mesh, nodes_at(mesh, points, vertices.shape))
        for angle, mesh in zip(("flex000", "flex090"), meshes, strict=True)
    ]
    return name, (poses[0], poses[1]), (meshes[0], meshes[1])


def tabulated(name: str) -> tuple[np.ndarray, np.ndarray]:
    """(2, 16, 13) longitudinal and (2, 17, 12) lateral edge lengths at 0 and 90 degrees."""
    along, across = np.zeros((2, 16, 13)), np.zeros((2, 17, 12))
    for row in rows_of(DATA / "anny_knee" / f"{name}_edges.csv"):
        target = along if row["kind"] == "longitudinal" else across
        target[:, int(row["row"]), int(row["col"])] = (
            float(row["geodesic_mm_00"]),
            float(row["geodesic_mm_90"]),
        )
    return along, across


def test_anny_edges_agree_with_the_table_to_the_rounding_of_its_meshes(
    knee: tuple[str, tuple[Pose, Pose], tuple[Mesh, Mesh]],
) -> None:
    name, poses, _ = knee
    along, across = tabulated(name)
    for k, one in enumerate(poses):
        np.testing.assert_allclose(one.longitudinal_mm, along[k], atol=ANNY_EDGE_MM)
        np.testing.assert_allclose(one.lateral_mm, across[k], atol=ANNY_EDGE_MM)
        # No bias: rounding of vertices averages out over 400 edges.
        error = np.concatenate(
            [(one.longitudinal_mm - along[k]).ravel(), (one.lateral_mm - across[k]).ravel()]
        )
        assert abs(error.mean()) < 5.0 * error.std() / np.sqrt(error.size)


def test_anny_cells_agree_with_mmp_on_the_same_mesh(
    knee: tuple[str, tuple[Pose, Pose], tuple[Mesh, Mesh]],
) -> None:
    # An independent MMP on the very files: the edges of a cell to 1e-9 mm, so strains to 1e-6.
    name, poses, meshes = knee
    markers = {
        (int(row["row"]), int(row["col"])): int(row["vertex_id"])
        for row in rows_of(DATA / "anny_knee" / f"{name}_markers.csv")
    }
    field = strain_field(name, *poses, strain_measure="engineering", min_strain=0.0)
    solvers = [
        pygeodesic.geodesic.PyGeodesicAlgorithmExact(mesh.vertices_mm, mesh.faces)
        for mesh in meshes
    ]

    r, c = 8, 5

    def ratios(start: tuple[int, int], *ends: tuple[int, int]) -> list[float]:
        targets = np.array([markers[end] for end in ends])
        length = [
            solver.geodesicDistances(np.array([markers[start]]), targets)[0] for solver in solvers
        ]
        return [float(ratio) for ratio in length[1] / length[0]]

    lateral, proximal = ratios((r, c), (r + 1, c), (r, c + 1))
    medial, distal = ratios((r + 1, c + 1), (r, c + 1), (r + 1, c))
    along, across = 0.5 * (lateral + medial) - 1.0, 0.5 * (proximal + distal) - 1.0
    assert float(field.longitudinal_strain.value[r, c]) == pytest.approx(along, abs=MMP_MM)
    assert float(field.lateral_strain.value[r, c]) == pytest.approx(across, abs=MMP_MM)


def test_anny_cells_follow_from_the_tabulated_edges(
    knee: tuple[str, tuple[Pose, Pose], tuple[Mesh, Mesh]],
) -> None:
    name, poses, _ = knee
    along, across = tabulated(name)
    given = [
        Pose(f"pose {k}", along[k], across[k], poses[k].corners, poses[k].sd_mm) for k in range(2)
    ]
    table = np.zeros((3, 16, 12))
    for row in rows_of(DATA / "anny_knee" / f"{name}_cells.csv"):
        table[:, int(row["row"]), int(row["col"])] = (
            float(row["strain_long"]),
            float(row["strain_lat"]),
            float(row["poisson"]),
        )
    stretch = edge_stretches(*given)
    np.testing.assert_allclose(stretch[0] - 1.0, table[0], atol=CELL_STRAIN)
    np.testing.assert_allclose(stretch[1] - 1.0, table[1], atol=CELL_STRAIN)
    field = strain_field(name, *given, strain_measure="engineering", min_strain=0.03)
    known = field.poisson_reason != "strain-too-small"
    # The table rounds the strains to 1e-6; the ratio inherits that over a strain of .03.
    np.testing.assert_allclose(
        field.poisson_ratio.value[known], table[2][known], atol=1e-6 / 0.03 * 3.0
    )
    # And from the scans themselves, within what the rounding of the OBJ files allows.
    measured = strain_field(name, *poses, strain_measure="engineering")
    np.testing.assert_allclose(
        measured.longitudinal_strain.value, table[0], atol=ANNY_STRAIN_FROM_TABLE
    )
    np.testing.assert_allclose(measured.lateral_strain.value, table[1], atol=ANNY_STRAIN_FROM_TABLE)


# --- Stretched rubber, seen by stereo correlation ---------------------------------------


def strip_grid(
    mesh: Mesh, rows: int, half_width_mm: float
) -> tuple[SurfacePoints, tuple[int, int]]:
    """A straight grid of rows x 1 cells on a strip, along its longest axis."""
    centre = mesh.vertices_mm.mean(axis=0)
    local = mesh.vertices_mm - centre
    axes = np.linalg.svd(local, full_matrices=False)[2]
    flat = local @ axes.T
    low, high = flat[:, 0].min(), flat[:, 0].max()
    inset = 0.02 * (high - low)
    nodes = []
    for along in np.linspace(low + inset, high - inset, rows + 1):
        for across in (-half_width_mm, half_width_mm):
            near = np.argsort((flat[:, 0] - along) ** 2 + (flat[:, 1] - across) ** 2)[:6]
            nodes.append([along, across, flat[near, 2].mean()])
    return locate(mesh, np.array(nodes) @ axes + centre).points, (rows + 1, 2)


@pytest.mark.parametrize("state", [5, 10])
def test_rubber_average_agrees_with_the_published_points(state: int) -> None:
    folder = DATA / "duodic_rubber_tension"
    meshes = [read_mesh(folder / f"state_{k:02d}.obj") for k in (0, state)]
    points, shape = strip_grid(meshes[0], rows=6, half_width_mm=1.2)
    poses = [pose(f"{k}", mesh, nodes_at(mesh, points, shape)) for k, mesh in enumerate(meshes)]
    field = strain_field("rubber", *poses, strain_measure="engineering")
    table = {int(row["state"]): row for row in rows_of(folder / "triangle_average_strain.csv")}
    along, across = (float(table[state][key]) for key in ("strain_long", "strain_lat"))
    assert float(field.longitudinal_strain.value.mean()) == pytest.approx(along, abs=DUODIC_STRAIN)
    assert float(field.lateral_strain.value.mean()) == pytest.approx(across, abs=DUODIC_STRAIN)
    # The gradient, an average over the cell like the triangles' F, says the same.
    assert float(field.gradient[..., 0, 0].mean() - 1.0) == pytest.approx(along, abs=DUODIC_STRAIN)
    assert float(field.gradient[..., 1, 1].mean() - 1.0) == pytest.approx(across, abs=DUODIC_STRAIN)
    hencky = float(table[state]["poisson_hencky"])
    log = strain_field("rubber", *poses, strain_measure="log")
    assert float(log.poisson_ratio.value.mean()) == pytest.approx(hencky, abs=0.02)


# --- A rigid cylinder that only moved ----------------------------------------------------


@pytest.mark.parametrize("position", [1, 3])
def test_rigid_motion_has_no_strain_beyond_the_noise_floor(position: int) -> None:
    folder = DATA / "multidic_cylinder"
    meshes = [read_mesh(folder / f"cyl_{k}.obj") for k in (0, position)]
    centre = meshes[0].vertices_mm.mean(axis=0)
    axes = np.linalg.svd(meshes[0].vertices_mm - centre, full_matrices=False)[2]
    flat = (meshes[0].vertices_mm - centre) @ axes.T
    u, v = np.meshgrid(np.arange(-90.0, 91.0, 15.0), np.arange(-15.0, 16.0, 15.0), indexing="ij")
    nodes = []
    for along, across in zip(u.ravel(), v.ravel(), strict=True):
        near = np.argsort((flat[:, 0] - along) ** 2 + (flat[:, 1] - across) ** 2)[:6]
        nodes.append([along, across, flat[near, 2].mean()])
    points = locate(meshes[0], np.array(nodes) @ axes + centre).points
    poses = [pose(f"{k}", mesh, nodes_at(mesh, points, u.shape)) for k, mesh in enumerate(meshes)]
    field = strain_field("rigid", *poses, strain_measure="engineering", min_strain=0.03)
    strains = np.concatenate(
        [field.longitudinal_strain.value.ravel(), field.lateral_strain.value.ravel()]
    )
    assert float(strains.std()) < NOISE_FLOOR_SD
    assert float(np.abs(strains).max()) < 5.0 * NOISE_FLOOR_SD
    assert (field.poisson_reason == "strain-too-small").all()
