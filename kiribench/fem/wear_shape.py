"""Kernel of the shape derivatives: how the residual of a facet changes as its cut tips move."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.fem.batches import LANES

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@njit(cache=True, error_model="numpy")
def shape_block(
    x: FloatArray,
    first: FloatArray,
    nodes: IntArray,
    elements: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    moved: FloatArray,
    order: IntArray,
    start: IntArray,
    rows: IntArray,
    column: IntArray,
    kept: IntArray,
    store: FloatArray,
    result: FloatArray,
) -> None:
    """Derivatives of the condensed residual by the four half-cuts of each facet of a block.

    With G = d(dP)/dP of a motion dP of the nodes at rest: dF = -F G, and the force
    f_a = w F S g_a changes by w (d(FS) + tr G FS - FS G') g_a.

    Args:
        x, first: the surface's jet at the patch nodes, (u, 3) and (u, 2, 3).
        moved: (B, 4, n, 2, L) motion of the nodes at rest by each half-cut.
        order, start, rows, column, kept, store: of the elimination, after factorisation.
        result: (B, 4, b, 2, L) written: what reaches the kept nodes, in q.
    """
    n = nodes.shape[1]
    own = np.empty((n, 3, LANES))
    pull = np.empty((4, n, 3, LANES))
    right = np.empty((n, 2, LANES))
    f = np.empty((3, 2))
    t = np.empty((3, 2))
    df = np.empty((3, 2))
    g = np.empty((2, 2))
    for batch in range(gradients.shape[0]):
        begin = batch * LANES
        for node in range(n):
            for s in range(LANES):
                at = nodes[begin + s, node]
                for d in range(3):
                    own[node, d, s] = x[at, d]
        pull[:] = 0.0
        for e in range(elements.shape[0]):
            for p in range(areas.shape[2]):
                for s in range(LANES):
                    f[:] = 0.0
                    for i in range(elements.shape[1]):
                        node = elements[e, i]
                        for d in range(3):
                            for k in range(2):
                                f[d, k] += own[node, d, s] * gradients[batch, e, p, i, k, s]
                    c11 = f[0, 0] ** 2 + f[1, 0] ** 2 + f[2, 0] ** 2
                    c22 = f[0, 1] ** 2 + f[1, 1] ** 2 + f[2, 1] ** 2
                    c12 = f[0, 0] * f[0, 1] + f[1, 0] * f[1, 1] + f[2, 0] * f[2, 1]
                    inverse = 1.0 / (c11 * c22 - c12 * c12)
                    m11, m22, m12 = c22 * inverse, c11 * inverse, -c12 * inverse
                    w = mu * areas[batch, e, p, s]
                    s11, s22, s12 = 1 - m11 * inverse, 1 - m22 * inverse, -m12 * inverse
                    for d in range(3):
                        t[d, 0] = f[d, 0] * s11 + f[d, 1] * s12
                        t[d, 1] = f[d, 0] * s12 + f[d, 1] * s22
                    for edge in range(4):
                        g[:] = 0.0
                        for i in range(elements.shape[1]):
                            node = elements[e, i]
                            for a in range(2):
                                for k in range(2):
                                    g[a, k] += (
                                        moved[batch, edge, node, a, s]
                                        * gradients[batch, e, p, i, k, s]
                                    )
                        for d in range(3):
                            df[d, 0] = -f[d, 0] * g[0, 0] - f[d, 1] * g[1, 0]
                            df[d, 1] = -f[d, 0] * g[0, 1] - f[d, 1] * g[1, 1]
                        d11 = d22 = d12 = 0.0
                        for d in range(3):
                            d11 += 2 * f[d, 0] * df[d, 0]
                            d22 += 2 * f[d, 1] * df[d, 1]
                            d12 += f[d, 0] * df[d, 1] + f[d, 1] * df[d, 0]
                        trace = m11 * d11 + m22 * d22 + 2 * m12 * d12
                        a11, a12 = m11 * d11 + m12 * d12, m11 * d12 + m12 * d22
                        a21, a22 = m12 * d11 + m22 * d12, m12 * d12 + m22 * d22
                        r11 = inverse * (a11 * m11 + a12 * m12 + m11 * trace)
                        r12 = inverse * (a11 * m12 + a12 * m22 + m12 * trace)
                        r22 = inverse * (a21 * m12 + a22 * m22 + m22 * trace)
                        growth = g[0, 0] + g[1, 1]
                        for d in range(3):
                            h0 = (
                                df[d, 0] * s11
                                + df[d, 1] * s12
                                + f[d, 0] * r11
                                + f[d, 1] * r12
                                + growth * t[d, 0]
                                - t[d, 0] * g[0, 0]
                                - t[d, 1] * g[0, 1]
                            )
                            h1 = (
                                df[d, 0] * s12
                                + df[d, 1] * s22
                                + f[d, 0] * r12
                                + f[d, 1] * r22
                                + growth * t[d, 1]
                                - t[d, 0] * g[1, 0]
                                - t[d, 1] * g[1, 1]
                            )
                            for i in range(elements.shape[1]):
                                pull[edge, elements[e, i], d, s] += w * (
                                    h0 * gradients[batch, e, p, i, 0, s]
                                    + h1 * gradients[batch, e, p, i, 1, s]
                                )
        blocks = store[batch]
        for edge in range(4):
            for node in range(n):
                for s in range(LANES):
                    at = nodes[begin + s, node]
                    for a in range(2):
                        right[node, a, s] = (
                            first[at, a, 0] * pull[edge, node, 0, s]
                            + first[at, a, 1] * pull[edge, node, 1, s]
                            + first[at, a, 2] * pull[edge, node, 2, s]
                        )
            for k in range(len(order)):
                top = right[order[k]]
                for i in range(start[k], start[k + 1]):
                    low = blocks[column[i]]
                    below = right[rows[i]]
                    for s in range(LANES):
                        below[0, s] -= low[0, s] * top[0, s] + low[1, s] * top[1, s]
                    for s in range(LANES):
                        below[1, s] -= low[2, s] * top[0, s] + low[3, s] * top[1, s]
            for k in range(len(kept)):
                result[batch, edge, k] = right[kept[k]]
