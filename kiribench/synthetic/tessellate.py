"""Triangulated scans of a smooth surface, a different one at each pose.

The parameter rectangle is covered by staggered rows of points with straight borders, finer
in the middle than towards the border, and jittered inside, so that no two scans share
vertices, and no cell of the grid is cut along triangle edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.synthetic.jet import FloatArray

COARSENING = 1.8
"""Steps grow to so many times the middle's, outwards."""

GROWTH = 1.06
"""Ratio of neighbouring steps where they grow."""

JITTER = 0.02
"""Share of the step by which inner points are moved at random: enough that no two scans share
vertices. Geodesics over the patella multiply the irregularity of the triangles that they cross:
with 0.18 single cells err by .0025 where the others err by .0005."""


@dataclass(frozen=True, eq=False)
class Tessellation:
    """Triangles over the parameter rectangle.

    Attributes:
        q: (n, 2) float64 material coordinates of the vertices.
        faces: (m, 3) int32, counter-clockwise in the (u, v) plane.
    """

    q: FloatArray
    faces: NDArray[np.int32]


def tessellate(
    half_extent_mm: tuple[float, float],
    half_fine_mm: tuple[float, float],
    step_mm: tuple[float, float],
    rng: np.random.Generator,
    *,
    rows_along_u: bool = True,
) -> Tessellation:
    """Staggered triangles over [-U, U] x [-V, V].

    Args:
        half_extent_mm: U and V.
        half_fine_mm: half sizes of the middle rectangle, which has the full resolution.
        step_mm: distance of neighbouring points in u and in v there, in material mm.
        rng: draws the jitter.
        rows_along_u: the direction of the straight rows of points.
    """
    first, second = (0, 1) if rows_along_u else (1, 0)
    along = _graded(half_extent_mm[first], half_fine_mm[first], step_mm[first])
    across = _graded(half_extent_mm[second], half_fine_mm[second], step_mm[second])
    n = len(along) - 1
    index = np.arange(n + 1, dtype=np.float64)
    staggered = np.interp(np.concatenate([[0.0], index[:-1] + 0.5, [n]]), index, along)
    rows = [along if row % 2 == 0 else staggered for row in range(len(across))]
    points = np.concatenate(
        [
            np.stack([row, np.full(len(row), level)], axis=1)
            for row, level in zip(rows, across, strict=True)
        ]
    )
    local = np.concatenate([np.gradient(row) for row in rows])
    noise = JITTER * rng.uniform(-1.0, 1.0, points.shape) * local[:, None]
    inner = (np.abs(points[:, 0]) < along[-1] - 1e-9) & (np.abs(points[:, 1]) < across[-1] - 1e-9)
    near_end = np.concatenate([_near_end(len(row)) for row in rows])
    points += noise * (inner & ~near_end)[:, None]
    faces = _strips(np.array([len(row) for row in rows]))
    if rows_along_u:
        return Tessellation(points, faces)
    return Tessellation(points[:, ::-1].copy(), faces[:, ::-1].copy())


def _near_end(length: int) -> NDArray[np.bool_]:
    out = np.zeros(length, dtype=bool)
    out[[0, 1, -2, -1]] = True
    return out


def _graded(half: float, fine: float, step: float) -> FloatArray:
    """Ascending coordinates from -half to half: step apart inside, up to coarser outside."""
    inside = max(2, round(2.0 * fine / step))
    middle = np.linspace(-fine, fine, inside + 1)
    outer = [0.0]
    size = step
    while outer[-1] < half - fine:
        size = min(size * GROWTH, step * COARSENING)
        outer.append(outer[-1] + size)
    margin = np.array(outer[1:]) * (half - fine) / outer[-1]
    return np.concatenate([-fine - margin[::-1], middle, fine + margin])


def _strips(lengths: NDArray[np.intp]) -> NDArray[np.int32]:
    """Triangles between rows of n + 1 points (even rows) and n + 2 points (odd rows)."""
    starts = np.concatenate([[0], np.cumsum(lengths)])
    faces = []
    for row in range(len(lengths) - 1):
        even, odd = (row, row + 1) if row % 2 == 0 else (row + 1, row)
        e = starts[even] + np.arange(lengths[even])
        o = starts[odd] + np.arange(lengths[odd])
        wide = np.stack([e[:-1], e[1:], o[1:-1]], axis=1)
        narrow = np.stack([o[1:], o[:-1], e], axis=1)
        both = np.concatenate([wide, narrow])
        faces.append(both if row % 2 == 0 else both[:, ::-1])
    return np.concatenate(faces).astype(np.int32)
