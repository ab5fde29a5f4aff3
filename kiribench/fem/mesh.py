"""Meshes of cut sheets: six-node triangles graded towards the cut tips, seams as split nodes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MeshSpec:
    """How fine a mesh is, on facets of ``cell_mm / 2``.

    Attributes:
        edge_fraction: longest element edge / facet edge.
        tip_fraction: edge at a cut tip / the shorter of the cut half and the ligament beside it.
        growth: growth of the element edge with distance from a tip (mm per mm).
    """

    edge_fraction: float = 0.5
    tip_fraction: float = 0.3
    growth: float = 0.5

    def coarser(self) -> MeshSpec:
        """The mesh twice as coarse, for error estimates."""
        return MeshSpec(2 * self.edge_fraction, 2 * self.tip_fraction, 2 * self.growth)
