"""Tessellations are manifold, cover their rectangle, and are nowhere inside out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiribench.synthetic.tessellate import tessellate


@settings(max_examples=25, deadline=None)
@given(
    half=st.tuples(st.floats(30.0, 120.0), st.floats(30.0, 150.0)),
    step=st.tuples(st.floats(3.0, 8.0), st.floats(3.0, 8.0)),
    rows_along_u=st.booleans(),
    seed=st.integers(0, 2**32),
)
def test_triangles_tile_the_rectangle(
    half: tuple[float, float], step: tuple[float, float], rows_along_u: bool, seed: int
) -> None:
    fine = (half[0] - 20.0, half[1] - 20.0)
    made = tessellate(half, fine, step, np.random.default_rng(seed), rows_along_u=rows_along_u)
    a, b, c = (made.q[made.faces[:, i]] for i in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert areas.min() > 0.0  # counter-clockwise, none degenerate
    assert areas.sum() == pytest.approx(4.0 * half[0] * half[1])
    edges = np.sort(made.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert uses.max() == 2
    # One sheet with one border: vertices - edges + faces = 1.
    assert len(made.q) - len(uses) + len(made.faces) == 1
    assert len(np.unique(made.faces)) == len(made.q)


def test_edges_have_the_wanted_length_in_the_middle() -> None:
    made = tessellate(
        (116.0, 146.0), (90.0, 120.0), (3.0, 3.0 * np.sqrt(0.75)), np.random.default_rng(0)
    )
    edges = made.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    ends = made.q[edges]
    middle = (np.abs(ends) < [90.0, 120.0]).all(axis=(1, 2))
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[middle]
    assert lengths.mean() == pytest.approx(3.0, rel=0.03)
    assert lengths.max() < 1.7 * 3.0 and lengths.min() > 0.4 * 3.0
