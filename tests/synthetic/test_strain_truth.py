"""Strain truth against surfaces whose strains are known, and against the paper's pattern."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import cylinder, plane, sheared_plane
from synthetic_subjects import stored_subject
from tolerances import DIFFERENCE_QUOTIENT, GEODESIC_BVP_MM

from kiribench.synthetic.knees import STORED
from kiribench.synthetic.strain_truth import right_cauchy_green, strain_truth

NODES = np.stack(np.meshgrid(np.arange(-2, 3) * 15.0, np.arange(-3, 4) * 15.0), axis=-1)


def test_a_stretched_cylinder() -> None:
    truth = strain_truth(cylinder(57.0), cylinder(49.0, 1.1, 1.3), NODES)
    np.testing.assert_allclose(truth.lateral_stretch, 1.1, rtol=GEODESIC_BVP_MM)
    np.testing.assert_allclose(truth.longitudinal_stretch, 1.3, rtol=GEODESIC_BVP_MM)
    np.testing.assert_allclose(truth.poisson_ratio, -np.log(1.1) / np.log(1.3))
    np.testing.assert_allclose(truth.shear, 0.0, atol=GEODESIC_BVP_MM)
    np.testing.assert_allclose(
        truth.principal_stretches, np.broadcast_to([1.3, 1.1], (6, 4, 2)), rtol=GEODESIC_BVP_MM
    )


@pytest.mark.parametrize("shear", [0.3, -0.2])
def test_simple_shear(shear: float) -> None:
    truth = strain_truth(sheared_plane(0.0), sheared_plane(shear), NODES)
    np.testing.assert_allclose(truth.shear, shear, rtol=GEODESIC_BVP_MM)
    # Its two longitudinal edges lean, which the edge ratios read as stretch.
    np.testing.assert_allclose(truth.longitudinal_stretch, np.hypot(1.0, shear))
    np.testing.assert_allclose(truth.lateral_stretch, 1.0)


def test_shear_of_a_reference_that_is_itself_drawn_slanted() -> None:
    truth = strain_truth(sheared_plane(0.1), sheared_plane(0.35), NODES)
    # In the frame along the slanted line the same motion is F of the flat plane, turned.
    lean = np.array([0.1, 1.0]) / np.hypot(0.1, 1.0)
    across = np.array([lean[1], -lean[0]])
    f = np.array([[1.0, 0.25], [0.0, 1.0]])
    a, b = f @ across, f @ lean
    c = np.array([[a @ a, a @ b], [a @ b, b @ b]])
    np.testing.assert_allclose(truth.right_cauchy_green, np.broadcast_to(c, (6, 4, 2, 2)))
    np.testing.assert_allclose(truth.shear, c[0, 1] / 1.0)


def test_no_motion_is_no_strain_in_any_coordinates() -> None:
    c = right_cauchy_green(plane(), plane(), NODES)
    np.testing.assert_allclose(c, np.broadcast_to(np.eye(2), c.shape), atol=GEODESIC_BVP_MM)


def test_the_tensor_is_that_of_small_material_squares_on_a_knee() -> None:
    # Lengths and angle of two short material lines, along v and at right angles to it.
    build = STORED["S2"].build
    reference, flexed = build.reference(), build.flexed()
    q, h = np.array([[-40.0, 20.0], [25.0, -35.0], [-80.0, 60.0]]), 1e-4
    x_u, x_v = reference.tangents(q)
    along = x_v / np.linalg.norm(x_v, axis=1, keepdims=True)
    across = np.cross(along, reference.normals(q))
    across *= np.sign(np.einsum("ij,ij->i", across, x_u))[:, None]
    basis = np.stack([x_u, x_v], axis=-1)
    lines = [np.linalg.pinv(basis) @ e[..., None] for e in (across, along)]
    moved = [
        (flexed.points_mm(q + h * line[..., 0]) - flexed.points_mm(q - h * line[..., 0])) / (2 * h)
        for line in lines
    ]
    c = np.stack(
        [np.stack([np.einsum("ij,ij->i", a, b) for b in moved], -1) for a in moved], axis=-2
    )
    np.testing.assert_allclose(
        right_cauchy_green(reference, flexed, q), c, atol=DIFFERENCE_QUOTIENT
    )


@pytest.mark.parametrize("name", STORED)
def test_the_strains_look_like_the_papers_heatmaps(name: str) -> None:
    truth = stored_subject(name).strain
    longitudinal, lateral = truth.longitudinal_stretch - 1.0, truth.lateral_stretch - 1.0
    # "positive stretches in almost all regions", "particularly prominent around the patella"
    assert (longitudinal > 0).mean() > 0.98
    row, column = np.unravel_index(longitudinal.argmax(), longitudinal.shape)
    assert row in range(4, 11) and column in range(3, 9)
    assert 0.3 < longitudinal.max() < 0.5
    # "roughly halved", greater "on both medial and lateral sides of the patella"
    assert 0.4 < lateral.max() / longitudinal.max() < 0.7
    beside = lateral[5:8, [2, 3, 8, 9]].mean()
    assert beside > 2.0 * lateral[:3].mean() and beside > lateral[5:8, 5:7].mean()
    # "small lateral compression" at "the most inferior portion"
    assert -0.08 < lateral[14:].mean() < 0.0
    # nu "predominantly negative", positive "along the inferior portion"
    assert (truth.poisson_ratio < 0).mean() > 0.7
    assert (truth.poisson_ratio[14:, 4:8] > 0).all()
    # shear "across the medial and lateral sides", in opposite senses
    assert np.sign(truth.shear[4, 0]) == -np.sign(truth.shear[4, -1])
    assert np.abs(truth.shear[:, [0, 1, -2, -1]]).mean() > 2 * np.abs(truth.shear[:, 5:7]).mean()


@pytest.mark.parametrize("name", STORED)
def test_the_grid_keeps_its_pitch_at_rest(name: str) -> None:
    edges = stored_subject(name).strain.reference
    for lengths in (edges.lateral_mm, edges.longitudinal_mm):
        assert np.abs(lengths / 15.0 - 1.0).max() < 0.03
        assert abs(lengths.mean() / 15.0 - 1.0) < 0.005
