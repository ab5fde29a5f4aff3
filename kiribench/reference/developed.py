"""The skin under a patch laid out flat: the surface of the flat check.

Every cell is a small flat shape (from the scan, by its log map; from a table, a rectangle of its
two stretches). They do not fit together where the skin is curved or the table's numbers are not
compatible: the nodes are placed so that the cells keep their shapes as nearly as they can, as
rigid as possible (Sorkine and Alexa 2007, local and global steps; doi
10.2312/SGP/SGP07/109-116). What is left is stated: it is the part of the knee that a flat check
cannot show.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.outlines import flat_outlines
from kiribench.design.skin import Skin
from kiribench.errors import UsageError
from kiribench.fem.surface_map import NodeSpline

FloatArray = NDArray[np.float64]

ROUNDS = 200
#: A millionth of a cell: further rounds change nothing that is read.
SETTLED_MM = 1e-6


@dataclass(frozen=True, eq=False)
class FlatSkin:
    """The cells under a patch in a plane.

    Attributes:
        nodes_mm: (R+1, C+1, 2) x from lateral to medial, y from proximal to distal.
        pitch_mm: of the grid as drawn.
        strain_rms: rms of (length / wanted length - 1) over the cells' edges: the misfit.
    """

    nodes_mm: FloatArray
    pitch_mm: float
    strain_rms: float

    @cached_property
    def surface(self) -> NodeSpline:
        """Skin coordinates (u, v) from the patch's corner (0, 0) to places (x, y, 0)."""
        zero = np.zeros((*self.nodes_mm.shape[:2], 1))
        return NodeSpline.of(np.concatenate([self.nodes_mm, zero], axis=-1), self.pitch_mm)

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) skin coordinates of the nodes, mm."""
        rows, columns = self.nodes_mm.shape[:2]
        steps = np.meshgrid(np.arange(columns), np.arange(rows))
        return np.asarray(self.pitch_mm * np.stack(steps, axis=-1).astype(np.float64))


def flat_skin_of(skin: Skin) -> FlatSkin:
    """The cells under the patch, flattened from the scan."""
    bare = skin.bare
    outlines = flat_outlines(bare.mesh, skin.under, skin.under, bare.topology)
    return lay_flat(outlines.skin_corners[..., ::-1], skin.pitch_mm)


def flat_skin_of_stretches(
    longitudinal: FloatArray, lateral: FloatArray, pitch_mm: float
) -> FlatSkin:
    """Cells as rectangles of their stretches.

    Args:
        longitudinal, lateral: (R, C) length ratios; NaN where unknown.
        pitch_mm: edge of a cell at rest.
    """
    half_x, half_y = 0.5 * pitch_mm * lateral, 0.5 * pitch_mm * longitudinal
    shapes = np.stack(
        [
            np.stack([-half_x, -half_y], axis=-1),
            np.stack([half_x, -half_y], axis=-1),
            np.stack([half_x, half_y], axis=-1),
            np.stack([-half_x, half_y], axis=-1),
        ],
        axis=2,
    )
    return lay_flat(shapes, pitch_mm)


def lay_flat(shapes: FloatArray, pitch_mm: float) -> FlatSkin:
    """Nodes of a plane grid whose cells are as nearly as possible the given shapes, turned.

    Args:
        shapes: (R, C, 4, 2) corners (r, c), (r, c+1), (r+1, c+1), (r+1, c) in (x, y), mm, each
            cell in a frame of its own; NaN where the cell is unknown.
        pitch_mm: of the grid as drawn.

    Raises:
        UsageError: ``flat-too-small``; fewer than 3 x 3 cells, or most cells unknown.
    """
    rows, columns = shapes.shape[:2]
    known = np.asarray(np.isfinite(shapes).all(axis=(-1, -2)))
    if min(rows, columns) < 3 or known.mean() < 0.5:
        raise UsageError(
            "flat-too-small",
            "A flat check needs the stretches of at least 3 x 3 cells, and of most cells.",
            remedy="Give a design table with its targets, or a subject.",
            got=f"{int(known.sum())} of {rows} x {columns} cells known",
        )
    centred = shapes - shapes.mean(axis=2, keepdims=True)
    # An unknown cell takes the mean shape, with hardly any weight.
    mean = centred[known].mean(axis=0)
    centred = np.where(known[..., None, None], centred, mean)
    weight = np.where(known, 1.0, 1e-3).ravel()
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    corner = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=2
    ).reshape(-1, 4)
    wanted = centred.reshape(-1, 4, 2)
    size = np.ptp(mean, axis=0)
    steps = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    nodes = (np.stack(steps, axis=-1) * size).reshape(-1, 2).astype(np.float64)
    # Global step: every cell pulls its corners, about their mean, to its turned shape.
    project = np.eye(4) - 0.25
    matrix = np.zeros((number.size, number.size))
    for cell, own in zip(corner, weight, strict=True):
        matrix[np.ix_(cell, cell)] += own * project
    matrix[0, 0] += 1.0  # where the grid as a whole lies is free
    inverse = np.linalg.inv(matrix)
    for _ in range(ROUNDS):
        now = nodes[corner] - nodes[corner].mean(axis=1, keepdims=True)
        dot = (wanted * now).sum(axis=(1, 2))
        wedge = (wanted[..., 0] * now[..., 1] - wanted[..., 1] * now[..., 0]).sum(axis=1)
        angle = np.arctan2(wedge, dot)
        turned = _turn(wanted, angle)
        load = np.zeros_like(nodes)
        np.add.at(load, corner, weight[:, None, None] * turned)
        load[0] += nodes[0]
        moved = inverse @ load
        change = float(np.abs(moved - nodes).max())
        nodes = moved
        if change < SETTLED_MM:
            break
    nodes = _upright(nodes.reshape(rows + 1, columns + 1, 2))
    flat = nodes.reshape(-1, 2)
    edge = np.linalg.norm(np.roll(flat[corner], -1, axis=1) - flat[corner], axis=-1)
    asked = np.linalg.norm(np.roll(wanted, -1, axis=1) - wanted, axis=-1)
    misfit = (edge / asked - 1)[known.ravel()]
    return FlatSkin(nodes, pitch_mm, float(np.sqrt((misfit**2).mean())))


def _turn(points: FloatArray, angle: FloatArray) -> FloatArray:
    """(k, 4, 2) turned by (k,) radians."""
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _upright(nodes: FloatArray) -> FloatArray:
    """Corner (0, 0) in the origin, the way from the first to the last row along y."""
    nodes = nodes - nodes[0, 0]
    along = nodes[-1].mean(axis=0) - nodes[0].mean(axis=0)
    angle = np.arctan2(along[0], along[1])
    return _turn(nodes.reshape(1, -1, 2), np.array([angle])).reshape(nodes.shape)
