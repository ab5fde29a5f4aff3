"""The skin that a patch is to be worn on: a subject's bare flexed scan, prepared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.dataset import Subject
from kiribench.fem.surface_map import NodeSpline
from kiribench.fem.wear_rest import RestMap, rest_of_skin
from kiribench.fem.wear_skin import fill_nodes
from kiribench.lattice import CutMap
from kiribench.schema.layout import Layout
from kiribench.surface.acquisition import Acquired, Denoise, acquire
from kiribench.surface.nodes import LocatedNodes

FloatArray = NDArray[np.float64]

BARE, REST = "flex090", "flex000"


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

    @cached_property
    def rest(self) -> RestMap | None:
        """Where the flat patch comes to lie on the skin at rest; None where that is flat, or
        was not scanned and so has to be taken as flat.

        Raises:
            NodesError: ``skin-not-flat``; no flat patch can be laid on it.
        """
        if self.rest_nodes_mm is None:
            return None
        rows, columns = self.region.shape
        patch = CutMap.uniform(0.0, 0.0, rows, columns, self.pitch_mm)
        return rest_of_skin(self.rest_nodes_mm, self.pitch_mm, patch, self.origin_q_mm)

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
        NodesError: ``nodes-too-few``; too few nodes for a smooth map of the skin.
    """
    subject.require(BARE)
    layout = subject.layout
    layout.check_patch()
    bare = acquire(subject, BARE, denoise=denoise)
    seen_mm = bare.nodes.positions_mm
    rest = None
    if subject.has(REST):
        table = subject.nodes(REST)
        rest = np.full(seen_mm.shape, np.nan)
        seen = table.present
        rest[table.row[seen], table.col[seen]] = table.xyz_mm[seen]
        rest = fill_nodes(rest)
    return Skin(
        participant=subject.id,
        side=subject.side or "",
        layout=layout,
        bare=bare,
        under=bare.nodes.window(*layout.patch_offset, layout.patch.node_shape),
        region=np.array([list(row) for row in layout.regions.labels]),
        nodes_mm=fill_nodes(seen_mm),
        filled=np.asarray(~np.isfinite(seen_mm).all(axis=-1)),
        files=tuple(subject.files),
        rest_nodes_mm=rest,
    )
