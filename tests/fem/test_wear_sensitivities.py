"""Derivatives of the corners by the cut lengths against solutions of changed patches."""

from __future__ import annotations

import numpy as np
import pytest
from curved_skins import Relabelled, knee, sphere_nodes
from tolerances import WEAR_SENSITIVITY

from kiribench.errors import DataError, NotConvergedError
from kiribench.fem import wear_system
from kiribench.fem.surface_map import NodeSpline, Plane
from kiribench.fem.wear import WearSpec, wear_patch, wear_sensitivities
from kiribench.fem.wear_sensitivities import half_cut_weights
from kiribench.lattice import CutMap

ORIGIN = (-15.0, -20.0)
STEP = 1e-4


def _maps(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    a, b = np.random.default_rng(8).uniform(0.3, 0.8, (2, rows, columns))
    return a, b


def _moved(a: np.ndarray, b: np.ndarray, change: np.ndarray) -> CutMap:
    da, db = change.reshape(2, *a.shape)
    return CutMap(a + da, b + db, 15.0)


def _difference(a, b, way, surface, origin, spec) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Derivative along ``way`` from four solutions; its own error is of fourth order."""
    corners = {
        k: wear_patch(_moved(a, b, k * STEP * way), surface, origin, spec).corner_q_mm.ravel()
        for k in (-2, -1, 1, 2)
    }
    return (8 * (corners[1] - corners[-1]) - (corners[2] - corners[-2])) / (12 * STEP)


@pytest.mark.parametrize("element", ["nine-node", "four-node"])
@pytest.mark.parametrize("straps", ["rows", "hoops", "free"])
def test_every_cut_length_moves_the_corners_as_a_new_solution_does(
    element: str, straps: str
) -> None:
    a, b = _maps(2, 3)
    spec = WearSpec(6, element=element, straps=straps)  # type: ignore[arg-type]
    # A skin of a sphere, stretched by a quarter in all directions.
    skin = NodeSpline.of(sphere_nodes(45.0, 9, 9, 12.5), 10.0)
    surface = Relabelled(skin, (40.0, 40.0)) if straps == "rows" else Plane(1.05, 1.2)
    found = wear_sensitivities(CutMap(a, b, 15.0), surface, ORIGIN, spec).corner_q
    assert found.shape == (3 * 4 * 2, 12)
    largest = np.abs(found).max()
    assert largest > (0.5 if straps == "rows" else 0)
    columns = range(12) if straps == "rows" else (2, 7)
    for column in columns:
        expected = _difference(a, b, np.eye(12)[column], surface, ORIGIN, spec)
        np.testing.assert_allclose(
            found[:, column], expected, rtol=0, atol=WEAR_SENSITIVITY * max(largest, 1.0)
        )


def test_a_direction_of_all_cut_lengths_on_a_knee() -> None:
    a, b = _maps(12, 6)
    surface, origin, spec = knee("S2"), (45.0, 30.0), WearSpec(6)
    found = wear_sensitivities(CutMap(a, b, 15.0), surface, origin, spec)
    way = np.random.default_rng(9).normal(size=144)
    expected = _difference(a, b, way, surface, origin, spec)
    np.testing.assert_allclose(
        found.corner_q @ way, expected, rtol=0, atol=WEAR_SENSITIVITY * np.abs(expected).max()
    )


def test_the_weights_of_the_half_cuts_are_the_lattices() -> None:
    for rows, columns in ((1, 1), (2, 5), (4, 3)):
        a, b = _maps(rows, columns)
        weights = half_cut_weights(rows, columns, 15.0)
        half = weights @ np.concatenate([a.ravel(), b.ravel()])
        expected = CutMap(a, b, 15.0).facet_half_cuts()[0].ravel()
        np.testing.assert_allclose(half, expected, atol=1e-14)


def test_a_cut_of_no_length_has_no_effect_to_first_order() -> None:
    a, b = _maps(2, 2)
    a[0, 0] = 0.0
    found = wear_sensitivities(CutMap(a, b, 15.0), Plane(1, 1.2), ORIGIN, WearSpec(6)).corner_q
    assert np.isfinite(found).all()
    # Its cell still owns halves of the neighbours' cuts.
    assert np.abs(found[:, 0]).max() > 0
    alone = wear_sensitivities(
        CutMap(np.zeros((2, 2)), np.zeros((2, 2)), 15.0), Plane(1, 1.2), ORIGIN, WearSpec(6)
    )
    assert np.abs(alone.corner_q).max() == 0


def test_no_sensitivities_with_friction_or_without_equilibrium(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut_map = CutMap.uniform(0.5, 0.5, 1, 1, 15.0)
    with pytest.raises(DataError, match="wear-sensitivity-friction"):
        wear_sensitivities(cut_map, Plane(), ORIGIN, WearSpec(6, friction=0.2))
    monkeypatch.setattr(wear_system, "_MOST_ITERATIONS", 0)
    with pytest.raises(NotConvergedError, match="wear-not-converged"):
        wear_sensitivities(cut_map, Plane(1, 1.3), ORIGIN, WearSpec(6))
