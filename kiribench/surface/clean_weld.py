"""Cleaning, welding: vertices that repeat another become one where edges then join."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.surface import connectivity
from kiribench.surface.clean_state import Cleaned

NEAR_FRACTION = 1e-3
"""Border vertices closer than this share of the shortest edge at them are one vertex."""


def weld(work: Cleaned) -> None:
    """Make vertices one that lie on each other and whose edges then join."""
    work.counts["unwelded_vertices"] = 0
    count = len(work.xyz)
    zeroed = work.xyz + 0.0  # -0 becomes 0
    same = connectivity.coincident_vertices(zeroed.view(np.uint64)).astype(np.int64)
    same = _with_near(work, same)
    if np.array_equal(same, np.arange(count)):
        return
    welded = same[work.faces].astype(np.int32)
    order, starts = connectivity.edge_groups(welded, count)
    closing = np.zeros(count, dtype=bool)
    marked = connectivity.closing_vertices(work.faces, welded, order, starts)
    closing[: len(marked)] = marked
    chosen = np.flatnonzero(closing)
    lowest = np.full(count, count)
    np.minimum.at(lowest, same[chosen], chosen)
    target = np.arange(count)
    target[chosen] = lowest[same[chosen]]
    number = int((target != np.arange(count)).sum())
    if number == 0:
        return
    work.welded_to = target
    work.faces = np.ascontiguousarray(target[work.faces].astype(np.int32))
    work.counts["unwelded_vertices"] = number
    gap = float(np.linalg.norm(work.xyz - work.xyz[target], axis=1)[closing].max())
    work.found(
        "mesh-unwelded",
        f"{number} of {count} vertices repeat another (up to {gap:.2g} mm apart), so that the "
        "surface falls apart; they are welded.",
        "Nothing to do; or export with shared vertices.",
    )


def _with_near(work: Cleaned, same: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join border vertices that differ by rounding only to their coincident groups."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(work.xyz)
    if np.array_equal(same, np.arange(count)):
        welded = work.faces
        order, starts = work.edges()
    else:
        welded = same[work.faces].astype(np.int32)
        order, starts = connectivity.edge_groups(welded, count)
    single = order[starts[:-1][np.diff(starts) == 1]]
    if len(single) == 0:
        return same
    border = np.unique(
        np.concatenate([welded[single // 3, single % 3], welded[single // 3, (single + 1) % 3]])
    )
    half = order[starts[:-1]]
    tail, head = welded[half // 3, half % 3], welded[half // 3, (half + 1) % 3]
    lengths = np.linalg.norm(work.xyz[head] - work.xyz[tail], axis=1)
    # Never more than the median: a few long edges must not make the search wide.
    shortest = np.full(count, np.median(lengths))
    np.minimum.at(shortest, tail, lengths)
    np.minimum.at(shortest, head, lengths)
    reach = NEAR_FRACTION * shortest[border]
    if reach.max() <= 0:
        return same
    pairs = cKDTree(work.xyz[border]).query_pairs(reach.max(), output_type="ndarray")
    first, second = pairs.T
    apart = np.linalg.norm(work.xyz[border[first]] - work.xyz[border[second]], axis=1)
    pairs = pairs[apart <= np.minimum(reach[first], reach[second])]
    if len(pairs) == 0:
        return same
    joined = coo_array(
        (np.ones(len(pairs), dtype=bool), (border[pairs[:, 0]], border[pairs[:, 1]])),
        shape=(count, count),
    )
    label = connected_components(joined, directed=False)[1]
    lowest = np.full(label.max() + 1, count)
    np.minimum.at(lowest, label, np.arange(count))
    return np.asarray(lowest[label][same], dtype=np.int64)
