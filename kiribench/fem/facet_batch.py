"""Like facets side by side: their factors, and what passes through them in a solution.

A system of equations whose facets share an elimination plan keeps one of these for each plan;
what it assembles into the stores, and what it does with the condensed matrix, is its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kiribench.fem.batches import LANES, expand_block, negative_pivots, reduce_block
from kiribench.fem.elimination import Elimination

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


class FacetBatch:
    """Facets with one elimination plan in batches of ``LANES``, the last filled up.

    Args:
        plan: of the elimination.
        nodes: (f, n) node of the sheet of each facet node.
        mirrored: (f,) facets whose x is turned about; None where none is.

    Attributes:
        count: of facets, f.
        fill: (B L,) which facet lies in each lane.
        nodes: (B L, n); sign: (B L,) of x.
        store: (B, z, 4, L) stiffness, then factors. carried: (B, n, 2, L) right sides inside.
        pairs: (p, 2) of kept nodes. kept_code: (p,) their coded blocks.
    """

    def __init__(
        self, plan: Elimination, nodes: IntArray, mirrored: BoolArray | None = None
    ) -> None:
        self.plan = plan
        self.count = len(nodes)
        batches = -(-self.count // LANES)
        self.fill = np.minimum(np.arange(batches * LANES), self.count - 1)
        self.nodes = np.ascontiguousarray(nodes[self.fill])
        self.sign = np.ones(len(self.fill))
        if mirrored is not None:
            self.sign[mirrored[self.fill]] = -1.0
        self.store = np.zeros((batches, plan.blocks, 4, LANES))
        self.carried = np.zeros((batches, nodes.shape[1], 2, LANES))
        kept = range(len(plan.kept))
        self.pairs = np.array([(i, j) for i in kept for j in range(i + 1)], dtype=np.int64)
        self.pairs = self.pairs.reshape(-1, 2)
        self.kept_code = plan.kept_blocks[self.pairs[:, 0], self.pairs[:, 1]]

    def kept_entries(self, equation: IntArray) -> tuple[IntArray, IntArray]:
        """Rows and columns (f, p, 4) of the entries of the kept pairs, from the equations (u, 2)
        of the nodes; -1 where prescribed."""
        kept = equation[self.nodes[: self.count, self.plan.kept]]
        one, two = kept[:, self.pairs[:, 0]], kept[:, self.pairs[:, 1]]
        return one[..., [0, 0, 1, 1]], two[..., [0, 1, 0, 1]]

    def reduce(self, right: FloatArray, condensed: FloatArray) -> None:
        """Eliminate the inside of right sides (u, 2); what reaches kept nodes is added."""
        plan = self.plan
        reduce_block(
            right,
            self.nodes,
            self.sign,
            self.count,
            plan.order,
            plan.start,
            plan.rows,
            plan.column,
            plan.kept,
            self.store,
            self.carried,
            condensed,
        )

    def expand(self, solution: FloatArray) -> None:
        """Fill the inside of a solution (u, 2) that is known at the kept nodes."""
        plan = self.plan
        expand_block(
            self.nodes,
            self.sign,
            self.count,
            plan.order,
            plan.start,
            plan.rows,
            plan.column,
            plan.pivot,
            plan.kept,
            self.store,
            self.carried,
            solution,
        )

    def negative_pivots(self) -> int:
        """Negative eigenvalues of what was eliminated."""
        return int(negative_pivots(self.store, self.plan.pivot, self.count))
