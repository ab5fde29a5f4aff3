"""The nodes table: one row a grid node, with its place on the scan.

Columns: ``row col x_mm y_mm z_mm [face b0 b1 b2] [sd_mm] [status]``. ``row`` and ``col``
count from 0 at the proximal lateral corner; ``face`` counts from 0 in the file's order;
``status`` is ``ok`` (also where empty), ``missing`` or ``hidden``. ``n/a`` stands for no
value. Other columns are kept out of the way.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

REQUIRED_COLUMNS = ("row", "col", "x_mm", "y_mm", "z_mm")
FACE_COLUMNS = ("face", "b0", "b1", "b2")
STATUSES = ("ok", "missing", "hidden")

DEFAULT_NODE_SD_MM = 0.25
"""Used where a table gives no ``sd_mm``: the median error of crossings found on a drawn
1 mm line grid, 0.25 to 0.28 mm (our measurement, to be replaced by the user's own)."""

MAX_COORDINATE_MM = 1e6
"""No body is a kilometre from its scanner; beyond it float32 files lose the millimetre."""

MAX_SD_MM = 100.0

NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
"""A number as it may stand in a table: no underscores, no hexadecimals, no words."""

NO_VALUE = frozenset({"", "n/a", "na"})
"""How a table may say that there is no value, in lower case."""

BARYCENTRIC_SUM_TOLERANCE = 1e-3
"""Three weights printed with three decimals miss 1 by up to this; they are rescaled."""


@dataclass(frozen=True, eq=False)
class NodesTable:
    """The nodes of one acquisition, as the table gives them.

    Attributes:
        file: the table.
        shape: (node rows, node columns) that the layout expects.
        row, col: (k,) int32, 0-based from the proximal lateral corner; each pair once.
        xyz_mm: (k, 3) float64 in the scan's frame; NaN exactly where ``present`` is False
            and the table gives no position.
        face: (k,) int32 0-based face of the scan file, -1 where not given; None if the
            table has no such column.
        barycentric: (k, 3) float64 weights of the face's corners, rows sum to 1, NaN where
            ``face`` is -1; None with ``face``.
        sd_mm: (k,) float64 standard deviation along each surface direction.
        sd_source: ``column``, ``sidecar`` or ``default`` (:data:`DEFAULT_NODE_SD_MM`).
        status: k of ``ok``, ``missing``, ``hidden``.
        line: (k,) int32 line of the file, for messages.
    """

    file: Path
    shape: tuple[int, int]
    row: IntArray
    col: IntArray
    xyz_mm: FloatArray
    face: IntArray | None
    barycentric: FloatArray | None
    sd_mm: FloatArray
    sd_source: Literal["column", "sidecar", "default"]
    status: tuple[str, ...]
    line: IntArray

    def __len__(self) -> int:
        return len(self.row)

    @property
    def grid_shape(self) -> tuple[int, int]:
        """(node rows, node columns); the same as ``shape``."""
        return self.shape

    @property
    def present(self) -> NDArray[np.bool_]:
        """(k,) True where the node was seen: status ``ok``."""
        return np.array([status == "ok" for status in self.status], dtype=bool)

    def grid_xyz_mm(self) -> FloatArray:
        """(node rows, node columns, 3) positions; NaN where a node is absent or not seen."""
        grid = np.full((*self.shape, 3), np.nan)
        seen = self.present
        grid[self.row[seen], self.col[seen]] = self.xyz_mm[seen]
        return grid

    def labels(self) -> tuple[str, ...]:
        """``node (row, col)`` of each row, for messages."""
        return tuple(f"node ({row}, {col})" for row, col in zip(self.row, self.col, strict=True))


@cache
def nodes_schema(node_rows: int, node_columns: int) -> Any:
    """The pandera schema of a nodes table of (node_rows, node_columns).

    Each check's name is the code of the fault that it gives.
    """
    import pandera.pandas as pa

    def between(low: float, high: float, code: str) -> Any:
        return pa.Check.in_range(low, high, name=code, error=f"{low:g} to {high:g}")

    def coordinate() -> Any:
        return pa.Column(
            float,
            between(-MAX_COORDINATE_MM, MAX_COORDINATE_MM, "nodes-coordinate-range"),
            nullable=True,
        )

    def weight() -> Any:
        return pa.Column(
            float,
            between(-1e-6, 1 + 1e-6, "nodes-barycentric"),
            nullable=True,
            required=False,
        )

    return pa.DataFrameSchema(
        {
            "row": pa.Column(int, between(0, node_rows - 1, "nodes-index-range")),
            "col": pa.Column(int, between(0, node_columns - 1, "nodes-index-range")),
            "x_mm": coordinate(),
            "y_mm": coordinate(),
            "z_mm": coordinate(),
            "face": pa.Column(
                float,
                between(0, 2**31 - 1, "nodes-face-range"),
                nullable=True,
                required=False,
            ),
            "b0": weight(),
            "b1": weight(),
            "b2": weight(),
            "sd_mm": pa.Column(
                float, between(0.0, MAX_SD_MM, "nodes-sd"), nullable=True, required=False
            ),
            "status": pa.Column(
                str,
                pa.Check.isin(STATUSES, name="nodes-status", error="ok, missing or hidden"),
                required=False,
            ),
        },
        name="nodes",
    )


REMEDIES = {
    "nodes-coordinate-range": "Give millimetres in the scan's frame; move far-away scans first.",
    "nodes-barycentric": "Give the weights of the face's three corners; they sum to 1.",
    "nodes-index-range": "Count rows and columns from 0, proximal lateral first; describe another "
    "grid under Grid (nodes of worn scans: under Patch) in dataset_description.json.",
    "nodes-face-range": "Count the scan's faces from 0.",
    "nodes-sd": "Give the standard deviation of the node's position in millimetres.",
    "nodes-status": "Write ok, missing or hidden.",
}
"""What to do about a fault of the schema, by its code."""
