"""The gradient of a cell and its decompositions, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import logm, polar
from tolerances import LINEAR_ALGEBRA

from kiribench.strain.gradient import (
    decompose,
    gradient_of,
    material_frame,
    mid_lines,
    signed_area,
    triangular,
)

#: A 15 mm cell in the material frame: corners proximal-lateral, proximal-medial,
#: distal-medial, distal-lateral; first axis distal, second medial.
CELL = 7.5 * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


matrices = st.builds(
    lambda a, b, g, t: rotation(t) @ triangular(a, b, g),
    st.floats(0.5, 2.0),
    st.floats(0.5, 2.0),
    st.floats(-0.8, 0.8),
    st.floats(-3.0, 3.0),
)


def test_simple_shear_leaves_both_fibre_stretches_at_one() -> None:
    # x_long += 0.3 x_lat: the lateral edges lengthen by 4.4 %, the width does not change.
    deformed = CELL @ np.array([[1.0, 0.3], [0.0, 1.0]]).T
    parts = decompose(gradient_of(material_frame(CELL), material_frame(deformed)))
    edge = np.linalg.norm(deformed[1] - deformed[0]) / 15.0
    assert edge == pytest.approx(np.sqrt(1.09), abs=LINEAR_ALGEBRA)
    assert float(parts.longitudinal_stretch) == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    assert float(parts.lateral_stretch) == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    assert float(parts.shear) == pytest.approx(0.3, abs=LINEAR_ALGEBRA)
    assert float(parts.area_ratio) == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    # Green: (0, 0.045, 0.15); principal stretches of simple shear g: (g/2 + sqrt(1+g^2/4)).
    np.testing.assert_allclose(parts.green, [0.0, 0.045, 0.15], atol=LINEAR_ALGEBRA)
    larger = 0.15 + np.sqrt(1.0 + 0.0225)
    np.testing.assert_allclose(
        parts.principal_stretches, [larger, 1.0 / larger], atol=LINEAR_ALGEBRA
    )
    # The polar rotation of a simple shear g is -atan(g / 2): lateral fibre towards distal.
    assert float(parts.rotation) == pytest.approx(-np.arctan(0.15), abs=LINEAR_ALGEBRA)


def test_pure_stretch_along_the_fibres() -> None:
    parts = decompose(gradient_of(CELL, CELL * [1.25, 0.9]))
    np.testing.assert_allclose(parts.gradient, np.diag([1.25, 0.9]), atol=LINEAR_ALGEBRA)
    assert float(parts.shear) == pytest.approx(0.0, abs=LINEAR_ALGEBRA)
    assert float(parts.rotation) == pytest.approx(0.0, abs=LINEAR_ALGEBRA)
    assert float(parts.principal_angle) == pytest.approx(0.0, abs=LINEAR_ALGEBRA)
    np.testing.assert_allclose(parts.hencky, [np.log(1.25), np.log(0.9), 0.0], atol=LINEAR_ALGEBRA)


@settings(deadline=None)
@given(matrices)
def test_decomposition_agrees_with_scipy(matrix: np.ndarray) -> None:
    parts = decompose(matrix)
    r, u = polar(matrix)
    assert float(np.cos(parts.rotation)) == pytest.approx(r[0, 0], abs=1e-9)
    assert float(np.sin(parts.rotation)) == pytest.approx(r[1, 0], abs=1e-9)
    np.testing.assert_allclose(
        parts.principal_stretches, np.linalg.svd(matrix, compute_uv=False), atol=1e-9
    )
    log = logm(u)
    np.testing.assert_allclose(parts.hencky, [log[0, 0], log[1, 1], log[0, 1]], atol=1e-8)
    green = 0.5 * (matrix.T @ matrix - np.eye(2))
    np.testing.assert_allclose(parts.green, [green[0, 0], green[1, 1], green[0, 1]], atol=1e-9)
    # The larger principal stretch is reached in the stated direction.
    axis = np.array([np.cos(parts.principal_angle), np.sin(parts.principal_angle)])
    assert np.linalg.norm(matrix @ axis) == pytest.approx(parts.principal_stretches[0], abs=1e-8)


@settings(deadline=None)
@given(matrices, st.floats(-3.0, 3.0), st.booleans())
def test_nothing_depends_on_how_the_cell_lies_or_on_the_leg_side(
    matrix: np.ndarray, angle: float, mirrored: bool
) -> None:
    deformed = CELL @ matrix.T
    expected = decompose(gradient_of(material_frame(CELL), material_frame(deformed)))
    flip = np.array([1.0, -1.0]) if mirrored else 1.0
    moved = decompose(
        gradient_of(
            material_frame((CELL * flip) @ rotation(-angle).T + 3.0),
            material_frame((deformed * flip) @ rotation(angle).T - 5.0),
        )
    )
    np.testing.assert_allclose(moved.gradient, expected.gradient, atol=1e-9)
    assert float(moved.shear) == pytest.approx(float(expected.shear), abs=1e-9)


def test_both_diagonals_and_nothing_else() -> None:
    # Moving two opposite corners against each other along the hourglass mode changes
    # no mid-line, so the gradient does not see it; it is part of the causes' rest.
    hourglass = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    np.testing.assert_allclose(gradient_of(CELL, CELL + hourglass), np.eye(2), atol=LINEAR_ALGEBRA)
    along, across = mid_lines(CELL)
    np.testing.assert_allclose(along + across, CELL[2] - CELL[0])
    np.testing.assert_allclose(along - across, CELL[3] - CELL[1])


def test_area_of_mid_lines_is_the_quads_area() -> None:
    quad = CELL + np.array([[0.0, 0.0], [1.0, 2.0], [-2.0, 0.5], [0.3, 0.0]])
    x, y = quad.T
    shoelace = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    # Corners run lateral, medial: clockwise in (distal, medial) axes.
    assert float(signed_area(quad)) == pytest.approx(-shoelace, abs=LINEAR_ALGEBRA)


@settings(deadline=None)
@given(st.floats(0.5, 2.0), st.floats(0.5, 2.0), st.floats(-0.8, 0.8), st.floats(-3.0, 3.0))
def test_stretches_and_shear_are_those_that_went_in(
    longitudinal: float, lateral: float, shear: float, turn: float
) -> None:
    parts = decompose(rotation(turn) @ triangular(longitudinal, lateral, shear))
    assert float(parts.longitudinal_stretch) == pytest.approx(longitudinal, abs=1e-9)
    assert float(parts.lateral_stretch) == pytest.approx(lateral, abs=1e-9)
    assert float(parts.shear) == pytest.approx(shear, abs=1e-9)
    # What it says: the angle between the deformed fibres is 90 degrees less atan(shear).
    fibres = rotation(turn) @ triangular(longitudinal, lateral, shear)
    cosine = fibres[:, 0] @ fibres[:, 1] / np.prod(np.linalg.norm(fibres, axis=0))
    assert np.pi / 2.0 - np.arccos(cosine) == pytest.approx(np.arctan(shear), abs=1e-9)


@given(gradient=matrices, shape=matrices)
@settings(max_examples=50, deadline=None)
def test_any_reference_quad_gives_the_gradient_it_was_deformed_by(
    gradient: np.ndarray, shape: np.ndarray
) -> None:
    # A square reference commutes with everything: it cannot tell F from its mirror product.
    trapezoid = CELL * [[1.0, 0.8], [1.0, 0.8], [1.0, 1.1], [1.0, 1.1]]
    reference = trapezoid @ shape.T
    deformed = reference @ gradient.T + [3.0, -2.0]
    np.testing.assert_allclose(gradient_of(reference, deformed), gradient, atol=LINEAR_ALGEBRA)
