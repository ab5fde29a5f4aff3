"""Subjects in memory: scans on their surfaces, nodes, flaws, and the generator's independence."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from synthetic_subjects import stored_subject
from tolerances import ROUNDING

import kiribench
from kiribench.errors import UsageError
from kiribench.schema.layout import Grid, Layout, Patch
from kiribench.synthetic import STORED, Imperfections, Scan, random_knee, subject

SMALL = Layout.of(Grid(rows=6, columns=4), Patch(rows=4, columns=2), body_part="shin")


def test_scans_lie_on_the_smooth_skin_and_face_outwards() -> None:
    person = stored_subject("S2")
    for name, surface in (("flex000", person.reference), ("flex090", person.flexed)):
        scan = person.scans[name]
        np.testing.assert_array_equal(scan.vertices_mm, surface.points_mm(scan.q))
        a, b, c = (scan.vertices_mm[scan.faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        outward = surface.normals(scan.q[scan.faces].mean(axis=1))
        assert (np.einsum("ij,ij->i", normals, outward) > 0).all()


def test_edges_about_the_patella_are_as_long_as_asked_for() -> None:
    person = stored_subject("S1")
    for name, scan in person.scans.items():
        inside = (np.abs(scan.q[scan.faces]) < [45.0, 40.0]).all(axis=(1, 2))
        corners = scan.vertices_mm[scan.faces[inside]]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        wanted = person.imperfections.edge_mm * (2.0 if name == "flex000" else 1.0)
        assert edges.mean() == pytest.approx(wanted, rel=0.08)
        everywhere = scan.vertices_mm[scan.faces]
        longest = np.linalg.norm(everywhere - np.roll(everywhere, 1, axis=1), axis=2).max()
        assert longest < 4.0 * wanted


def test_no_two_scans_share_their_inner_vertices() -> None:
    scans = list(stored_subject("S1").scans.values())
    for i, a in enumerate(scans):
        for b in scans[i + 1 :]:
            inner = [
                {tuple(q) for q in np.round(scan.q, 6) if (np.abs(q) < [100.0, 130.0]).all()}
                for scan in (a, b)
            ]
            assert len(inner[0] & inner[1]) < 0.001 * len(inner[0])


def test_the_worn_scan_in_the_bare_frame_is_the_skin_raised_by_the_patch() -> None:
    person = stored_subject("S3")
    scan, motion = person.scans["flex090worn"], person.worn_motion
    back = (scan.vertices_mm - motion.translation_mm) @ motion.rotation
    offset = back - person.flexed.points_mm(scan.q)
    normals = person.flexed.normals(scan.q)
    height = np.einsum("ij,ij->i", offset, normals)
    np.testing.assert_allclose(offset, height[:, None] * normals, atol=1e-11)
    assert height.max() == pytest.approx(2.0) and height.min() == pytest.approx(0.0, abs=1e-11)
    p = person.patch_relief.patch_point(scan.q)
    within = (np.abs(p) < [45.0, 90.0]).all(axis=1)
    np.testing.assert_allclose(height[within], 2.0, atol=1e-11)
    assert (np.abs(height) < 1e-11).mean() > 0.5  # bare skin is left for the registration


def test_nodes_of_the_worn_patch_are_its_corners_on_top() -> None:
    person = stored_subject("S1")
    nodes, motion = person.nodes["flex090worn"], person.worn_motion
    assert nodes.q.shape == (13, 7, 2)
    back = (nodes.xyz_mm - motion.translation_mm) @ motion.rotation
    expected = person.flexed.points_mm(nodes.q) + 2.0 * person.flexed.normals(nodes.q)
    np.testing.assert_allclose(back, expected, atol=1e-11)
    wanted = person.nodes["flex090"].q[2:15, 3:10]
    np.testing.assert_allclose(
        nodes.q - wanted, person.knee.mismatch.field_mm(wanted), atol=ROUNDING * 100
    )


def test_another_layout_works_by_metadata_alone() -> None:
    person = subject("S1", layout=SMALL, imperfections=Imperfections(edge_mm=5.0))
    assert person.strain.lateral_stretch.shape == (6, 4)
    assert person.overlap.paper.shape == (4, 2)
    assert person.nodes["flex090worn"].xyz_mm.shape == (5, 3, 3)
    assert person.half_extent_mm == (56.0, 71.0)
    # The same skin has the same strain whatever grid is drawn around the cell.
    np.testing.assert_allclose(
        person.strain.longitudinal_stretch,
        stored_subject("S1").strain.longitudinal_stretch[5:11, 4:8],
        rtol=1e-9,
    )


def _area_mm2(scan: Scan) -> float:
    corners = scan.vertices_mm[scan.faces]
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)


def test_flaws_are_what_was_asked_for() -> None:
    flaws = Imperfections(
        edge_mm=2.0, noise_mm=0.1, node_noise_mm=0.3, holes=3, missing_nodes=5, seed=2
    )
    person = subject("S1", layout=SMALL, imperfections=flaws)
    scan = person.scans["flex000"]
    offset = scan.vertices_mm - person.reference.points_mm(scan.q)
    along = np.einsum("ij,ij->i", offset, person.reference.normals(scan.q))
    np.testing.assert_allclose(along, scan.noise_mm, atol=1e-11)
    # Three sampling errors of a standard deviation.
    assert np.std(scan.noise_mm) == pytest.approx(0.1, rel=3 / np.sqrt(2 * len(along)))
    whole = subject("S1", layout=SMALL, imperfections=Imperfections(edge_mm=2.0, seed=2))
    lost_mm2 = _area_mm2(whole.scans["flex000"]) - _area_mm2(scan)
    assert 3 * 0.5 * np.pi * 5**2 < lost_mm2 < 3 * 1.5 * np.pi * 9**2
    assert len(np.unique(scan.faces)) == len(scan.vertices_mm)
    assert all(nodes.missing.sum() == 5 for nodes in person.nodes.values())


def test_node_noise_stays_in_the_surface_with_its_standard_deviation() -> None:
    moves = []
    for seed in range(12):
        flaws = Imperfections(edge_mm=8.0, node_noise_mm=0.2, seed=seed)
        person = subject("S1", layout=SMALL, imperfections=flaws)
        nodes = person.nodes["flex090"]
        assert nodes.sd_mm == 0.2
        exact = person.flexed.points_mm(nodes.q)
        normals = person.flexed.normals(nodes.q)
        x_u, _ = person.flexed.tangents(nodes.q)
        first = x_u / np.linalg.norm(x_u, axis=-1, keepdims=True)
        move = nodes.xyz_mm - exact
        # Off the tangent plane only by the curvature, move^2 / 2R.
        assert np.abs(np.einsum("...i,...i", move, normals)).max() < 0.8**2 / (2 * 8.0)
        second = np.cross(normals, first)
        moves.append([np.einsum("...i,...i", move, e).ravel() for e in (first, second)])
    draws = np.concatenate(moves, axis=1)
    spread = 3 * 0.2 / np.sqrt(2 * draws.shape[1])
    np.testing.assert_allclose(draws.std(axis=1), 0.2, atol=spread)
    assert abs(np.corrcoef(draws)[0, 1]) < 3 / np.sqrt(draws.shape[1])


def test_the_seed_decides() -> None:
    flaws = [Imperfections(edge_mm=8.0, seed=seed) for seed in (0, 0, 1)]
    a, b, c = (subject("S1", layout=SMALL, imperfections=f).scans["flex090worn"] for f in flaws)
    np.testing.assert_array_equal(a.vertices_mm, b.vertices_mm)
    assert not np.allclose(a.vertices_mm[:50], c.vertices_mm[:50])


def test_a_random_subject_is_complete() -> None:
    person = subject(random_knee(1, 0), imperfections=Imperfections(edge_mm=8.0))
    assert person.knee.label == "R001"
    assert ((person.overlap.iou > 0.2) & (person.overlap.iou <= person.overlap.strict)).all()
    assert (person.overlap.strict <= person.overlap.paper + ROUNDING).all()


def test_unknown_subjects_and_impossible_options_are_refused() -> None:
    with pytest.raises(UsageError, match="synth-unknown-subject"):
        subject("S9")
    for option in ({"edge_mm": 0.01}, {"noise_mm": -1.0}, {"holes": 51}, {"seed": -1}):
        with pytest.raises(UsageError, match="synth-option"):
            Imperfections(**option)  # type: ignore[arg-type]


def test_the_generator_and_the_analysis_share_no_code() -> None:
    package = Path(kiribench.__file__).parent
    analysis = ("kiribench.surface", "kiribench.strain", "kiribench.conformability")

    def imported(folder: str) -> set[str]:
        found = set()
        for file in (package / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module:
                    found.add(node.module)
                elif isinstance(node, ast.Import):
                    found |= {alias.name for alias in node.names}
        return found

    assert STORED and imported("synthetic")
    assert not [name for name in imported("synthetic") if name.startswith(analysis)]
    for folder in ("surface", "strain", "conformability"):
        assert not [n for n in imported(folder) if n.startswith("kiribench.synthetic")]
