"""Metric, normals and Christoffel symbols against textbook surfaces and differences."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import sphere
from tolerances import DIFFERENCE_QUOTIENT, ROUNDING

from kiribench.synthetic.knees import STORED
from kiribench.synthetic.smooth import SmoothSurface

Q = np.random.default_rng(2).uniform(-1.0, 1.0, (60, 2))


def test_the_sphere_has_its_textbook_metric_and_symbols() -> None:
    radius, q = 40.0, 30.0 * Q
    latitude = q[:, 1] / radius
    g, gamma = sphere(radius).metric_and_christoffel(q)
    expected = np.zeros((len(q), 2, 2))
    expected[:, 0, 0], expected[:, 1, 1] = np.cos(latitude) ** 2, 1.0
    np.testing.assert_allclose(g, expected, atol=ROUNDING)
    symbols = np.zeros((len(q), 2, 2, 2))
    symbols[:, 0, 0, 1] = symbols[:, 0, 1, 0] = -np.tan(latitude) / radius
    symbols[:, 1, 0, 0] = np.sin(latitude) * np.cos(latitude) / radius
    np.testing.assert_allclose(gamma, symbols, atol=ROUNDING)
    np.testing.assert_allclose(sphere(radius).area_density(q), np.cos(latitude), atol=ROUNDING)
    np.testing.assert_allclose(sphere(radius).points_mm(q) / radius, sphere(radius).normals(q))


def _knees() -> list[tuple[str, SmoothSurface]]:
    return [
        (f"{name}-{pose}", getattr(knee.build, pose)())
        for name, knee in STORED.items()
        for pose in ("reference", "flexed")
    ]


@pytest.mark.parametrize(("name", "surface"), _knees(), ids=[name for name, _ in _knees()])
def test_the_knees_tangents_are_difference_quotients(name: str, surface: SmoothSurface) -> None:
    q, h = Q * [115.0, 145.0], 1e-4
    for axis, tangent in enumerate(surface.tangents(q)):
        step = np.eye(2)[axis] * h
        quotient = (surface.points_mm(q + step) - surface.points_mm(q - step)) / (2 * h)
        np.testing.assert_allclose(tangent, quotient, atol=DIFFERENCE_QUOTIENT)


@pytest.mark.parametrize(("name", "surface"), _knees(), ids=[name for name, _ in _knees()])
def test_the_knees_symbols_are_those_of_their_metric(name: str, surface: SmoothSurface) -> None:
    # Gamma^k_ij = g^kl (d_i g_lj + d_j g_li - d_l g_ij) / 2, by central differences of g.
    q, h = Q * [115.0, 145.0], 1e-4
    slope = np.stack(
        [(surface.metric(q + e * h) - surface.metric(q - e * h)) / (2 * h) for e in np.eye(2)],
        axis=1,
    )
    first_kind = 0.5 * (np.einsum("nilj->nlij", slope) + np.einsum("njli->nlij", slope) - slope)
    g, gamma = surface.metric_and_christoffel(q)
    expected = np.einsum("nkl,nlij->nkij", np.linalg.inv(g), first_kind)
    np.testing.assert_allclose(gamma, expected, atol=DIFFERENCE_QUOTIENT)
