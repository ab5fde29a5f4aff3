"""The order in which the inner nodes of a facet are eliminated, and what that fills."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from kiribench.fem.facet import FacetMesh

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Elimination:
    """The plan by which the inner nodes of a template are eliminated, in 2 x 2 blocks.

    Attributes:
        kept: (b,) ligament nodes of the template.
        order: (k,) the other nodes, in the order of elimination.
        start: (k + 1,) where the rows of each eliminated node begin in ``rows`` and ``column``.
        rows: nodes below the pivot in its column.
        column: block of each of these rows in the pivot's column.
        pivot: (k,) diagonal block of each eliminated node.
        target_start: (k + 1,) where the updates of each pivot begin in ``target``.
        target: block that rows i >= j of the pivot's list update, i-major; the block below
            the diagonal if its row comes later in the order, else its transpose is meant, coded
            as -1 - block.
        kept_blocks: (b, b) block of each pair of kept nodes, lower triangle, coded likewise.
        element: (m, k, k) block of each pair of nodes of each element i <= j, coded likewise.
        blocks: how many blocks there are.
    """

    kept: IntArray
    order: IntArray
    start: IntArray
    rows: IntArray
    column: IntArray
    pivot: IntArray
    target_start: IntArray
    target: IntArray
    kept_blocks: IntArray
    element: IntArray
    blocks: int


@lru_cache(maxsize=256)
def plan_elimination(template: FacetMesh) -> Elimination:
    """Minimum-degree order of a template's inner nodes, and the blocks that it fills."""
    kept = np.unique(np.concatenate([template.ligament(edge) for edge in range(4)]))
    return plan_nodes(template.triangles, len(template.points), kept)


def plan_nodes(elements: IntArray, count: int, kept: IntArray) -> Elimination:
    """Minimum-degree order of all nodes but ``kept`` (b,), and the blocks that it fills.

    Args:
        elements: (m, k) nodes of each element.
        count: of nodes.
        kept: nodes that stay, sorted.
    """
    is_kept = set(kept.tolist())
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for nodes in elements.tolist():
        for node in nodes:
            neighbours[node].update(nodes)
    for node, around in enumerate(neighbours):
        around.discard(node)
    # Rank: place in the order; kept nodes come last.
    waiting = {node for node in range(len(neighbours)) if node not in is_kept}
    order: list[int] = []
    below: list[list[int]] = []
    while waiting:
        pivot = min(waiting, key=lambda node: (len(neighbours[node]), node))
        waiting.discard(pivot)
        around = neighbours[pivot]
        order.append(pivot)
        below.append(sorted(around))
        for node in around:
            neighbours[node] |= around
            neighbours[node].discard(pivot)
            neighbours[node].discard(node)
    rank = np.empty(len(neighbours), dtype=np.int64)
    rank[order] = np.arange(len(order))
    rank[kept] = len(order) + np.arange(len(kept))

    block: dict[tuple[int, int], int] = {}

    def at(row: int, column: int) -> int:
        """Code of the block of two nodes: stored with the later node as its row."""
        if rank[row] >= rank[column]:
            return block.setdefault((row, column), len(block))
        return -1 - block.setdefault((column, row), len(block))

    pivots = [at(node, node) for node in order]
    rows = [sorted(nodes, key=lambda node: rank[node]) for nodes in below]
    column = [at(row, node) for node, nodes in zip(order, rows, strict=True) for row in nodes]
    target = [
        at(nodes[i], nodes[j]) for nodes in rows for i in range(len(nodes)) for j in range(i + 1)
    ]
    kept_list = kept.tolist()
    kept_blocks = np.zeros((len(kept), len(kept)), dtype=np.int64)
    for i, row in enumerate(kept_list):
        for j in range(i + 1):
            kept_blocks[i, j] = at(row, kept_list[j])
    corners = elements.shape[1]
    element = np.zeros((len(elements), corners, corners), dtype=np.int64)
    for e, nodes in enumerate(elements.tolist()):
        for i in range(corners):
            for j in range(i, corners):
                element[e, i, j] = at(nodes[i], nodes[j])
    sizes = np.array([len(nodes) for nodes in rows], dtype=np.int64)
    return Elimination(
        kept=kept,
        order=np.array(order, dtype=np.int64),
        start=np.concatenate([[0], np.cumsum(sizes)]),
        rows=np.array([row for nodes in rows for row in nodes], dtype=np.int64),
        column=np.array(column, dtype=np.int64),
        pivot=np.array(pivots, dtype=np.int64),
        target_start=np.concatenate([[0], np.cumsum(sizes * (sizes + 1) // 2)]),
        target=np.array(target, dtype=np.int64),
        kept_blocks=kept_blocks,
        element=element,
        blocks=len(block),
    )
