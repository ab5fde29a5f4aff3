"""Kernels of the membrane on a surface: energy, force, tangent, many facets side by side.

All kernels hold one value of ``LANES`` facets in their last axis, as in
:mod:`kiribench.fem.batches`. In the element x = sum_a X(q_a) N_a is interpolated between nodes on
the surface; F = dx/dP (3 x 2), C = F'F, W = mu/2 (tr C + 1/det C - 3).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.fem.batches import LANES, eliminate

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def membrane_energy(
    q: FloatArray,
    x: FloatArray,
    nodes: IntArray,
    facets: int,
    elements: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
) -> float:
    """Energy of a block per thickness at q (u, 2), x (u, 3); inf where an element is folded in q.

    Args:
        nodes: (B L, n) patch nodes of the facets, the last batch filled up.
        facets: how many of them are real.
        gradients: (B, m, Q, k, 2, L); areas: (B, m, Q, L).
    """
    total = 0.0
    c = np.empty((10, LANES))
    for batch in range(gradients.shape[0]):
        first = batch * LANES
        real = min(LANES, facets - first)
        for e in range(elements.shape[0]):
            for p in range(areas.shape[2]):
                c[:] = 0.0
                for i in range(elements.shape[1]):
                    g = gradients[batch, e, p, i]
                    for s in range(LANES):
                        node = nodes[first + s, elements[e, i]]
                        for d in range(3):
                            c[d, s] += x[node, d] * g[0, s]
                            c[3 + d, s] += x[node, d] * g[1, s]
                        for d in range(2):
                            c[6 + d, s] += q[node, d] * g[0, s]
                            c[8 + d, s] += q[node, d] * g[1, s]
                for s in range(real):
                    if not c[6, s] * c[9, s] - c[7, s] * c[8, s] > 1e-9:
                        return np.inf
                    c11 = c[0, s] * c[0, s] + c[1, s] * c[1, s] + c[2, s] * c[2, s]
                    c22 = c[3, s] * c[3, s] + c[4, s] * c[4, s] + c[5, s] * c[5, s]
                    c12 = c[0, s] * c[3, s] + c[1, s] * c[4, s] + c[2, s] * c[5, s]
                    det = c11 * c22 - c12 * c12
                    if not det > 1e-18:
                        return np.inf
                    density = 0.5 * mu * (c11 + c22 + 1.0 / det - 3.0)
                    total += areas[batch, e, p, s] * density
    return total


@njit(cache=True, error_model="numpy")
def _assemble_batch(
    x: FloatArray,
    first: FloatArray,
    second: FloatArray,
    elements: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    code: IntArray,
    diagonal: IntArray,
    with_stiffness: bool,
    projected: bool,
    force: FloatArray,
    blocks: FloatArray,
) -> None:
    """Add forces (n, 3, L) in space and stiffness blocks (z, 4, L) in q of one batch."""
    corners = elements.shape[1]
    f = np.empty((6, LANES))
    c = np.empty((4, LANES))
    stress = np.empty((3, LANES))
    moduli = np.empty((6, LANES))
    h = np.empty((2, LANES))
    b = np.empty((corners, 2, 3, LANES))
    db = np.empty((2, 3, LANES))
    pull = np.empty((corners, 2, LANES))
    local = np.empty((corners, corners, 4, LANES))
    geometric = np.empty((corners, corners, LANES))
    for e in range(elements.shape[0]):
        if with_stiffness:
            local[:] = 0.0
            geometric[:] = 0.0
        for p in range(areas.shape[1]):
            f[:] = 0.0
            for i in range(corners):
                node = elements[e, i]
                g = gradients[e, p, i]
                for d in range(3):
                    for s in range(LANES):
                        f[d, s] += x[node, d, s] * g[0, s]
                    for s in range(LANES):
                        f[3 + d, s] += x[node, d, s] * g[1, s]
            w = areas[e, p]
            for s in range(LANES):
                c[0, s] = f[0, s] * f[0, s] + f[1, s] * f[1, s] + f[2, s] * f[2, s]
                c[1, s] = f[3, s] * f[3, s] + f[4, s] * f[4, s] + f[5, s] * f[5, s]
                c[2, s] = f[0, s] * f[3, s] + f[1, s] * f[4, s] + f[2, s] * f[5, s]
                c[3, s] = 1.0 / (c[0, s] * c[1, s] - c[2, s] * c[2, s])
            for s in range(LANES):
                k = mu * w[s] * c[3, s] * c[3, s]
                stress[0, s] = mu * w[s] - k * c[1, s]
                stress[1, s] = mu * w[s] - k * c[0, s]
                stress[2, s] = k * c[2, s]
            for i in range(corners):
                node = elements[e, i]
                g = gradients[e, p, i]
                for s in range(LANES):
                    h[0, s] = stress[0, s] * g[0, s] + stress[2, s] * g[1, s]
                    h[1, s] = stress[2, s] * g[0, s] + stress[1, s] * g[1, s]
                for d in range(3):
                    for s in range(LANES):
                        force[node, d, s] += f[d, s] * h[0, s] + f[3 + d, s] * h[1, s]
            if not with_stiffness:
                continue
            # dS/dE with M = C^-1: 2 mu w / det (M (x) M + sym M (.) M), in Voigt's order.
            for s in range(LANES):
                m11, m22, m12 = c[1, s] * c[3, s], c[0, s] * c[3, s], -c[2, s] * c[3, s]
                k = 2.0 * mu * w[s] * c[3, s]
                moduli[0, s] = 2.0 * k * m11 * m11
                moduli[1, s] = k * (m11 * m22 + m12 * m12)
                moduli[2, s] = 2.0 * k * m11 * m12
                moduli[3, s] = 2.0 * k * m22 * m22
                moduli[4, s] = 2.0 * k * m22 * m12
                moduli[5, s] = k * (m12 * m12 + 0.5 * (m11 * m22 + m12 * m12))
            if projected:
                for s in range(LANES):
                    middle = 0.5 * (stress[0, s] + stress[1, s])
                    gap = np.sqrt(0.25 * (stress[0, s] - stress[1, s]) ** 2 + stress[2, s] ** 2)
                    low, high = middle - gap, middle + gap
                    if low < 0.0:
                        scale = max(high, 0.0) / (high - low) if gap > 0.0 else 0.0
                        stress[0, s] = scale * (stress[0, s] - low)
                        stress[1, s] = scale * (stress[1, s] - low)
                        stress[2, s] = scale * stress[2, s]
            for i in range(corners):
                node = elements[e, i]
                g = gradients[e, p, i]
                for s in range(LANES):
                    pull[i, 0, s] = stress[0, s] * g[0, s] + stress[2, s] * g[1, s]
                    pull[i, 1, s] = stress[2, s] * g[0, s] + stress[1, s] * g[1, s]
                for a in range(2):
                    j = first[node, a]
                    for s in range(LANES):
                        p0 = f[0, s] * j[0, s] + f[1, s] * j[1, s] + f[2, s] * j[2, s]
                        p1 = f[3, s] * j[0, s] + f[4, s] * j[1, s] + f[5, s] * j[2, s]
                        b[i, a, 0, s] = p0 * g[0, s]
                        b[i, a, 1, s] = p1 * g[1, s]
                        b[i, a, 2, s] = p0 * g[1, s] + p1 * g[0, s]
            for i in range(corners):
                for a in range(2):
                    for s in range(LANES):
                        b0, b1, b2 = b[i, a, 0, s], b[i, a, 1, s], b[i, a, 2, s]
                        db[a, 0, s] = moduli[0, s] * b0 + moduli[1, s] * b1 + moduli[2, s] * b2
                        db[a, 1, s] = moduli[1, s] * b0 + moduli[3, s] * b1 + moduli[4, s] * b2
                        db[a, 2, s] = moduli[2, s] * b0 + moduli[4, s] * b1 + moduli[5, s] * b2
                for j in range(i, corners):
                    g = gradients[e, p, j]
                    for s in range(LANES):
                        geometric[i, j, s] += pull[i, 0, s] * g[0, s] + pull[i, 1, s] * g[1, s]
                    for a in range(2):
                        for k2 in range(2):
                            row = local[i, j, 2 * a + k2]
                            for s in range(LANES):
                                row[s] += (
                                    db[a, 0, s] * b[j, k2, 0, s]
                                    + db[a, 1, s] * b[j, k2, 1, s]
                                    + db[a, 2, s] * b[j, k2, 2, s]
                                )
        if not with_stiffness:
            continue
        for i in range(corners):
            one = first[elements[e, i]]
            for j in range(i, corners):
                two = first[elements[e, j]]
                at, r01, r10 = code[e, i, j], 1, 2
                if at < 0:
                    at, r01, r10 = -1 - at, 2, 1
                for a in range(2):
                    for k2 in range(2):
                        entry = 2 * a + k2
                        if entry == 1:
                            entry = r01
                        elif entry == 2:
                            entry = r10
                        out = blocks[at, entry]
                        part = local[i, j, 2 * a + k2]
                        for s in range(LANES):
                            out[s] += part[s] + geometric[i, j, s] * (
                                one[a, 0, s] * two[k2, 0, s]
                                + one[a, 1, s] * two[k2, 1, s]
                                + one[a, 2, s] * two[k2, 2, s]
                            )
    if not with_stiffness:
        return
    for node in range(x.shape[0]):
        out = blocks[diagonal[node]]
        for s in range(LANES):
            uu = uv = vv = 0.0
            for d in range(3):
                uu += force[node, d, s] * second[node, 0, d, s]
                uv += force[node, d, s] * second[node, 1, d, s]
                vv += force[node, d, s] * second[node, 2, d, s]
            if projected:
                middle = 0.5 * (uu + vv)
                gap = np.sqrt(0.25 * (uu - vv) ** 2 + uv * uv)
                low, high = middle - gap, middle + gap
                if low < 0.0:
                    scale = max(high, 0.0) / (high - low) if gap > 0.0 else 0.0
                    uu, vv, uv = scale * (uu - low), scale * (vv - low), scale * uv
            out[0, s] += uu
            out[1, s] += uv
            out[2, s] += uv
            out[3, s] += vv


@njit(cache=True, error_model="numpy")
def membrane_block(
    x: FloatArray,
    first: FloatArray,
    second: FloatArray,
    nodes: IntArray,
    facets: int,
    elements: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    code: IntArray,
    diagonal: IntArray,
    extra: FloatArray,
    share: FloatArray,
    start: IntArray,
    column: IntArray,
    pivot: IntArray,
    target_start: IntArray,
    target: IntArray,
    kept_code: IntArray,
    kept_place: IntArray,
    with_stiffness: bool,
    projected: bool,
    force: FloatArray,
    store: FloatArray,
    band: FloatArray,
) -> None:
    """Forces of a block into ``force`` (u, 3), its condensed stiffness into ``band``.

    Args:
        x, first, second: the surface's jet at the patch nodes.
        extra: (u, 4) stiffness of other origin at the nodes, row by row; 0 rows where none.
        share: (u,) 1 / facets at a node.
        kept_code: (p,) coded block of each pair of kept nodes.
        kept_place: (B L, p, 4) place in ``band`` of each entry, or -1.
        store: (B, z, 4, L) factors, written.
    """
    n = nodes.shape[1]
    own = np.empty((n, 3, LANES))
    jet = np.empty((n, 2, 3, LANES))
    bend = np.empty((n, 3, 3, LANES))
    pull = np.empty((n, 3, LANES))
    for batch in range(gradients.shape[0]):
        begin = batch * LANES
        for node in range(n):
            for s in range(LANES):
                at = nodes[begin + s, node]
                for d in range(3):
                    own[node, d, s] = x[at, d]
                    if with_stiffness:
                        for a in range(2):
                            jet[node, a, d, s] = first[at, a, d]
                        for a in range(3):
                            bend[node, a, d, s] = second[at, a, d]
        pull[:] = 0.0
        blocks = store[batch]
        if with_stiffness:
            blocks[:] = 0.0
        _assemble_batch(
            own,
            jet,
            bend,
            elements,
            gradients[batch],
            areas[batch],
            mu,
            code,
            diagonal,
            with_stiffness,
            projected,
            pull,
            blocks,
        )
        real = min(LANES, facets - begin)
        for s in range(real):
            for node in range(n):
                at = nodes[begin + s, node]
                for d in range(3):
                    force[at, d] += pull[node, d, s]
        if not with_stiffness:
            continue
        if len(extra) > 0:
            for node in range(n):
                for s in range(LANES):
                    at = nodes[begin + s, node]
                    for k in range(4):
                        blocks[diagonal[node], k, s] += share[at] * extra[at, k]
        eliminate(blocks, start, column, pivot, target_start, target)
        for s in range(real):
            for p in range(len(kept_code)):
                at, r01, r10 = kept_code[p], 1, 2
                if at < 0:
                    at, r01, r10 = -1 - at, 2, 1
                for entry in range(4):
                    where = kept_place[begin + s, p, entry]
                    if where < 0:
                        continue
                    row = entry
                    if entry == 1:
                        row = r01
                    elif entry == 2:
                        row = r10
                    band[where] += blocks[at, row, s]
