"""Mesh of one facet: six-node triangles graded towards the four cut tips on its edges.

A facet is the square between four lattice sites. Walking round it, every edge starts in a site
with a half-cut along the edge and goes on, past the cut's tip, as a ligament to the next site.
The mesh lives in the unit square; a facet of the other parity is its mirror image.

Near a tip the displacement grows with the square root of the distance, also at large strain in
a neo-Hookean sheet (Knowles & Sternberg, J. Elasticity 13, 1983). Triangles at a tip have their
mid-side nodes at the quarter points, which puts that root into their shape functions (Barsoum,
Int. J. Num. Meth. Eng. 10, 1976, doi 10.1002/nme.1620100103). Slender ligaments do without: they
are hinges that turn by 45 degrees, where the stretch at a quarter-point triangle reaches 30 and
Newton's method takes twice the iterations, for a gain of .003 in nu.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_SMALL_CUT = 0.12
"""Cuts and ligaments below this need no more than one element beside the tip (facet edges)."""

_SLENDER = 0.12
"""Tips before a ligament below this (facet edges) have no quarter-point triangles."""


@dataclass(frozen=True)
class MeshSpec:
    """How fine the mesh of a facet is.

    Attributes:
        longest: longest element edge / facet edge.
        growth: growth of the element edge with the distance from a tip.
        tip: element edge at a tip / the shorter of the half-cut and its ligament.
    """

    longest: float = 0.5
    growth: float = 0.5
    tip: float = 0.3

    def __post_init__(self) -> None:
        if not (0 < self.longest <= 1 and 0 < self.growth <= 2 and 0 < self.tip <= 1):
            raise ValueError(
                "a mesh needs 0 < longest <= 1, 0 < growth <= 2 and 0 < tip <= 1: "
                f"got {self.longest}, {self.growth}, {self.tip}"
            )

    @classmethod
    def of_edge(cls, edge_mm: float, cell_mm: float = 10.0) -> MeshSpec:
        """The mesh whose longest edge is ``edge_mm``, the grading in proportion to the default."""
        scale = edge_mm / (cls().longest * cell_mm / 2)
        return cls().scaled(scale)

    def scaled(self, factor: float) -> MeshSpec:
        """A mesh with every edge ``factor`` times as long (at most the coarsest allowed)."""
        return MeshSpec(
            min(1.0, factor * self.longest),
            min(2.0, factor * self.growth),
            min(1.0, factor * self.tip),
        )

    def coarser(self) -> MeshSpec:
        """The mesh with edges 1.6 times as long, for error estimates."""
        return self.scaled(1.6)


@dataclass(frozen=True, eq=False)
class FacetMesh:
    """Six-node triangles on the unit square.

    Attributes:
        points: (n, 2) nodes, in facet edges.
        triangles: (m, 6) node numbers: three corners counter-clockwise, then the mid-side
            nodes of the sides 0-1, 1-2 and 2-0.
        edges: for each of the four edges its nodes in walking order, both corners included.
        cut_nodes: how many nodes of each edge come before its tip: they lie on a cut face.
    """

    points: FloatArray
    triangles: IntArray
    edges: tuple[IntArray, IntArray, IntArray, IntArray]
    cut_nodes: tuple[int, int, int, int]

    def ligament(self, edge: int) -> IntArray:
        """Nodes of an edge from its tip (or, uncut, its start) to its end."""
        return self.edges[edge][self.cut_nodes[edge] :]

    def cut_face(self, edge: int) -> IntArray:
        """Nodes of an edge from its start to its tip, the tip included; empty where uncut."""
        count = self.cut_nodes[edge]
        return self.edges[edge][: count + 1] if count else self.edges[edge][:0]


@lru_cache(maxsize=2048)
def mesh_facet(half_cuts: tuple[float, float, float, float], spec: MeshSpec) -> FacetMesh:
    """Mesh the facet whose half-cuts have the given lengths.

    Args:
        half_cuts: along the bottom, right, top and left edge, walking counter-clockwise from
            (0, 0); fractions of the facet edge in [0, 1), 0 for no cut.
        spec: how fine.
    """
    tips, tip_edges = _tips(half_cuts, spec)
    outline, cut_counts, edge_counts = _outline(half_cuts, tips, tip_edges, spec)
    points = _fill(outline, tips, tip_edges, spec)
    points, corners = _smooth(points, len(outline), tips)
    rooted = np.array([1 - cut > _SLENDER for cut in half_cuts if cut > 0], dtype=bool)
    return _six_node(points, corners, tips[rooted], cut_counts, edge_counts)


def _tips(half_cuts: tuple[float, ...], spec: MeshSpec) -> tuple[FloatArray, FloatArray]:
    """The tips (t, 2) of the edges that are cut, and the element edge (t,) at each."""
    tips, sizes = [], []
    for edge, cut in enumerate(half_cuts):
        if cut <= 0:
            continue
        start, end = CORNERS[edge], CORNERS[(edge + 1) % 4]
        tips.append(start + cut * (end - start))
        if cut > 0.5:
            size = spec.tip * (1 - cut)
        else:
            size = max(spec.tip * cut, min(cut, _SMALL_CUT * min(1.0, spec.tip / 0.3)))
        sizes.append(min(size, spec.longest))
    return np.array(tips).reshape(-1, 2), np.array(sizes)


def _size(
    points: FloatArray, tips: FloatArray, tip_edges: FloatArray, spec: MeshSpec
) -> FloatArray:
    """Element edge (n,) wanted at points (n, 2)."""
    if not len(tips):
        return np.full(len(points), spec.longest)
    distance = np.linalg.norm(points[:, None] - tips[None], axis=2)
    graded = tip_edges + spec.growth * np.maximum(distance - tip_edges, 0)
    return np.asarray(np.minimum(spec.longest, graded.min(axis=1)))


def _divide(length: float, sizes: FloatArray, grid: FloatArray, slack: float) -> FloatArray:
    """Nodes on [0, length] with spacings in proportion to ``sizes``, given on ``grid``."""
    steps = np.diff(grid) * 0.5 * (1 / sizes[1:] + 1 / sizes[:-1])
    count = np.concatenate([[0.0], np.cumsum(steps)])
    elements = max(1, int(np.ceil(count[-1] - slack)))
    nodes = np.interp(np.linspace(0, count[-1], elements + 1), count, grid)
    nodes[-1] = length
    return np.asarray(nodes)


def _outline(
    half_cuts: tuple[float, ...], tips: FloatArray, tip_edges: FloatArray, spec: MeshSpec
) -> tuple[FloatArray, list[int], list[int]]:
    """Vertices round the facet, and per edge the elements on its cut and on all of it.

    A ligament is shared with a neighbour whose other cuts may differ: its nodes depend on its
    own cut alone. A cut face is nobody else's: it follows every tip.
    """
    parts, cut_counts, edge_counts = [], [], []
    unit = np.linspace(0, 1, 1001) ** 2
    tip_index = 0
    for edge, cut in enumerate(half_cuts):
        start, end = CORNERS[edge], CORNERS[(edge + 1) % 4]
        along = end - start
        nodes = np.zeros(1)
        if cut > 0:
            grid = cut * unit
            wanted = _size(start + np.outer(cut - grid, along), tips, tip_edges, spec)
            nodes = cut - _divide(cut, wanted, grid, 0.15)[::-1]
        cut_counts.append(len(nodes) - 1)
        grid = (1 - cut) * unit
        if cut > 0:
            own = tip_edges[tip_index]
            wanted = np.minimum(spec.longest, own + spec.growth * np.maximum(grid - own, 0))
            tip_index += 1
        else:
            wanted = np.full(len(grid), spec.longest)
        nodes = np.concatenate([nodes, cut + _divide(1 - cut, wanted, grid, 0.3)[1:]])
        edge_counts.append(len(nodes) - 1)
        vertices = start + np.outer(nodes, along)
        vertices[-1] = end
        parts.append(vertices[:-1])
    return np.concatenate(parts), cut_counts, edge_counts


def _fill(
    outline: FloatArray, tips: FloatArray, tip_edges: FloatArray, spec: MeshSpec
) -> FloatArray:
    """The outline's vertices followed by inner ones: rings round the tips, then the gaps."""
    rings: list[FloatArray] = []
    radii: list[FloatArray] = []
    for tip, own in zip(tips, tip_edges, strict=True):
        if min(tip[0], 1 - tip[0]) > 1e-12:
            wall = np.pi / 2 if tip[1] < 0.5 else -np.pi / 2
        else:
            wall = 0.0 if tip[0] < 0.5 else np.pi
        radius = own
        while radius < 1.2:
            edge = min(spec.longest, own + spec.growth * max(radius - own, 0))
            count = max(3, round(np.pi * radius / edge))
            angle = wall - np.pi / 2 + np.pi * np.arange(1, count) / count
            rings.append(tip + radius * np.column_stack([np.cos(angle), np.sin(angle)]))
            radii.append(np.full(count - 1, radius))
            radius += 0.9 * edge
    placed = np.empty((len(outline) + sum(map(len, rings)) + 4096, 2))
    placed[: len(outline)] = outline
    used = len(outline)
    if rings:
        candidates = np.concatenate(rings)
        order = np.argsort(np.concatenate(radii), kind="stable")
        candidates = candidates[order]
        wanted = _size(candidates, tips, tip_edges, spec)
        room = np.minimum(candidates, 1 - candidates).min(axis=1)
        for point, edge in zip(
            candidates[room >= 0.55 * wanted], wanted[room >= 0.55 * wanted], strict=True
        ):
            gap = np.min(np.sum((placed[:used] - point) ** 2, axis=1))
            if gap > (0.72 * edge) ** 2:
                placed[used] = point
                used += 1
    count = max(24, int(np.ceil(6 / spec.longest)))
    ticks = (np.arange(count) + 0.5) / count
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    wanted = _size(grid, tips, tip_edges, spec)
    inside = np.minimum(grid, 1 - grid).min(axis=1) > 0.5 * wanted
    grid, wanted = grid[inside], wanted[inside]
    if len(grid):
        from scipy.spatial import cKDTree

        gaps = np.asarray(cKDTree(placed[:used]).query(grid)[0])
        while True:
            worst = int(np.argmax(gaps / wanted))
            if gaps[worst] < 0.85 * wanted[worst]:
                break
            placed[used] = grid[worst]
            gaps = np.minimum(gaps, np.linalg.norm(grid - placed[used], axis=1))
            used += 1
    return placed[:used].copy()


def _delaunay(points: FloatArray) -> IntArray:
    """Counter-clockwise triangles; the flat ones on the straight outline are left out."""
    from scipy.spatial import Delaunay

    corners = Delaunay(points).simplices.astype(np.int64)
    one, two = (
        points[corners[:, 1]] - points[corners[:, 0]],
        points[corners[:, 2]] - points[corners[:, 0]],
    )
    area = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    corners = np.where((area < 0)[:, None], corners[:, [0, 2, 1]], corners)
    return np.asarray(corners[np.abs(area) > 1e-10])


def _smooth(points: FloatArray, fixed: int, tips: FloatArray) -> tuple[FloatArray, IntArray]:
    """Inner vertices moved half-way to the mean of their neighbours, five times over."""
    points = points.copy()
    tip_nodes = [int(np.argmin(np.linalg.norm(points - tip, axis=1))) for tip in tips]
    for _ in range(5):
        corners = _delaunay(points)
        sides = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        sides = np.unique(np.sort(sides, axis=1), axis=0)
        total = np.zeros_like(points)
        degree = np.zeros(len(points))
        for one, two in ((0, 1), (1, 0)):
            np.add.at(total, sides[:, one], points[sides[:, two]])
            np.add.at(degree, sides[:, one], 1)
        held = np.zeros(len(points), dtype=bool)
        held[:fixed] = True
        fan = np.isin(sides, tip_nodes)
        held[sides[fan.any(axis=1)].ravel()] = True
        moved = 0.5 * points + 0.5 * total / degree[:, None]
        points = np.where(held[:, None], points, moved)
    return points, _delaunay(points)


def _six_node(
    vertices: FloatArray,
    corners: IntArray,
    tips: FloatArray,
    cut_counts: list[int],
    edge_counts: list[int],
) -> FacetMesh:
    """Mid-side nodes, at the quarter points beside a tip, and the lists of edge nodes."""
    sides = np.stack([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]], axis=1)
    keys, which = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    which = which.reshape(-1, 3)
    at_tip = np.zeros(len(vertices), dtype=bool)
    for tip in tips:
        at_tip[np.argmin(np.linalg.norm(vertices - tip, axis=1))] = True
    weight = np.full(len(keys), 0.5)
    weight[at_tip[keys[:, 0]] & ~at_tip[keys[:, 1]]] = 0.75
    weight[~at_tip[keys[:, 0]] & at_tip[keys[:, 1]]] = 0.25
    middles = weight[:, None] * vertices[keys[:, 0]] + (1 - weight)[:, None] * vertices[keys[:, 1]]
    points = np.concatenate([vertices, middles])
    triangles = np.concatenate([corners, which + len(vertices)], axis=1)
    number = {(int(i), int(j)): len(vertices) + k for k, (i, j) in enumerate(keys)}
    round_trip = sum(edge_counts)
    edges, at = [], 0
    for count in edge_counts:
        walk: list[int] = []
        for k in range(at, at + count):
            one, two = k, (k + 1) % round_trip
            walk += [one, number[min(one, two), max(one, two)]]
        walk.append((at + count) % round_trip)
        edges.append(np.array(walk, dtype=np.int64))
        at += count
    return FacetMesh(
        points,
        triangles,
        (edges[0], edges[1], edges[2], edges[3]),
        (2 * cut_counts[0], 2 * cut_counts[1], 2 * cut_counts[2], 2 * cut_counts[3]),
    )
