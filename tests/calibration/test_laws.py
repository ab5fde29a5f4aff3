"""Laws against formulas of other origin: textbook stresses, energies, stability."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import LINEAR_ALGEBRA

from kiribench.calibration.laws import (
    Law,
    OgdenSum,
    Yeoh,
    bar_stress,
    initial_shear_modulus,
    log_strain_hessian,
    ogden_columns,
    ogden_slopes,
    stability_of,
)
from kiribench.fem.material import NeoHookean, Ogden, uniaxial_stress

LAWS: list[Law] = [
    NeoHookean(0.207),
    Ogden(0.112, 3.29),
    OgdenSum((0.08, 0.03), (1.3, -4.0)),
    Yeoh(0.06, 0.015, -0.001),
]
STRETCH = np.array([1.02, 1.3, 1.9, 3.1])


def energy(law: Law, first: float, second: float) -> float:
    """The energy as the textbooks write it, from all three principal stretches."""
    l = np.array([first, second, 1 / (first * second)])  # noqa: E741
    if isinstance(law, Yeoh):
        x = (l**2).sum() - 3
        return float(law.c1_mpa * x + law.c2_mpa * x**2 + law.c3_mpa * x**3)
    mu = np.atleast_1d(law.mu_mpa)
    alpha = np.atleast_1d(law.alpha)
    return float(sum(2 * m / a**2 * ((l**a).sum() - 3) for m, a in zip(mu, alpha, strict=True)))


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_bar_stress_is_the_slope_of_the_energy(law: Law) -> None:
    for stretch in STRETCH:
        h = 1e-5
        slope = (
            energy(law, stretch + h, (stretch + h) ** -0.5)
            - energy(law, stretch - h, (stretch - h) ** -0.5)
        ) / (2 * h)
        assert bar_stress(law, np.array([stretch]))[0] == pytest.approx(slope, rel=1e-8)


def test_stresses_of_the_textbooks() -> None:
    # Treloar: mu (l - 1/l^2). Mooney-Rivlin's second term is Ogden's alpha = -2.
    np.testing.assert_allclose(
        bar_stress(NeoHookean(0.3), STRETCH), 0.3 * (STRETCH - STRETCH**-2), rtol=LINEAR_ALGEBRA
    )
    np.testing.assert_allclose(
        bar_stress(OgdenSum((0.2, 0.1), (2.0, -2.0)), STRETCH),
        (0.2 + 0.1 / STRETCH) * (STRETCH - STRETCH**-2),
        rtol=LINEAR_ALGEBRA,
    )
    # Yeoh 1993: 2 (l - l^-2) (c1 + 2 c2 (I1 - 3) + 3 c3 (I1 - 3)^2).
    x = STRETCH**2 + 2 / STRETCH - 3
    np.testing.assert_allclose(
        bar_stress(Yeoh(0.1, 0.02, 0.003), STRETCH),
        2 * (STRETCH - STRETCH**-2) * (0.1 + 0.04 * x + 0.009 * x**2),
        rtol=LINEAR_ALGEBRA,
    )


def test_the_finite_elements_law_is_the_same() -> None:
    for law in (NeoHookean(0.207), Ogden(0.112, 3.29), Ogden(0.2, 1.3)):
        np.testing.assert_allclose(
            bar_stress(law, STRETCH), uniaxial_stress(law, STRETCH), rtol=LINEAR_ALGEBRA
        )


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_initial_shear_modulus_is_a_third_of_youngs(law: Law) -> None:
    slope = bar_stress(law, np.array([1 + 1e-7]))[0] / 1e-7
    assert slope / 3 == pytest.approx(initial_shear_modulus(law), rel=1e-6)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_log_strain_hessian_is_that_of_the_energy(law: Law) -> None:
    first, second, h = 1.4, 0.9, 1e-4
    got = log_strain_hessian(law, np.array([first]), np.array([second]))[0]

    def at(i: float, j: float) -> float:
        return energy(law, first * np.exp(i * h), second * np.exp(j * h))

    expected = np.array(
        [
            [at(1, 0) - 2 * at(0, 0) + at(-1, 0), 0.0],
            [0.0, at(0, 1) - 2 * at(0, 0) + at(0, -1)],
        ]
    )
    expected[0, 1] = expected[1, 0] = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4
    np.testing.assert_allclose(got, expected / h**2, rtol=1e-5, atol=1e-6)


def test_derivative_by_the_exponent() -> None:
    alpha, h = np.array([-3.0, 0.7, 4.2]), 1e-6
    slope = (ogden_columns(STRETCH, alpha + h) - ogden_columns(STRETCH, alpha - h)) / (2 * h)
    np.testing.assert_allclose(ogden_slopes(STRETCH, alpha), slope, rtol=1e-6, atol=1e-8)


def test_exponent_zero_is_the_limit() -> None:
    at = ogden_columns(STRETCH, np.array([0.0, 1e-8]))
    np.testing.assert_allclose(at[:, 0], 3 * np.log(STRETCH) / STRETCH, rtol=LINEAR_ALGEBRA)
    np.testing.assert_allclose(at[:, 0], at[:, 1], rtol=1e-6)


@given(st.floats(0.01, 5.0), st.floats(-9.0, 15.0), st.floats(1.01, 4.0))
def test_positive_terms_are_stable(mu: float, alpha: float, stretch: float) -> None:
    if abs(alpha) > 0.05:
        assert stability_of(Ogden(mu, alpha), stretch - 1, points=40).stable


def test_instability_is_where_the_stress_turns() -> None:
    # One-dimensional: uniaxial true stress of this law falls from a strain that a scan finds.
    law = Yeoh(0.06, 0.0, -0.002)
    found = stability_of(law, 3.0, points=3000).first_unstable["uniaxial"]
    stretch = np.linspace(1.0001, 4.0, 30_000)
    true = stretch * bar_stress(law, stretch)
    turns = stretch[np.flatnonzero(np.diff(true) < 0)[0]] - 1
    # The Hessian is a matrix: it can fail before the stress along the pull falls, never after.
    assert found is not None
    assert 0.5 < found <= turns + 2e-3
    # Along the uniaxial path the stress turns where the determinant does.
    assert found == pytest.approx(turns, abs=2e-3)
