"""The skin laid flat: exact where it can be, and honest where it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from elbow import elbow_skin

from kiribench.errors import UsageError
from kiribench.reference.developed import flat_skin_of, flat_skin_of_stretches, lay_flat


def test_shapes_that_fit_together_are_laid_without_strain() -> None:
    rng = np.random.default_rng(1)
    nodes = np.stack(np.meshgrid(np.arange(4.0), np.arange(5.0)), axis=-1) * (14.0, 19.0)
    nodes += 1.5 * rng.standard_normal(nodes.shape)
    shapes = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    angles = rng.uniform(-0.6, 0.6, shapes.shape[:2])
    cos, sin = np.cos(angles)[..., None], np.sin(angles)[..., None]
    turned = np.stack(
        [
            cos * shapes[..., 0] - sin * shapes[..., 1],
            sin * shapes[..., 0] + cos * shapes[..., 1],
        ],
        axis=-1,
    )
    found = lay_flat(turned + 7.0, 15.0)
    assert found.strain_rms < 1e-6
    for step in ((0, 1), (1, 0)):
        apart = np.linalg.norm(np.roll(nodes, step, (0, 1)) - nodes, axis=-1)[1:, 1:]
        laid = np.linalg.norm(np.roll(found.nodes_mm, step, (0, 1)) - found.nodes_mm, axis=-1)
        assert laid[1:, 1:] == pytest.approx(apart, abs=1e-4)


def test_uniform_stretches_give_a_rectangle() -> None:
    found = flat_skin_of_stretches(np.full((4, 3), 1.3), np.full((4, 3), 1.1), 15.0)
    steps = np.stack(np.meshgrid(np.arange(4), np.arange(5)), axis=-1)
    assert found.nodes_mm == pytest.approx(steps * (16.5, 19.5), abs=1e-9)
    assert found.strain_rms < 1e-12
    place = found.surface.at(np.array([[22.5, 30.0]])).x[0]
    assert place == pytest.approx((24.75, 39.0, 0.0), abs=1e-9)


def test_a_cell_without_a_target_does_not_matter() -> None:
    along, across = np.full((4, 3), 1.3), np.full((4, 3), 1.1)
    along[1, 1] = across[1, 1] = np.nan
    found = flat_skin_of_stretches(along, across, 15.0)
    assert found.nodes_mm[-1, -1] == pytest.approx((49.5, 78.0), abs=1e-6)
    with pytest.raises(UsageError, match="most cells"):
        flat_skin_of_stretches(np.full((4, 3), np.nan), across, 15.0)


def test_a_bent_tube_does_not_lie_flat_and_says_so() -> None:
    found = flat_skin_of(elbow_skin())
    # The front of the bent tube is longer than its flanks, so rows are arcs: doubly curved.
    assert 0.005 < found.strain_rms < 0.2
    assert found.nodes_mm[-1, 2, 1] > 60.0  # stretched: 6 cells of 10 mm at rest
