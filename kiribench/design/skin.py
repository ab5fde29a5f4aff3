"""The skin that a patch is to be worn on: a subject's bare flexed scan, prepared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.dataset import Subject
from kiribench.errors import NodesError
from kiribench.fem.surface_map import NodeSpline
from kiribench.schema.layout import Layout
from kiribench.surface.acquisition import Acquired, Denoise, acquire
from kiribench.surface.nodes import LocatedNodes

FloatArray = NDArray[np.float64]

BARE, REST = "flex090", "flex000"

#: More missing nodes than this share cannot be filled in with confidence.
MOST_MISSING = 0.1


@dataclass(frozen=True, eq=False)
class Skin:
    """The bare scan in the worn pose with its grid, and where the patch belongs on it.

    Attributes:
        participant, side: of the subject. layout: grid, patch and regions.
        bare: the scan ``flex090`` with its nodes.
        under: (R+1, C+1) the nodes under the patch's corners.
        region: (R, C) labels.
        nodes_mm: (rows+1, columns+1, 3) all nodes of the grid; the missing ones filled in.
        filled: (rows+1, columns+1) which were.
        files: what was read.
        rest_nodes_mm: the same of the scan at rest (flex000), or None without it.
    """

    participant: str
    side: str
    layout: Layout
    bare: Acquired
    under: LocatedNodes
    region: NDArray[np.str_]
    nodes_mm: FloatArray
    filled: NDArray[np.bool_]
    files: tuple[Path, ...] = ()
    rest_nodes_mm: FloatArray | None = None

    @property
    def pitch_mm(self) -> float:
        """Distance of the grid's nodes as drawn, mm."""
        return self.layout.grid.pitch_mm

    @cached_property
    def surface(self) -> NodeSpline:
        """The smooth map from skin coordinates to places, through all nodes."""
        return NodeSpline.of(self.nodes_mm, self.pitch_mm)

    @property
    def origin_q_mm(self) -> tuple[float, float]:
        """Skin coordinates (u, v) of the node under the patch's corner (0, 0), mm."""
        row, column = self.layout.patch_offset
        return float(column * self.pitch_mm), float(row * self.pitch_mm)

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) skin coordinates of the nodes under the patch's corners, mm."""
        rows, columns = self.layout.patch.node_shape
        steps = np.meshgrid(np.arange(columns), np.arange(rows))
        return np.asarray(np.array(self.origin_q_mm) + self.pitch_mm * np.stack(steps, axis=-1))

    def places(self, q_mm: FloatArray) -> FloatArray:
        """(..., 3) mm of skin coordinates (..., 2) mm on the smooth map."""
        flat = np.ascontiguousarray(q_mm.reshape(-1, 2))
        return np.asarray(self.surface.at(flat).x.reshape(*q_mm.shape[:-1], 3))


def skin_of(subject: Subject, *, denoise: Denoise = "auto") -> Skin:
    """Load the bare flexed scan of a subject.

    Raises:
        DatasetError, MeshError, NodesError: what is wrong with the input.
        NodesError: ``skin-nodes-missing``; too few nodes for a smooth map of the skin.
    """
    subject.require(BARE)
    layout = subject.layout
    layout.check_patch()
    bare = acquire(subject, BARE, denoise=denoise)
    nodes, filled = filled_grid(bare.nodes.positions_mm)
    rest = None
    if subject.has(REST):
        table = subject.nodes(REST)
        rest = np.full(nodes.shape, np.nan)
        seen = table.present
        rest[table.row[seen], table.col[seen]] = table.xyz_mm[seen]
        rest = filled_grid(rest)[0]
    return Skin(
        participant=subject.id,
        side=subject.side or "",
        layout=layout,
        bare=bare,
        under=bare.nodes.window(*layout.patch_offset, layout.patch.node_shape),
        region=np.array([list(row) for row in layout.regions.labels]),
        nodes_mm=nodes,
        filled=filled,
        files=tuple(subject.files),
        rest_nodes_mm=rest,
    )


def filled_grid(nodes_mm: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Fill missing nodes so that second differences along rows and columns are smallest.

    Args:
        nodes_mm: (m, n, 3) positions, NaN where missing.

    Returns:
        (m, n, 3) without NaN, and (m, n) which were filled in.

    Raises:
        NodesError: ``skin-nodes-missing``, where more than a tenth is missing.
    """
    missing = np.asarray(~np.isfinite(nodes_mm).all(axis=-1))
    if not missing.any():
        return nodes_mm, missing
    if missing.mean() > MOST_MISSING or min(nodes_mm.shape[:2]) < 3:
        raise NodesError(
            "skin-nodes-missing",
            "Too many nodes of the flexed scan are missing for a smooth map of the skin.",
            remedy="Complete the nodes table of flex090.",
            got=f"{int(missing.sum())} of {missing.size} missing",
            expected=f"at most {100 * MOST_MISSING:g} %",
        )
    shape = missing.shape
    number = np.arange(missing.size).reshape(shape)
    triples = [
        np.stack([number[:-2], number[1:-1], number[2:]], axis=-1).reshape(-1, 3),
        np.stack([number[:, :-2], number[:, 1:-1], number[:, 2:]], axis=-1).reshape(-1, 3),
    ]
    lines = np.concatenate(triples)
    matrix = np.zeros((len(lines), missing.size))
    for column, weight in enumerate((1.0, -2.0, 1.0)):
        matrix[np.arange(len(lines)), lines[:, column]] = weight
    flat, gone = nodes_mm.reshape(-1, 3), missing.ravel()
    known = matrix[:, ~gone] @ flat[~gone]
    out = flat.copy()
    out[gone] = np.linalg.lstsq(matrix[:, gone], -known, rcond=None)[0]
    return out.reshape(nodes_mm.shape), missing
