"""One acquisition ready for measuring: scan repaired, denoised if need be, nodes on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from kiribench.dataset import Subject
from kiribench.errors import DatasetError, Fault
from kiribench.surface.mesh import Mesh
from kiribench.surface.nodes import LocatedNodes, locate_nodes
from kiribench.surface.read import read_scan
from kiribench.surface.repair import repair_mesh
from kiribench.surface.topology import Topology, topology

Denoise = Literal["auto", "always", "never"]


@dataclass(frozen=True, eq=False)
class Acquired:
    """A scan and its nodes.

    Attributes:
        name: acquisition name.
        mesh: repaired, in mm.
        topology: of ``mesh``.
        nodes: on ``mesh``.
        denoised: whether ``mesh`` was denoised.
        notes: facts for the reader. warnings: what is doubtful.
    """

    name: str
    mesh: Mesh
    topology: Topology
    nodes: LocatedNodes
    denoised: bool
    notes: tuple[str, ...]
    warnings: tuple[Fault, ...]
