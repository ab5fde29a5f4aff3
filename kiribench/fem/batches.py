"""Kernels of the condensed system: stiffness and elimination of many like facets at once.

All kernels hold one value of ``LANES`` facets side by side in their last axis; the loops over it
become vector instructions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.fem.assembly import total_energy
from kiribench.fem.lanes import LANES, neo_hookean_lanes, raise_lanes
from kiribench.fem.material import response

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

__all__ = [
    "LANES",
    "block_energy",
    "eliminate",
    "expand_block",
    "linearise_block",
    "negative_pivots",
    "reduce_block",
]


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
    projected: float,
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
            if alpha == 2.0:
                neo_hookean_lanes(f, mu, out, spare)
                if projected > 0.0:
                    raise_lanes(f, projected * mu, out, spare)
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
def eliminate(
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
def negative_pivots(store: FloatArray, pivot: IntArray, facets: int) -> int:
    """Negative eigenvalues among the eliminated pivots of a block: of D as of D^-1."""
    count = 0
    for facet in range(facets):
        factors, s = store[facet // LANES], facet % LANES
        for at in pivot:
            d = factors[at]
            if d[0, s] * d[3, s] < d[1, s] * d[2, s]:
                count += 1
            elif d[0, s] < 0.0:
                count += 2
    return count


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
    projected: float,
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
        eliminate(blocks, start, column, pivot, target_start, target)
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


@njit(cache=True, error_model="numpy")
def block_energy(
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
