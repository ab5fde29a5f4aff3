"""Whether nodes lie as a drawn grid on a limb can: spacing, handedness, order of the poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.dataset.files import Folder
from kiribench.errors import Fault
from kiribench.schema.layout import Layout
from kiribench.schema.nodes import NodesTable
from kiribench.schema.sidecars import MM_PER_UNIT, Side

FloatArray = NDArray[np.float64]

SPACING_ERROR_FACTOR = 3.0
"""No skin stretches threefold; centimetres, inches and metres for millimetres all exceed it."""

SPACING_WARNING_FRACTION = 0.2
"""A grid drawn with a template in the reference pose is nearer to its pitch than this."""

COINCIDENT_FRACTION = 0.02
"""Two nodes nearer than this part of the pitch are one place given twice."""

OUTLIER_FACTOR = 3.0
"""An edge this many times longer than the median has a misplaced node."""

BULGE_MIN = 0.03
"""Least mean bulge over chord length of the grid's rows that shows the convex side."""

JOINT_DEG = 20.0
"""A grid bent less than this from end to end lies on no flexed joint."""

BEND_SWAP_DEG = 30.0
"""The reference pose bends at least this much more than the flexed one: swapped."""


def table_faults(nodes: NodesTable, acquisition: str, pitch_mm: float, file: str) -> list[Fault]:
    """Faults of one table's geometry.

    Codes: ``nodes-isolated``, ``nodes-spacing``, ``nodes-coincident``, and the warnings
    ``nodes-pitch`` and ``nodes-outlier``.
    """
    grid = nodes.grid_xyz_mm()
    edges = np.concatenate([_lengths(grid, 0).ravel(), _lengths(grid, 1).ravel()])
    edges = edges[np.isfinite(edges)]
    if not len(edges):
        return [
            Fault(
                "nodes-isolated",
                "No two neighbouring nodes were seen, so that no cell has an edge.",
                "Find more nodes on the scan.",
                file=file,
            )
        ]
    median = float(np.median(edges))
    faults: list[Fault] = []
    factor = median / pitch_mm
    if not 1 / SPACING_ERROR_FACTOR <= factor <= SPACING_ERROR_FACTOR:
        faults.append(_spacing_error(median, pitch_mm, file))
        return faults
    if acquisition == "flex000" and abs(factor - 1) > SPACING_WARNING_FRACTION:
        faults.append(
            Fault(
                "nodes-pitch",
                "The nodes' spacing in the reference pose is not the drawn pitch.",
                "Check Grid.PitchMm and the rows and columns.",
                file=file,
                got=f"{median:.3g} mm between neighbours (median)",
                expected=f"{pitch_mm:g} mm",
                severity="warning",
            )
        )
    faults += _coincident(nodes, pitch_mm, file)
    faults += _outliers(grid, median, file)
    return faults


def _lengths(grid: FloatArray, axis: int) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(grid, axis=axis), axis=2))


def _spacing_error(median: float, pitch_mm: float, file: str) -> Fault:
    hint = ""
    for unit, millimetres in MM_PER_UNIT.items():
        if unit != "mm" and 0.6 < median * millimetres / pitch_mm < 1.6:
            hint = f" The coordinates seem to be in {unit}."
    return Fault(
        "nodes-spacing",
        f"The nodes' spacing cannot be that of the drawn grid.{hint}",
        "Give x_mm, y_mm, z_mm in millimetres; if the grid has another pitch, say so under "
        "Grid.PitchMm.",
        file=file,
        column="x_mm",
        got=f"{median:.3g} mm between neighbours (median)",
        expected=f"about {pitch_mm:g} mm",
    )


def _coincident(nodes: NodesTable, pitch_mm: float, file: str) -> list[Fault]:
    from scipy.spatial import cKDTree

    seen = np.flatnonzero(nodes.present)
    pairs = cKDTree(nodes.xyz_mm[seen]).query_pairs(COINCIDENT_FRACTION * pitch_mm)
    labels = nodes.labels()
    return [
        Fault(
            "nodes-coincident",
            f"The {labels[seen[b]]} lies where {labels[seen[a]]} lies.",
            "Correct the position of one of them, or set its status to missing.",
            file=file,
            row=int(nodes.line[seen[b]]),
            column="x_mm",
        )
        for a, b in sorted(pairs)[:20]
    ]


def _outliers(grid: FloatArray, median: float, file: str) -> list[Fault]:
    faults = []
    for axis, name in ((0, "longitudinal"), (1, "lateral")):
        for row, col in np.argwhere(_lengths(grid, axis) > OUTLIER_FACTOR * median).tolist():
            other = (row + 1, col) if axis == 0 else (row, col + 1)
            length = float(np.linalg.norm(grid[other] - grid[row, col]))
            faults.append(
                Fault(
                    "nodes-outlier",
                    f"The {name} edge from node ({row}, {col}) to node {other} is far longer "
                    "than the others.",
                    "Check both nodes' row, col and position.",
                    file=file,
                    got=f"{length:.3g} mm",
                    expected=f"about {median:.3g} mm",
                    severity="warning",
                )
            )
    return faults[:20]


@dataclass(frozen=True)
class Handedness:
    """On which side of the grid's ``distal x medial`` normal the surface bulges.

    Attributes:
        bulge: mean over the grid's rows of (distance of the nodes from the row's chord,
            along distal x medial) / chord length; positive if they agree.
        decisive: whether the bulge is large enough, and nearly all rows agree.
    """

    bulge: float
    decisive: bool


def handedness(grid: FloatArray) -> Handedness:
    """The handedness of (rows, columns, 3) node positions, NaN where absent.

    A limb is convex across, so its outside is where the rows bulge to.
    """
    ratios = []
    rows, columns = grid.shape[:2]
    for row in range(rows):
        seen = np.flatnonzero(np.isfinite(grid[row, :, 0]))
        if len(seen) < 3 or seen[-1] - seen[0] < columns // 2:
            continue
        start, end = grid[row, seen[0]], grid[row, seen[-1]]
        distal = _distal(grid, row)
        if distal is None:
            continue
        outward = np.cross(distal, end - start)
        size = float(np.linalg.norm(outward))
        chord = float(np.linalg.norm(end - start))
        if size < 1e-9 or chord < 1e-9:
            continue
        offsets = (grid[row, seen[1:-1]] - start) @ (outward / size)
        ratios.append(float(np.mean(offsets)) / chord)
    if not ratios:
        return Handedness(0.0, False)
    bulge = float(np.mean(ratios))
    agreeing = float(np.mean(np.sign(ratios) == np.sign(bulge)))
    return Handedness(bulge, abs(bulge) >= BULGE_MIN and agreeing >= 0.8)


def _distal(grid: FloatArray, row: int) -> FloatArray | None:
    """(3,) mean direction from the row above to the row below, or None."""
    above, below = max(row - 1, 0), min(row + 1, len(grid) - 1)
    steps = grid[below] - grid[above]
    steps = steps[np.isfinite(steps[:, 0])]
    return np.asarray(steps.mean(axis=0)) if len(steps) else None


def bend_deg(grid: FloatArray) -> float | None:
    """Angle between the grid's proximal and distal ends, degrees; None where unknown."""
    span = max(1, (len(grid) - 1) // 5)
    ends = []
    for first, last in ((0, span), (len(grid) - 1 - span, len(grid) - 1)):
        steps = grid[last] - grid[first]
        steps = steps[np.isfinite(steps[:, 0])]
        if not len(steps):
            return None
        ends.append(steps.mean(axis=0))
    lengths = float(np.linalg.norm(ends[0]) * np.linalg.norm(ends[1]))
    if lengths == 0.0:
        return None
    cosine = ends[0] @ ends[1] / lengths
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def pose_faults(
    tables: Mapping[str, NodesTable], side: Side | None, layout: Layout, folder: Folder
) -> list[Fault]:
    """Faults that only the poses together show.

    Codes: ``poses-swapped``, ``grid-mirrored`` (a warning on an object that no pose bends,
    for there left and right have no meaning), and the warning ``pose-not-flexed``.
    """
    grids = {name: table.grid_xyz_mm() for name, table in tables.items()}
    bends = {name: bend_deg(grid) for name, grid in grids.items()}
    jointed = any(bend is not None and bend >= JOINT_DEG for bend in bends.values())
    faults = [
        _mirrored(side or "", jointed, folder.name(tables[name].file))
        for name, grid in grids.items()
        if _is_mirrored(handedness(grid), side)
    ]
    straight, flexed = bends.get("flex000"), bends.get("flex090")
    if straight is None or flexed is None:
        return faults
    if straight > flexed + BEND_SWAP_DEG:
        faults.append(
            Fault(
                "poses-swapped",
                "The grid of flex000 is bent more than that of flex090: the poses are swapped.",
                "Swap the files of flex000 and flex090 back.",
                file=folder.name(tables["flex000"].file),
                got=f"bent by {straight:.0f} degrees, flex090 by {flexed:.0f}",
                expected="less than flex090",
            )
        )
    elif flexed < straight + JOINT_DEG:
        faults.append(
            Fault(
                "pose-not-flexed",
                f"The grid of flex090 is hardly bent more than that of flex000: this is no "
                f"{layout.body_part} at 90 degrees.",
                "Check that the two scans are not of the same pose; for a test object that does "
                "not bend, go on.",
                file=folder.name(tables["flex090"].file),
                got=f"bent by {flexed:.0f} degrees, flex000 by {straight:.0f}",
                expected=f"at least {JOINT_DEG:.0f} degrees more",
                severity="warning",
            )
        )
    return faults


def _is_mirrored(shape: Handedness, side: Side | None) -> bool:
    expected = {"right": 1.0, "left": -1.0}.get(side or "", 0.0)
    return bool(expected and shape.decisive and np.sign(shape.bulge) != expected)


def _mirrored(side: str, jointed: bool, file: str) -> Fault:
    return Fault(
        "grid-mirrored",
        f"The grid is mirrored: on a {side} limb with column 0 lateral and row 0 proximal, the "
        "nodes must bulge to the other side."
        + ("" if jointed else " The object does not bend in any pose, so this may be meant."),
        "Check Side; else count the columns from the lateral (outer) edge and the rows from the "
        "top; else the scan itself is mirrored: export it again. For a body part that is not one "
        "of a pair, write Side none.",
        file=file,
        column="col",
        got=f"a grid as on a {'left' if side == 'right' else 'right'} limb",
        expected=f"a {side} limb",
        severity="error" if jointed else "warning",
    )
