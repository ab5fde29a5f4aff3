"""What is followed on a speckled sheet: elements, each a bit of sheet that moves smoothly.

On an uncut sheet the elements are quarters of the cells. On a cut one they are the facets, the
squares of half a cell between four lattice sites: cuts run along their edges only, so nothing
inside of a facet tears. A facet is followed as a whole first, then by small subsets within.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

INNER = 0.86
"""Part of an element's edge that its points cover: the lips of a cut are left out."""
SUBSETS = 3
"""Subsets along the edge of an element."""


@dataclass(frozen=True, eq=False)
class Elements:
    """m elements with p points each, and s subsets with t points each.

    Attributes:
        place: (m, 2) row and column in the grid of half cells; -1 is outside of the block.
        lattice: (m, 2) middle in cells, (along, across), 0 at the block's first corner.
        centre: (m, 2) px. edge_px: (m,) shortest edge.
        xi: (m, p, 2) px relative to the centre.
        subset_of: (m s,) element of each subset.
        subset_centre: (m s, 2) px. subset_xi: (m s, t, 2) px.
        subset_lattice: (m s, 2) middles in cells.
        overlap: width of a subset / distance of subsets, at least 1: how much their noise is
            the same noise.
    """

    place: IntArray
    lattice: FloatArray
    centre: FloatArray
    edge_px: FloatArray
    xi: FloatArray
    subset_of: IntArray
    subset_centre: FloatArray
    subset_xi: FloatArray
    subset_lattice: FloatArray
    overlap: float

    def __len__(self) -> int:
        return len(self.centre)


@dataclass(frozen=True, eq=False)
class Block:
    """The block of R x C followed cells in the first picture.

    Attributes:
        rows, columns: R along the pull, C across.
        to_px: (3, 3) homography from (across, along) in cells to px.
    """

    rows: int
    columns: int
    to_px: FloatArray

    def px(self, lattice: FloatArray) -> FloatArray:
        """(n, 2) px of points (n, 2) given as (along, across) in cells."""
        homogeneous = np.column_stack([lattice[:, 1], lattice[:, 0], np.ones(len(lattice))])
        image = homogeneous @ self.to_px.T
        return np.asarray(image[:, :2] / image[:, 2:])

    def corner_lattice(self) -> FloatArray:
        """((R + 1)(C + 1), 2) the corners of the cells, row after row."""
        along, across = np.mgrid[0 : self.rows + 1, 0 : self.columns + 1]
        return np.column_stack([along.ravel(), across.ravel()]).astype(np.float64)


def make_elements(block: Block, *, cut: bool, beyond: bool) -> Elements:
    """The elements of a block.

    Args:
        block: of cells. cut: whether cuts run along the lines of the half cells.
        beyond: also the half cells around the block, which share its corners.
    """
    rim = 1 if cut and beyond else 0
    rows = np.arange(-rim, 2 * block.rows + rim)
    columns = np.arange(-rim, 2 * block.columns + rim)
    place = np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)
    lattice = np.asarray((place + 0.5) / 2.0, dtype=np.float64)
    centre = np.round(block.px(lattice))
    half = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]]) / 4
    quad = np.stack([block.px(lattice + offset) for offset in half], axis=1)
    sides = np.linalg.norm(quad - np.roll(quad, 1, axis=1), axis=2)
    edge = sides.min(axis=1)
    xi = _points(block, lattice, centre, 0.25 * INNER, edge.max(), limit=28)
    reach = 0.5 * INNER / SUBSETS
    steps = (np.arange(SUBSETS) - (SUBSETS - 1) / 2) * reach
    offsets = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    subset_lattice = (lattice[:, None] + offsets).reshape(-1, 2).astype(np.float64)
    subset_of = np.repeat(np.arange(len(place)), SUBSETS * SUBSETS)
    subset_centre = np.round(block.px(subset_lattice))
    # Subsets of few pixels reach into their neighbours' ground, but not out of the element.
    wide = 0.5 * reach * (1.45 if edge.min() < 60 else 1.0)
    room = 0.25 * (0.5 + 0.5 * INNER) - float(np.abs(offsets).max())
    half_width = min(wide, room)
    subset_xi = _points(block, subset_lattice, subset_centre, half_width, edge.max(), limit=23)
    return Elements(
        place.astype(np.int64),
        lattice,
        centre,
        edge,
        xi,
        subset_of,
        subset_centre,
        subset_xi,
        subset_lattice,
        max(1.0, 2 * half_width / reach),
    )


def _points(
    block: Block,
    lattice: FloatArray,
    centre: FloatArray,
    half: float,
    edge_px: float,
    *,
    limit: int,
) -> FloatArray:
    """(n, p, 2) points relative to the centres, over squares of +- ``half`` cells."""
    wide_px = 4 * half * edge_px  # an element's edge is half a cell
    count = int(np.clip(round(wide_px) + 1, 7, limit))
    steps = np.linspace(-half, half, count)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    place = block.px((lattice[:, None] + grid).reshape(-1, 2)).reshape(len(lattice), -1, 2)
    return np.asarray(place - centre[:, None])
