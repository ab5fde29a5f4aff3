"""Material laws against finite differences and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import TANGENT_DIFFERENCE

from kiribench.fem.material import (
    Material,
    NeoHookean,
    Ogden,
    energy_density,
    response,
    uniaxial_stress,
)

LAWS: list[Material] = [NeoHookean(0.207), Ogden(0.112, 3.29), Ogden(0.2, 1.3)]


def _gradients() -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    found = [np.eye(2), np.diag([1.3, 1.3]), np.array([[0.0, -1.4], [0.8, 0.2]])]
    while len(found) < 12:
        trial = np.eye(2) + 0.5 * rng.normal(size=(2, 2))
        if np.linalg.det(trial) > 0.3:
            found.append(trial)
    return found


def _response(f: np.ndarray, law: Material, projected: float = 0.0) -> tuple[np.ndarray, ...]:
    out = np.zeros(14)
    response(*f.ravel(), law.mu_mpa, float(law.alpha), projected, out)
    tangent = np.zeros((4, 4))
    tangent[np.triu_indices(4)] = out[4:]
    return out[:4], tangent + np.triu(tangent, 1).T


def _energy(f: np.ndarray, law: Material) -> float:
    return float(energy_density(*f.ravel(), law.mu_mpa, float(law.alpha)))


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_stress_and_tangent_are_derivatives_of_the_energy(law: Material) -> None:
    step = 1e-5
    for f in _gradients():
        stress, tangent = _response(f, law)
        moves = step * np.eye(4).reshape(4, 2, 2)
        slope = [(_energy(f + d, law) - _energy(f - d, law)) / (2 * step) for d in moves]
        np.testing.assert_allclose(stress, slope, atol=1e-7)
        curve = [(_response(f + d, law)[0] - _response(f - d, law)[0]) / (2 * step) for d in moves]
        np.testing.assert_allclose(tangent, curve, atol=TANGENT_DIFFERENCE)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_energy_is_objective_and_isotropic(law: Material) -> None:
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for f in _gradients():
        assert _energy(turn @ f, law) == pytest.approx(_energy(f, law), rel=1e-12, abs=1e-15)
        assert _energy(f @ turn, law) == pytest.approx(_energy(f, law), rel=1e-12, abs=1e-15)
        stress = _response(f, law)[0].reshape(2, 2)
        np.testing.assert_allclose(
            _response(turn @ f, law)[0].reshape(2, 2), turn @ stress, atol=1e-12
        )


@pytest.mark.parametrize("part", [0.25, 1.0])
@pytest.mark.parametrize("law", LAWS, ids=str)
def test_projection_takes_its_part_of_negative_eigenvalues_and_changes_no_positive_one(
    law: Material, part: float
) -> None:
    changed = 0
    for f in [*_gradients(), np.diag([0.5, 0.6]), np.array([[0.4, 0.9], [-0.1, 0.7]])]:
        plain, raised = _response(f, law)[1], _response(f, law, part)[1]
        values, vectors = np.linalg.eigh(plain)
        clipped = vectors @ np.diag(np.maximum(values, (1 - part) * values)) @ vectors.T
        np.testing.assert_allclose(raised, clipped, atol=1e-9 * abs(plain).max())
        changed += int(values.min() < 0)
    assert changed >= 2


@pytest.mark.parametrize("mu", [0.1, 0.207])
def test_ogden_with_exponent_two_is_neo_hookean(mu: float) -> None:
    near = Ogden(mu, 2.0 + 1e-9)
    for f in _gradients():
        for one, two in zip(_response(f, near), _response(f, NeoHookean(mu)), strict=True):
            np.testing.assert_allclose(one, two, atol=1e-7)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_initial_stiffness_is_that_of_an_incompressible_sheet(law: Material) -> None:
    tangent = _response(np.eye(2), law)[1]
    mu = law.mu_mpa
    # Plane stress, nu = 1/2, E = 3 mu: E / (1 - nu^2) = 4 mu; shear mu.
    assert tangent[0, 0] == pytest.approx(4 * mu)
    assert tangent[0, 3] == pytest.approx(2 * mu)
    assert tangent[1, 1] == tangent[1, 2] == pytest.approx(mu)


def test_folded_elements_have_infinite_energy() -> None:
    for law in LAWS:
        assert _energy(np.diag([-1.0, 1.0]), law) == np.inf
        assert _energy(np.diag([0.0, 1.0]), law) == np.inf


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_uniaxial_stress_is_the_slope_of_the_uniaxial_energy(law: Material) -> None:
    for stretch in (0.8, 1.2, 2.0):

        def energy(at: float) -> float:
            return _energy(np.diag([at, at**-0.5]), law)

        slope = (energy(stretch + 1e-6) - energy(stretch - 1e-6)) / 2e-6
        assert float(uniaxial_stress(law, np.array(stretch))) == pytest.approx(slope, abs=1e-8)
