"""What is followed through the frames of a test: a speckled sheet, or marks at its corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError
from kiribench.tensile.camera import make_view
from kiribench.tensile.cells import CellStates, SpeckleCells, cells_of_corners, local_scale
from kiribench.tensile.elements import Block, make_elements
from kiribench.tensile.follow import Follower, FollowOptions
from kiribench.tensile.frames import FrameList
from kiribench.tensile.markers import MarkerFollower
from kiribench.tensile.sidecar import Sidecar

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

#: Unit vectors in the picture, x to the right and y down.
PULLS = {"down": (0.0, 1.0), "up": (0.0, -1.0), "right": (1.0, 0.0), "left": (-1.0, 0.0)}


@dataclass(frozen=True)
class MeasureOptions:
    """How a test is measured.

    Attributes:
        zncc: least correlation at which a part of the sheet counts as found.
    """

    zncc: float = 0.75


class FollowedSpeckle:
    """A speckled sheet."""

    def __init__(
        self,
        first: Float32Array,
        block: Block,
        declared: Sidecar,
        options: MeasureOptions,
        frames: FrameList,
        file: str,
    ) -> None:
        self._block = block
        elements = make_elements(block, cut=declared.cut, beyond=not declared.cells.outline)
        if elements.edge_px.min() < 14:
            raise DatasetError(
                "tensile-resolution",
                "The cells are too small in the pictures for speckle.",
                remedy="Go closer, or follow dots.",
                file=file,
                got=f"{2 * elements.edge_px.min():.0f} px a cell",
                expected="at least 28",
            )
        self.view = make_view(declared, block, frames.size_px, None, file)
        self._follower = Follower(
            first,
            elements,
            np.array(PULLS[declared.pull]) if len(declared.cells.corners_px) == 2 else _pull(block),
            cut=declared.cut,
            options=FollowOptions(options.zncc, options.zncc),
        )
        flat = ~self._follower.usable
        if flat.mean() > 0.3:
            raise DatasetError(
                "tensile-texture",
                f"{int(flat.sum())} of {len(flat)} parts of the block show no speckle, or are not "
                "in the first picture.",
                remedy="Check corners_px; spray a matt speckle; or declare the block as "
                'the whole sheet ("outline": true).',
                file=file,
            )
        self._cells = SpeckleCells(block, elements, self.view, cut=declared.cut)

    def at_rest(self) -> CellStates:
        """The cells in the first picture."""
        count = self._block.rows * self._block.columns
        return CellStates(
            np.ones(count),
            np.ones(count),
            np.zeros((count, 2)),
            np.full(count, "ok", dtype="<U16"),
            self._cells.rest,
            np.ones(2),
        )

    def corner_px_at_rest(self) -> FloatArray:
        """(rows + 1, columns + 1, 2) px, x then y, in the first picture."""
        return self._corner_px(self._cells.rest)

    def step(self, picture: Float32Array, back: FloatArray) -> tuple[CellStates, FloatArray]:
        """Follow into the next picture: the cells, and the corners in px.

        ``back`` (2, 3) takes the plane to where the camera stood at rest.
        """
        seen = self._follower.step(picture)
        state = self._cells.read(seen, back)
        pixels = self._cells.corner_px(seen)
        return state, pixels

    def _corner_px(self, _: FloatArray) -> FloatArray:
        shape = (self._block.rows + 1, self._block.columns + 1, 2)
        return self._block.px(self._block.corner_lattice()).reshape(shape)

    shifted_steps = 0

    @property
    def large_steps(self) -> int:
        """Elements that were found again after a large step."""
        return self._follower.relocated


class FollowedMarkers:
    """A sheet with dots, a drawn grid, or slits that are seen."""

    def __init__(
        self, first: Float32Array, block: Block, declared: Sidecar, frames: FrameList, file: str
    ) -> None:
        self._block = block
        self._follower = MarkerFollower(
            first,
            block,
            declared.marker,
            bright=declared.bright,
            pull=_pull(block),
            file=file,
        )
        marks = self._follower.marks() if declared.marker != "grid" else None
        self.view = make_view(declared, block, frames.size_px, marks, file)
        self._shape = (block.rows + 1, block.columns + 1)
        self._rest = self.view.plane(self._follower.first_px).reshape(*self._shape, 2)
        self._rest_sd = self._follower.first_sd * local_scale(self.view, self._follower.first_px)

    def at_rest(self) -> CellStates:
        """The cells in the first picture."""
        sd = np.zeros(self._shape)
        status = self._follower.first_status.reshape(self._shape)
        return cells_of_corners(self._rest, self._rest, sd, status)

    def corner_px_at_rest(self) -> FloatArray:
        """(rows + 1, columns + 1, 2) px, x then y, in the first picture."""
        return self._follower.first_px.reshape(*self._shape, 2)

    def step(self, picture: Float32Array, back: FloatArray) -> tuple[CellStates, FloatArray]:
        """Follow into the next picture: the cells, and the corners in px.

        ``back`` (2, 3) takes the plane to where the camera stood at rest.
        """
        seen = self._follower.step(picture)
        now = self.view.plane(seen.px) @ back[:, :2].T + back[:, 2]
        # The places in the first picture have their noise too.
        sd = seen.sd_px * local_scale(self.view, seen.px)
        if not self._follower.by_templates:
            sd = np.hypot(sd, self._rest_sd)
        status = seen.status.copy()
        hidden = self._follower.first_status == "hidden"
        status[hidden] = "hidden"
        state = cells_of_corners(
            self._rest,
            now.reshape(*self._shape, 2),
            sd.reshape(self._shape),
            status.reshape(self._shape),
        )
        return state, seen.px.reshape(*self._shape, 2)

    @property
    def shifted_steps(self) -> int:
        """Steps over which the markers may be their neighbours."""
        return self._follower.shifted_steps

    @property
    def large_steps(self) -> int:
        """Steps over which the markers were paired by a map."""
        return self._follower.large_steps


def _pull(block: Block) -> FloatArray:
    """Unit vector of the rows' direction in the first picture."""
    ends = block.px(np.array([[0.0, block.columns / 2], [block.rows, block.columns / 2]]))
    away = ends[1] - ends[0]
    return np.asarray(away / np.linalg.norm(away))
