"""The worn model of a skin: poses reach it, and what cuts cannot change."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from kiribench.design.worn_model import KneeModel
from kiribench.fem.surface_map import Cylinder
from kiribench.lattice import CutMap

POSE: dict[str, Any] = {"offset_mm": (1.0, -0.7), "turn_deg": 3.0, "strap_slip_mm": 2.0}


def model() -> KneeModel:
    """A patch of 3 x 2 cells on a stretched cylinder."""
    skin = SimpleNamespace(surface=Cylinder(40.0, 1.05, 1.3), origin_q_mm=(0.0, 0.0), rest=None)
    return KneeModel(cast(Any, skin))


def cuts(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.3, 0.8, 12)


def cut_map(values: np.ndarray) -> CutMap:
    a, b = values.reshape(2, 3, 2)
    return CutMap(a, b, 15.0)


def test_the_derivatives_are_those_of_the_pose() -> None:
    knee, p = model(), cuts(1)
    found = knee.sensitivities(cut_map(p), 6, **POSE)
    assert found.worn.corner_q_mm == pytest.approx(knee.worn(cut_map(p), 6, **POSE).corner_q_mm)
    way = np.random.default_rng(2).standard_normal(12)
    step = 1e-4
    ahead, back = (knee.worn(cut_map(p + s * step * way), 6, **POSE) for s in (1, -1))
    slope = (ahead.corner_q_mm - back.corner_q_mm).ravel() / (2 * step)
    assert found.corner_q @ way == pytest.approx(slope, abs=1e-4 * np.abs(slope).max())
    exact = knee.sensitivities(cut_map(p), 6).corner_q @ way
    assert np.abs(exact - slope).max() > 0.01 * np.abs(slope).max()


@pytest.mark.parametrize("seed", [1, 2])
def test_on_a_skin_that_looks_the_same_everywhere_no_cuts_change_an_offset(seed: int) -> None:
    # Along and around a cylinder every offset is a motion: the patch is carried by just as much,
    # whatever its cuts. What a robust design gains, it gains by the skin's change of shape.
    knee, design = model(), cut_map(cuts(seed))
    exact = knee.worn(design, 6).corner_q_mm
    moved = knee.worn(design, 6, offset_mm=(1.5, -2.0)).corner_q_mm
    assert moved - exact == pytest.approx(np.broadcast_to((1.5, -2.0), exact.shape), abs=1e-7)
