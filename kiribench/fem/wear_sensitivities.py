"""Exact derivatives of a worn patch by its cut lengths.

At equilibrium R(q, P) = 0 with P the nodes at rest, which move with the cut tips. So
dq = -K^-1 dR/dP dP: direct differentiation with the tangent that Newton's method ended with.
The derivatives are those of the discrete model, the motion of the mesh included.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array

from kiribench.fem.wear_measures import site_means
from kiribench.fem.wear_shape import shape_block
from kiribench.fem.wear_system import WearSystem, lanes_last
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def half_cut_weights(rows: int, columns: int, cell_mm: float) -> csr_array:
    """(4F, 2RC) derivatives of the facets' half-cuts by (a, b): rows as ``PatchMesh.half_cuts``.

    The lattice's rule is linear and local; it is read off the lattice itself, for nine sets of
    cells so far apart that no half-cut belongs to two of them.
    """
    facets = 4 * (2 * rows) * (2 * columns)
    one, two, weight = [], [], []
    owner = np.arange(rows * columns).reshape(rows, columns)
    # The only cell of a set that can own a half-cut of a facet: within one cell of the facet.
    cell_row = np.repeat(np.arange(2 * rows) // 2, 2 * columns)
    cell_column = np.tile(np.arange(2 * columns) // 2, 2 * rows)
    for i in range(3):
        for j in range(3):
            chosen = np.zeros((rows, columns))
            chosen[i::3, j::3] = 0.5
            if not chosen.any():
                continue
            near_row = cell_row + (i - cell_row + 1) % 3 - 1
            near_column = cell_column + (j - cell_column + 1) % 3 - 1
            inside = (
                (near_row >= 0) & (near_row < rows) & (near_column >= 0) & (near_column < columns)
            )
            near = np.where(
                inside, owner[near_row.clip(0, rows - 1), near_column.clip(0, columns - 1)], -1
            )
            zero = np.zeros_like(chosen)
            for offset, cuts in (
                (0, CutMap(chosen, zero, cell_mm)),
                (rows * columns, CutMap(zero, chosen, cell_mm)),
            ):
                half = cuts.facet_half_cuts()[0].reshape(-1)
                at = np.flatnonzero(half)
                one.append(at)
                two.append(offset + near[at // 4])
                weight.append(half[at] / 0.5)
    return coo_array(
        (np.concatenate(weight), (np.concatenate(one), np.concatenate(two))),
        shape=(facets, 2 * rows * columns),
    ).tocsr()


def corner_sensitivities(system: WearSystem, q: FloatArray) -> FloatArray:
    """((R + 1) (C + 1) 2, 2RC) d corner_q_mm / d (a, b) at the equilibrium q (U, 2).

    The system must have been linearised at q.
    """
    mesh = system.mesh
    jet = system.jet(q)
    rows, columns, values = [], [], []
    for group in system.groups:
        plan = group.plan
        count = group.count
        moved = lanes_last(mesh.moved_mm, group.chosen)
        result = np.empty((len(moved), 4, len(plan.kept), 2, moved.shape[-1]))
        shape_block(
            jet.x,
            jet.first,
            group.nodes,
            mesh.template.elements,
            group.gradients,
            group.areas,
            system.mu_mpa,
            moved,
            plan.order,
            plan.start,
            plan.rows,
            plan.column,
            plan.kept,
            group.store,
            result,
        )
        by_facet = np.moveaxis(result, -1, 1).reshape(-1, 4, len(plan.kept), 2)[:count]
        equation = system.equation[group.nodes[:count][:, plan.kept]]
        where = np.broadcast_to(equation[:, None], by_facet.shape)
        which = np.broadcast_to(
            (4 * group.facets[:, None] + np.arange(4))[:, :, None, None], by_facet.shape
        )
        free = where >= 0
        rows.append(where[free])
        columns.append(which[free])
        values.append(by_facet[free])
    by_half_cut = coo_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(system.size, mesh.half_cuts.size),
    ).tocsr()
    weights = half_cut_weights(mesh.cut_map.rows, mesh.cut_map.columns, mesh.cut_map.cell_mm)
    answer = system.solve_kept(-(by_half_cut @ weights).toarray())
    count = weights.shape[1]
    sites = np.unique(mesh.site_nodes())
    nodal = np.zeros((*system.equation.shape, count))
    equation = system.equation[sites]
    nodal[sites] = np.where((equation >= 0)[..., None], answer[equation], 0.0)
    corners = site_means(mesh, nodal.reshape(len(nodal), -1))[::2, ::2]
    return np.asarray(corners.reshape(-1, count))
