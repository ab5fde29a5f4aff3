"""The equations of a sheet whose facets repeat, with the inside of every facet eliminated.

Facets meet in their ligaments only. So the exact tangent is factorised facet by facet: inner
and cut-face nodes are eliminated by a sparse L D L^T whose pattern is that of the template, for
a batch of facets at once, and what is left is one sparse matrix on the nodes of the ligaments
for SuperLU. No approximation is made: the solution is that of the assembled matrix.

All kernels hold one value of ``LANES`` facets side by side in their last axis; the loops over it
become vector instructions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.sparse import csc_array

from kiribench.fem.assembly import Factor, factorise, quadrature, total_energy
from kiribench.fem.facet import FacetMesh
from kiribench.fem.material import Material, response
from kiribench.fem.mesh import FacetBlock, SheetMesh

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LANES = 16
"""Facets in one batch: two vector registers of eight doubles."""


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
        element: (m, 6, 6) block of each pair of nodes of each element i <= j, coded likewise.
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
    is_kept = set(kept.tolist())
    neighbours: list[set[int]] = [set() for _ in template.points]
    for nodes in template.triangles.tolist():
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
    element = np.zeros((len(template.triangles), 6, 6), dtype=np.int64)
    for e, nodes in enumerate(template.triangles.tolist()):
        for i in range(6):
            for j in range(i, 6):
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


@njit(cache=True, error_model="numpy")
def _neo_hookean_lanes(f: FloatArray, mu: float, out: FloatArray, inv: FloatArray) -> None:
    """``material.response`` for neo-Hookean, lane by lane: f (4, L) to out (14, L)."""
    j3, j4 = inv[0], inv[1]
    for s in range(LANES):
        j3[s] = mu / (f[0, s] * f[3, s] - f[1, s] * f[2, s]) ** 3
    for s in range(LANES):
        j4[s] = 3.0 * j3[s] / (f[0, s] * f[3, s] - f[1, s] * f[2, s])
    for s in range(LANES):
        out[0, s] = mu * f[0, s] - j3[s] * f[3, s]
    for s in range(LANES):
        out[1, s] = mu * f[1, s] + j3[s] * f[2, s]
    for s in range(LANES):
        out[2, s] = mu * f[2, s] + j3[s] * f[1, s]
    for s in range(LANES):
        out[3, s] = mu * f[3, s] - j3[s] * f[0, s]
    for s in range(LANES):
        out[4, s] = mu + j4[s] * f[3, s] * f[3, s]
    for s in range(LANES):
        out[5, s] = -j4[s] * f[3, s] * f[2, s]
    for s in range(LANES):
        out[6, s] = -j4[s] * f[3, s] * f[1, s]
    for s in range(LANES):
        out[7, s] = j4[s] * f[0, s] * f[3, s] - j3[s]
    for s in range(LANES):
        out[8, s] = mu + j4[s] * f[2, s] * f[2, s]
    for s in range(LANES):
        out[9, s] = j4[s] * f[1, s] * f[2, s] + j3[s]
    for s in range(LANES):
        out[10, s] = -j4[s] * f[0, s] * f[2, s]
    for s in range(LANES):
        out[11, s] = mu + j4[s] * f[1, s] * f[1, s]
    for s in range(LANES):
        out[12, s] = -j4[s] * f[0, s] * f[1, s]
    for s in range(LANES):
        out[13, s] = mu + j4[s] * f[0, s] * f[0, s]


@njit(cache=True, error_model="numpy")
def _assemble_batch(
    x: FloatArray,
    triangles: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    alpha: float,
    element: IntArray,
    with_stiffness: bool,
    projected: bool,
    force: FloatArray,
    blocks: FloatArray,
) -> None:
    """Add nodal forces (n, 2, L) and stiffness blocks (z, 4, L) of one batch at x (n, 2, L)."""
    f = np.empty((4, LANES))
    out = np.empty((14, LANES))
    spare = np.empty((2, LANES))
    t = np.empty((8, LANES))
    one, result = np.empty(4), np.empty(14)
    for e in range(triangles.shape[0]):
        for q in range(areas.shape[1]):
            f[:] = 0.0
            for i in range(6):
                node = triangles[e, i]
                g0, g1 = gradients[e, q, i, 0], gradients[e, q, i, 1]
                for s in range(LANES):
                    f[0, s] += x[node, 0, s] * g0
                for s in range(LANES):
                    f[1, s] += x[node, 0, s] * g1
                for s in range(LANES):
                    f[2, s] += x[node, 1, s] * g0
                for s in range(LANES):
                    f[3, s] += x[node, 1, s] * g1
            if alpha == 2.0 and not projected:
                _neo_hookean_lanes(f, mu, out, spare)
            else:
                for s in range(LANES):
                    one[:] = f[:, s]
                    response(one[0], one[1], one[2], one[3], mu, alpha, projected, result)
                    out[:, s] = result
            w = areas[e, q]
            for i in range(6):
                node = triangles[e, i]
                g0, g1 = w * gradients[e, q, i, 0], w * gradients[e, q, i, 1]
                for s in range(LANES):
                    force[node, 0, s] += out[0, s] * g0 + out[1, s] * g1
                for s in range(LANES):
                    force[node, 1, s] += out[2, s] * g0 + out[3, s] * g1
                if not with_stiffness:
                    continue
                for s in range(LANES):
                    t[0, s] = out[4, s] * g0 + out[5, s] * g1
                for s in range(LANES):
                    t[1, s] = out[5, s] * g0 + out[8, s] * g1
                for s in range(LANES):
                    t[2, s] = out[6, s] * g0 + out[9, s] * g1
                for s in range(LANES):
                    t[3, s] = out[7, s] * g0 + out[10, s] * g1
                for s in range(LANES):
                    t[4, s] = out[6, s] * g0 + out[7, s] * g1
                for s in range(LANES):
                    t[5, s] = out[9, s] * g0 + out[10, s] * g1
                for s in range(LANES):
                    t[6, s] = out[11, s] * g0 + out[12, s] * g1
                for s in range(LANES):
                    t[7, s] = out[12, s] * g0 + out[13, s] * g1
                for j in range(i, 6):
                    h0, h1 = gradients[e, q, j, 0], gradients[e, q, j, 1]
                    code = element[e, i, j]
                    # Row i, column j; stored as it is, or transposed.
                    at, r01, r10 = code, 1, 2
                    if code < 0:
                        at, r01, r10 = -1 - code, 2, 1
                    for s in range(LANES):
                        blocks[at, 0, s] += t[0, s] * h0 + t[1, s] * h1
                    for s in range(LANES):
                        blocks[at, r01, s] += t[2, s] * h0 + t[3, s] * h1
                    for s in range(LANES):
                        blocks[at, r10, s] += t[4, s] * h0 + t[5, s] * h1
                    for s in range(LANES):
                        blocks[at, 3, s] += t[6, s] * h0 + t[7, s] * h1


@njit(cache=True, error_model="numpy")
def _eliminate(
    blocks: FloatArray,
    start: IntArray,
    column: IntArray,
    pivot: IntArray,
    target_start: IntArray,
    target: IntArray,
) -> None:
    """L D L^T of one batch in place: pivots become D^-1, columns become L."""
    low = np.empty((4, LANES))
    det = np.empty(LANES)
    for k in range(len(pivot)):
        d = blocks[pivot[k]]
        for s in range(LANES):
            det[s] = 1.0 / (d[0, s] * d[3, s] - d[1, s] * d[2, s])
        for s in range(LANES):
            hold = d[0, s]
            d[0, s] = d[3, s] * det[s]
            d[3, s] = hold * det[s]
            d[1, s] = -d[1, s] * det[s]
            d[2, s] = d[1, s]
        at = target_start[k]
        # From the last row up: a row's own block is overwritten by L after its last use.
        count = start[k + 1] - start[k]
        for i in range(count - 1, -1, -1):
            b = blocks[column[start[k] + i]]
            for s in range(LANES):
                low[0, s] = b[0, s] * d[0, s] + b[1, s] * d[2, s]
            for s in range(LANES):
                low[1, s] = b[0, s] * d[1, s] + b[1, s] * d[3, s]
            for s in range(LANES):
                low[2, s] = b[2, s] * d[0, s] + b[3, s] * d[2, s]
            for s in range(LANES):
                low[3, s] = b[2, s] * d[1, s] + b[3, s] * d[3, s]
            row = at + i * (i + 1) // 2
            for j in range(i + 1):
                c = blocks[column[start[k] + j]]
                z = blocks[target[row + j]]
                for s in range(LANES):
                    z[0, s] -= low[0, s] * c[0, s] + low[1, s] * c[1, s]
                for s in range(LANES):
                    z[1, s] -= low[0, s] * c[2, s] + low[1, s] * c[3, s]
                for s in range(LANES):
                    z[2, s] -= low[2, s] * c[0, s] + low[3, s] * c[1, s]
                for s in range(LANES):
                    z[3, s] -= low[2, s] * c[2, s] + low[3, s] * c[3, s]
            b[:] = low


@njit(cache=True, error_model="numpy")
def _gather(values: FloatArray, nodes: IntArray, sign: FloatArray, batch: FloatArray) -> None:
    """Nodal vectors (n, 2) of one batch of facets (L, t), mirrored back: batch (t, 2, L)."""
    for s in range(LANES):
        for node in range(nodes.shape[1]):
            batch[node, 0, s] = sign[s] * values[nodes[s, node], 0]
            batch[node, 1, s] = values[nodes[s, node], 1]


@njit(cache=True, error_model="numpy")
def linearise_block(
    x: FloatArray,
    nodes: IntArray,
    sign: FloatArray,
    facets: int,
    triangles: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    alpha: float,
    element: IntArray,
    start: IntArray,
    column: IntArray,
    pivot: IntArray,
    target_start: IntArray,
    target: IntArray,
    kept_code: IntArray,
    kept_place: npt.NDArray[np.int32],
    with_stiffness: bool,
    projected: bool,
    force: FloatArray,
    store: FloatArray,
    values: FloatArray,
) -> None:
    """Forces of all facets of a block into ``force`` (n, 2), and their condensed stiffness.

    Args:
        nodes, sign: (c L, t) and (c L,), the last batch filled up by repeating a facet.
        facets: how many of them are real.
        kept_code: (p,) coded block of each pair of kept nodes.
        kept_place: (c L, p, 4, 2) place in ``values`` of each entry and of its transpose, or -1.
        store: (c, z, 4, L) factors, written.
        values: (v,) entries of the condensed matrix, added to.
    """
    batches = store.shape[0]
    own = np.empty((nodes.shape[1], 2, LANES))
    pull = np.empty((nodes.shape[1], 2, LANES))
    for c in range(batches):
        first = c * LANES
        _gather(x, nodes[first : first + LANES], sign[first : first + LANES], own)
        pull[:] = 0.0
        blocks = store[c]
        if with_stiffness:
            blocks[:] = 0.0
        _assemble_batch(
            own,
            triangles,
            gradients,
            areas,
            mu,
            alpha,
            element,
            with_stiffness,
            projected,
            pull,
            blocks,
        )
        real = min(LANES, facets - first)
        for s in range(real):
            for node in range(nodes.shape[1]):
                force[nodes[first + s, node], 0] += sign[first + s] * pull[node, 0, s]
                force[nodes[first + s, node], 1] += pull[node, 1, s]
        if not with_stiffness:
            continue
        _eliminate(blocks, start, column, pivot, target_start, target)
        for s in range(real):
            flip = sign[first + s]
            for p in range(len(kept_code)):
                code = kept_code[p]
                at, r01, r10 = code, 1, 2
                if code < 0:
                    at, r01, r10 = -1 - code, 2, 1
                for entry in range(4):
                    value = blocks[at, 0, s]
                    if entry == 1:
                        value = flip * blocks[at, r01, s]
                    elif entry == 2:
                        value = flip * blocks[at, r10, s]
                    elif entry == 3:
                        value = blocks[at, 3, s]
                    for side in range(2):
                        where = kept_place[first + s, p, entry, side]
                        if where >= 0:
                            values[where] += value


@njit(cache=True, error_model="numpy")
def reduce_block(
    residual: FloatArray,
    nodes: IntArray,
    sign: FloatArray,
    facets: int,
    order: IntArray,
    start: IntArray,
    rows: IntArray,
    column: IntArray,
    kept: IntArray,
    store: FloatArray,
    carried: FloatArray,
    condensed: FloatArray,
) -> None:
    """Forward elimination of nodal residuals (n, 2): ``carried`` (c, t, 2, L) keeps the inner
    ones, ``condensed`` (n, 2) takes what reaches the kept nodes."""
    for c in range(store.shape[0]):
        first = c * LANES
        r = carried[c]
        _gather(residual, nodes[first : first + LANES], sign[first : first + LANES], r)
        for node in kept:
            r[node] = 0.0
        blocks = store[c]
        for k in range(len(order)):
            top = r[order[k]]
            for i in range(start[k], start[k + 1]):
                low = blocks[column[i]]
                below = r[rows[i]]
                for s in range(LANES):
                    below[0, s] -= low[0, s] * top[0, s] + low[1, s] * top[1, s]
                for s in range(LANES):
                    below[1, s] -= low[2, s] * top[0, s] + low[3, s] * top[1, s]
        for s in range(min(LANES, facets - first)):
            for node in kept:
                condensed[nodes[first + s, node], 0] += sign[first + s] * r[node, 0, s]
                condensed[nodes[first + s, node], 1] += r[node, 1, s]


@njit(cache=True, error_model="numpy")
def expand_block(
    nodes: IntArray,
    sign: FloatArray,
    facets: int,
    order: IntArray,
    start: IntArray,
    rows: IntArray,
    column: IntArray,
    pivot: IntArray,
    kept: IntArray,
    store: FloatArray,
    carried: FloatArray,
    solution: FloatArray,
) -> None:
    """Back substitution: from the kept nodes of ``solution`` (n, 2) to its inner ones."""
    own = np.empty((nodes.shape[1], 2, LANES))
    for c in range(store.shape[0]):
        first = c * LANES
        for s in range(LANES):
            for node in kept:
                own[node, 0, s] = sign[first + s] * solution[nodes[first + s, node], 0]
                own[node, 1, s] = solution[nodes[first + s, node], 1]
        blocks = store[c]
        for k in range(len(order) - 1, -1, -1):
            node = order[k]
            d = blocks[pivot[k]]
            r = carried[c, node]
            u = own[node]
            for s in range(LANES):
                u[0, s] = d[0, s] * r[0, s] + d[1, s] * r[1, s]
            for s in range(LANES):
                u[1, s] = d[2, s] * r[0, s] + d[3, s] * r[1, s]
            for i in range(start[k], start[k + 1]):
                low = blocks[column[i]]
                below = own[rows[i]]
                for s in range(LANES):
                    u[0, s] -= low[0, s] * below[0, s] + low[2, s] * below[1, s]
                for s in range(LANES):
                    u[1, s] -= low[1, s] * below[0, s] + low[3, s] * below[1, s]
        for s in range(min(LANES, facets - first)):
            for node in order:
                solution[nodes[first + s, node], 0] = sign[first + s] * own[node, 0, s]
                solution[nodes[first + s, node], 1] = own[node, 1, s]


class _Block:
    """One block of facets with its plan, its factors and its places in the condensed matrix."""

    def __init__(self, block: FacetBlock) -> None:
        template = block.template
        self.facets = len(block.nodes)
        self.plan = plan_elimination(template)
        self.triangles = template.triangles
        part = quadrature(template.points * block.size_mm, template.triangles)
        self.gradients, self.areas = part.gradients, part.areas_mm2
        batches = -(-self.facets // LANES)
        fill = np.minimum(np.arange(batches * LANES), self.facets - 1)
        self.nodes = np.ascontiguousarray(block.nodes[fill])
        self.sign = np.where(block.mirrored[fill], -1.0, 1.0)
        self.store = np.zeros((batches, self.plan.blocks, 4, LANES))
        self.carried = np.zeros((batches, len(template.points), 2, LANES))
        count = len(self.plan.kept)
        self.pairs = np.array(
            [(i, j) for i in range(count) for j in range(i + 1)], dtype=np.int64
        ).reshape(-1, 2)
        self.kept_code = self.plan.kept_blocks[self.pairs[:, 0], self.pairs[:, 1]]

    def kept_entries(self, equation: IntArray) -> tuple[IntArray, IntArray]:
        """Rows and columns (facets, p, 4) of the entries of the kept pairs; -1 prescribed."""
        kept = self.nodes[: self.facets, self.plan.kept]
        one = equation[kept[:, self.pairs[:, 0]]]
        two = equation[kept[:, self.pairs[:, 1]]]
        rows = np.stack([one[..., 0], one[..., 0], one[..., 1], one[..., 1]], axis=-1)
        columns = np.stack([two[..., 0], two[..., 1], two[..., 0], two[..., 1]], axis=-1)
        return rows, columns


class CondensedSystem:
    """The equations of a sheet, solved by eliminating the inside of every facet.

    Gives the same answers as ``AssembledSystem`` on the same mesh. The condensed matrix is
    symmetric, and positive definite where the equilibrium is stable.

    Args:
        mesh: the sheet.
        equation: (n, 2) equation of each displacement, -1 prescribed; only nodes of ligaments
            may be prescribed, and no two displacements be tied.
        material: the law.
    """

    def __init__(self, mesh: SheetMesh, equation: IntArray, material: Material) -> None:
        self.points_mm = mesh.points_mm
        self.equation = equation
        self.size = int(equation.max()) + 1
        self._law = (material.mu_mpa, float(material.alpha))
        self._blocks = [_Block(block) for block in mesh.blocks]
        kept = np.zeros(len(mesh.points_mm), dtype=bool)
        for block in self._blocks:
            kept[block.nodes[:, block.plan.kept]] = True
        if np.any(equation[~kept] < 0):
            raise ValueError("only nodes of ligaments may be prescribed in a condensed system")
        self._kept_nodes = np.flatnonzero(kept)
        free = equation[self._kept_nodes] >= 0
        self._global = np.full(equation.shape, -1, dtype=np.int64)
        numbers = np.full((len(self._kept_nodes), 2), -1, dtype=np.int64)
        numbers[free] = np.arange(free.sum())
        self._global[self._kept_nodes] = numbers
        self.condensed_size = int(free.sum())
        self._factor: Factor
        self._plan_condensed()
        self.area_mm2 = float(sum(block.facets * block.areas.sum() for block in self._blocks))

    def _plan_condensed(self) -> None:
        """Pattern of the condensed matrix, and the place of every facet's entries in it."""
        size = self.condensed_size
        codes = []
        for block in self._blocks:
            rows, columns = block.kept_entries(self._global)
            lower = columns * size + rows
            upper = rows * size + columns
            diagonal = (block.pairs[:, 0] == block.pairs[:, 1])[None, :, None]
            upper = np.where(diagonal, -1, upper)
            both = np.stack([lower, upper], axis=-1)
            both[(rows < 0) | (columns < 0)] = -1
            codes.append(both)
        flat = np.concatenate([code.ravel() for code in codes])
        pattern = np.unique(flat[flat >= 0])
        self._indices = (pattern % size).astype(np.int32)
        self._pointers = np.searchsorted(pattern // size, np.arange(size + 1)).astype(np.int32)
        self._values = np.zeros(len(pattern))
        self._places = []
        for block, code in zip(self._blocks, codes, strict=True):
            place = np.searchsorted(pattern, code).astype(np.int32)
            place[code < 0] = -1
            filled = np.full((len(block.nodes), *place.shape[1:]), -1, dtype=np.int32)
            filled[: block.facets] = place
            self._places.append(filled)

    def energy(self, x: FloatArray) -> float:
        """Elastic energy per unit thickness (N) at deformed nodes (n, 2) mm; inf if folded."""
        total = 0.0
        for block in self._blocks:
            total += _block_energy(
                x,
                block.nodes,
                block.sign,
                block.facets,
                block.triangles,
                block.gradients,
                block.areas,
                *self._law,
            )
        return total

    def _assemble(self, x: FloatArray, with_stiffness: bool, projected: bool = False) -> FloatArray:
        force = np.zeros_like(self.points_mm)
        for block, places in zip(self._blocks, self._places, strict=True):
            plan = block.plan
            linearise_block(
                x,
                block.nodes,
                block.sign,
                block.facets,
                block.triangles,
                block.gradients,
                block.areas,
                *self._law,
                plan.element,
                plan.start,
                plan.column,
                plan.pivot,
                plan.target_start,
                plan.target,
                block.kept_code,
                places,
                with_stiffness,
                projected,
                force,
                block.store,
                self._values,
            )
        return force

    def forces(self, x: FloatArray) -> FloatArray:
        """(n, 2) internal nodal forces per unit thickness, N/mm."""
        return self._assemble(x, with_stiffness=False)

    def reduce(self, force: FloatArray) -> FloatArray:
        """(size,) residual of the free equations from nodal forces (n, 2)."""
        result = np.zeros(self.size)
        free = self.equation >= 0
        result[self.equation[free]] = force[free]
        return result

    def linearise(self, x: FloatArray, *, projected: bool = False) -> FloatArray:
        """Factorise the tangent at x, made positive if ``projected``; the residual (size,)."""
        self._values[:] = 0.0
        force = self._assemble(x, True, projected)
        matrix = csc_array(
            (self._values, self._indices, self._pointers),
            shape=(self.condensed_size, self.condensed_size),
        )
        self._factor = factorise(matrix)
        return self.reduce(force)

    def solve(self, residual: FloatArray) -> FloatArray:
        """(size,) solution with the last factorised tangent."""
        nodal = np.where(self.equation >= 0, residual[self.equation], 0.0)
        condensed = np.zeros_like(nodal)
        condensed[self._kept_nodes] = nodal[self._kept_nodes]
        for block in self._blocks:
            plan = block.plan
            reduce_block(
                nodal,
                block.nodes,
                block.sign,
                block.facets,
                plan.order,
                plan.start,
                plan.rows,
                plan.column,
                plan.kept,
                block.store,
                block.carried,
                condensed,
            )
        free = self._global >= 0
        right = np.zeros(self.condensed_size)
        right[self._global[free]] = condensed[free]
        answer = self._factor.solve(right)
        solution = np.where(free, answer[self._global], 0.0)
        for block in self._blocks:
            plan = block.plan
            expand_block(
                block.nodes,
                block.sign,
                block.facets,
                plan.order,
                plan.start,
                plan.rows,
                plan.column,
                plan.pivot,
                plan.kept,
                block.store,
                block.carried,
                solution,
            )
        return self.reduce(solution)


@njit(cache=True, error_model="numpy")
def _block_energy(
    x: FloatArray,
    nodes: IntArray,
    sign: FloatArray,
    facets: int,
    triangles: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    alpha: float,
) -> float:
    """Energy of the facets of a block, one after another; inf if one is folded."""
    own = np.empty((nodes.shape[1], 2))
    total = 0.0
    for facet in range(facets):
        for node in range(nodes.shape[1]):
            own[node, 0] = sign[facet] * x[nodes[facet, node], 0]
            own[node, 1] = x[nodes[facet, node], 1]
        total += total_energy(own, triangles, gradients, areas, mu, alpha)
        if total == np.inf:
            return total
    return total
