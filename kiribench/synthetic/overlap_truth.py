"""The true areal overlap of skin cells and patch cells on a smooth surface.

A skin cell S and a patch cell K are the regions of the parameter domain that the geodesics
between their four corners enclose. |S|, |K| and |S and K| are integrals of sqrt(det g) over
u and v: the domain is cut at every corner, every sampled point of a side and every crossing
of two sides into strips of constant sides; on Gauss rows of each strip the sides' crossings
tell which intervals lie in S, in K and in both, and each interval is integrated by Gauss's
rule in the closed-form density. Nothing is flattened, no polygon is clipped, no mesh is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kiribench.synthetic.arc import geodesic_arcs
from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.smooth import SmoothSurface

GOOD = 0.90
FAIR = 0.75
"""Lowest overlap of a good and of a fair cell; exactly 75 % is fair (our reading)."""

SIDE_PIECES = 24
ROWS_A_STRIP = 2
POINTS_AN_INTERVAL = 5


@dataclass(frozen=True, eq=False)
class OverlapTruth:
    """Areas on the smooth 90-degree skin, one entry a patch cell.

    Attributes:
        skin_mm2, patch_mm2, common_mm2: (R, C) areas |S|, |K| and |S and K|.
    """

    skin_mm2: FloatArray
    patch_mm2: FloatArray
    common_mm2: FloatArray

    @property
    def paper(self) -> FloatArray:
        """(R, C) |S and K| / |S|: the share of the skin cell that its patch cell covers."""
        return self.common_mm2 / self.skin_mm2

    @property
    def strict(self) -> FloatArray:
        """(R, C) |S and K| / max(|S|, |K|)."""
        return self.common_mm2 / np.maximum(self.skin_mm2, self.patch_mm2)

    @property
    def iou(self) -> FloatArray:
        """(R, C) |S and K| / |S or K|."""
        return self.common_mm2 / (self.skin_mm2 + self.patch_mm2 - self.common_mm2)

    def grades(self) -> tuple[tuple[str, ...], ...]:
        """Grade of every cell by the paper's overlap: good >= .90, fair >= .75, else poor."""
        return tuple(tuple(grade(value) for value in row) for row in self.paper)


def grade(overlap: float) -> str:
    """``good``, ``fair`` or ``poor``."""
    return "good" if overlap >= GOOD else "fair" if overlap >= FAIR else "poor"


def overlap_truth(
    surface: SmoothSurface,
    skin_nodes: FloatArray,
    patch_corners: FloatArray,
    *,
    side_pieces: int = SIDE_PIECES,
) -> OverlapTruth:
    """The areas of every cell and of what they share.

    Args:
        surface: the smooth skin at 90 degrees.
        skin_nodes: (R + 1, C + 1, 2) material points of the skin nodes under the patch.
        patch_corners: (R + 1, C + 1, 2) material points under the patch's cell corners.
        side_pieces: straight pieces (in the parameter domain) a geodesic side.
    """
    skin = cell_outlines(surface, skin_nodes, side_pieces)
    patch = cell_outlines(surface, patch_corners, side_pieces)
    shape = (skin_nodes.shape[0] - 1, skin_nodes.shape[1] - 1)
    rules = [_rule(s, k) for s, k in zip(skin, patch, strict=True)]
    areas = _integrate(surface, rules).reshape(*shape, 3)
    return OverlapTruth(areas[..., 0], areas[..., 1], areas[..., 2])


def cell_outlines(surface: SmoothSurface, nodes: FloatArray, pieces: int) -> FloatArray:
    """(R C, 4 pieces, 2) outlines of the cells of a node grid, with geodesic sides.

    Args:
        surface: the smooth surface.
        nodes: (R + 1, C + 1, 2) parameters of the nodes.
        pieces: straight pieces a side.
    """
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    across = geodesic_arcs(
        surface, nodes[:, :-1].reshape(-1, 2), nodes[:, 1:].reshape(-1, 2)
    ).sampled(pieces)
    along = geodesic_arcs(surface, nodes[:-1].reshape(-1, 2), nodes[1:].reshape(-1, 2)).sampled(
        pieces
    )
    across = across.reshape(rows + 1, columns, pieces + 1, 2)
    along = along.reshape(rows, columns + 1, pieces + 1, 2)
    outline = np.concatenate(
        [
            across[:-1, :, :-1],
            along[:, 1:, :-1],
            across[1:, :, :0:-1],
            along[:, :-1, :0:-1],
        ],
        axis=2,
    )
    return outline.reshape(rows * columns, 4 * pieces, 2)


@dataclass(frozen=True, eq=False)
class _Rule:
    """Quadrature points (n, 2) with weights (n, 3) for S, K and their common part."""

    points: FloatArray
    weights: FloatArray


def _rule(skin: FloatArray, patch: FloatArray) -> _Rule:
    outlines = (skin, patch)
    starts = np.concatenate(outlines)
    ends = np.concatenate([np.roll(outline, -1, axis=0) for outline in outlines])
    in_patch = np.arange(len(starts)) >= len(skin)
    levels = np.unique(np.concatenate([starts[:, 1], _crossing_levels(skin, patch)]))
    heights = np.diff(levels)
    node, weight = np.polynomial.legendre.leggauss(ROWS_A_STRIP)
    v = (levels[:-1, None] + 0.5 * heights[:, None] * (node + 1.0)).ravel()
    v_weight = (0.5 * heights[:, None] * weight).ravel()

    # Where each row meets each side; a side belongs to a row strictly between its ends.
    below, above = np.minimum(starts[:, 1], ends[:, 1]), np.maximum(starts[:, 1], ends[:, 1])
    meets = (v[:, None] > below) & (v[:, None] < above)
    rise = ends[:, 1] - starts[:, 1]
    slope = np.divide(ends[:, 0] - starts[:, 0], rise, out=np.zeros_like(rise), where=rise != 0)
    u = np.where(meets, starts[:, 0] + slope * (v[:, None] - starts[:, 1]), np.inf)
    most = int(meets.sum(axis=1).max())
    order = np.argsort(u, axis=1)[:, :most]
    u = np.take_along_axis(u, order, axis=1)
    owner = in_patch[order]
    met = np.isfinite(u)
    inside_skin = np.cumsum(met & ~owner, axis=1) % 2 == 1
    inside_patch = np.cumsum(met & owner, axis=1) % 2 == 1
    spans = met[:, :-1] & met[:, 1:] & (inside_skin | inside_patch)[:, :-1]
    row, slot = np.nonzero(spans)
    left, width = u[row, slot], u[row, slot + 1] - u[row, slot]
    node, weight = np.polynomial.legendre.leggauss(POINTS_AN_INTERVAL)
    points = np.empty((len(row), POINTS_AN_INTERVAL, 2))
    points[..., 0] = left[:, None] + 0.5 * width[:, None] * (node + 1.0)
    points[..., 1] = v[row, None]
    weights = 0.5 * width[:, None] * weight * v_weight[row, None]
    kinds = np.stack([inside_skin, inside_patch, inside_skin & inside_patch], axis=-1)[row, slot]
    return _Rule(points.reshape(-1, 2), (weights[..., None] * kinds[:, None, :]).reshape(-1, 3))


def _crossing_levels(skin: FloatArray, patch: FloatArray) -> FloatArray:
    """The v of every crossing of a side of one outline with a side of the other."""
    a, b = skin[:, None], np.roll(skin, -1, axis=0)[:, None]
    c, d = patch[None], np.roll(patch, -1, axis=0)[None]
    ab, cd, ac = b - a, d - c, c - a
    cross = ab[..., 0] * cd[..., 1] - ab[..., 1] * cd[..., 0]
    safe = np.where(np.abs(cross) > 1e-14, cross, np.inf)
    t = (ac[..., 0] * cd[..., 1] - ac[..., 1] * cd[..., 0]) / safe
    s = (ac[..., 0] * ab[..., 1] - ac[..., 1] * ab[..., 0]) / safe
    hit = (t > 0.0) & (t < 1.0) & (s > 0.0) & (s < 1.0) & np.isfinite(safe)
    return np.asarray((a[..., 1] + t * ab[..., 1])[hit])


def _integrate(surface: SmoothSurface, rules: Sequence[_Rule]) -> FloatArray:
    """(n, 3) the rules' integrals of the area density, evaluated a few cells at a time."""
    out = np.empty((len(rules), 3))
    for first in range(0, len(rules), 4):
        batch = rules[first : first + 4]
        density = surface.area_density(np.concatenate([rule.points for rule in batch]))
        parts = np.split(density, np.cumsum([len(rule.points) for rule in batch])[:-1])
        for offset, (rule, part) in enumerate(zip(batch, parts, strict=True)):
            out[first + offset] = part @ rule.weights
    return out
