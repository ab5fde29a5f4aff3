"""The state of a scan on its way through the stages of cleaning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, Severity
from kiribench.surface import connectivity
from kiribench.surface.mesh import FloatArray, IntArray


@dataclass
class Cleaned:
    """The state of a scan on its way through the stages.

    Attributes:
        xyz: (n, 3) float64 vertices, mm; faces: (m, 3) int32, as they are now.
        face_source: (m,) the face of the given mesh that each face was (or lies in, if remade).
        vertex_source: (n,) the vertex of the given mesh that each vertex was.
        welded_to: (n given,) the vertex that stands for each given vertex.
        twin: (m given,) the face that a dropped duplicate equals, itself otherwise.
        flipped: (m,) whether the winding was reversed.
        remade: (m,) whether an edge flip changed the corners (degenerate neighbours).
        faults: what was found, with severity.
        counts: the numbers for the health report.
    """

    xyz: FloatArray
    faces: IntArray
    file: str | None
    face_source: NDArray[np.int64]
    vertex_source: NDArray[np.int64]
    welded_to: NDArray[np.int64]
    twin: NDArray[np.int64]
    flipped: NDArray[np.bool_]
    remade: NDArray[np.bool_]
    faults: list[Fault] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    _grouped: tuple[IntArray, IntArray, NDArray[np.int64]] | None = None

    def edges(self) -> tuple[IntArray, NDArray[np.int64]]:
        """The edge groups (order, starts) of the faces as they are now, computed once."""
        if self._grouped is None or self._grouped[0] is not self.faces:
            order, starts = connectivity.edge_groups(self.faces, len(self.xyz))
            self._grouped = (self.faces, order, starts)
        return self._grouped[1], self._grouped[2]

    @property
    def usable(self) -> bool:
        """Whether no error was found so far."""
        return not any(fault.severity == "error" for fault in self.faults)

    def found(
        self, code: str, what: str, remedy: str, *, severity: Severity = "warning", **more: Any
    ) -> None:
        """Note a fault of this scan."""
        self.faults.append(
            Fault(code, what, remedy=remedy, file=self.file, severity=severity, **more)
        )

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only the faces where ``kept`` (m,) is true."""
        self.faces = np.ascontiguousarray(self.faces[kept])
        self.face_source = self.face_source[kept]
        self.flipped = self.flipped[kept]
        self.remade = self.remade[kept]
