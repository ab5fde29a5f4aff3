"""Structured meshes of a cut patch that follow the cut lengths smoothly.

Every facet is a grid of mapped quads. At least half of an edge's nodes lie on its ligament and
the others on its half-cut, whatever their lengths, with the tip on a node: so the mesh never
changes but by moving, and its solution is a smooth function of the cut lengths. The vertices
inside follow the outline by a discrete harmonic map: the facet is convex, so no quad folds
however the tips lie (Tutte 1963, doi 10.1112/plms/s3-13.1.743). Every node's place is linear in
the four half-cuts.

Nine-node quads have their mid-side nodes beside a tip at the quarter points, which puts the
square root of the distance, with which a crack opens, into their shape functions (Barsoum 1976,
doi 10.1002/nme.1620100103; on quads Banks-Sills & Bortman 1984, doi 10.1007/BF01140841).

Frames: a facet's template is the unit square with edges walked counter-clockwise from (0, 0),
each starting in the site whose half-cut lies along it; every other facet is a mirror image
(:meth:`kiribench.lattice.CutMap.facet_half_cuts`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from kiribench.fem.elimination import Elimination, plan_nodes
from kiribench.lattice import CutMap

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


NO_CUT = 1e-4
"""A cut shorter than this share of the cell (a micrometre or two) is meshed as none: no laser cuts
it, its effect falls with its square, and its tip would lie on its site but for rounding."""


@dataclass(frozen=True, eq=False)
class FacetTemplate:
    """The quads of a facet on the unit square, whatever its cuts.

    Attributes:
        intervals: node intervals along an edge.
        order: 1 for four-node, 2 for nine-node quads.
        elements: (m, k) nodes.
        edges: (4, intervals + 1) nodes of the edges in walking order.
        outline: (o,) nodes of the outline, once each.
        spread: (n, o) the harmonic map: places of all nodes from those of the outline.
        shapes: (Q, k, 2) derivatives of the shape functions at the quadrature points.
        weights: (Q,) their weights.
    """

    intervals: int
    order: int
    elements: IntArray
    edges: IntArray
    outline: IntArray
    spread: FloatArray
    shapes: FloatArray
    weights: FloatArray

    @property
    def cut_nodes(self) -> int:
        """Nodes of an edge before its tip."""
        return _cut_nodes(self.intervals, self.order)


def lagrange(points: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Values and slopes (Q, order + 1) of the Lagrange polynomials on [-1, 1]."""
    nodes = np.linspace(-1, 1, order + 1)
    value = np.empty((len(points), order + 1))
    slope = np.empty_like(value)
    for i in range(order + 1):
        polynomial = np.poly1d(np.delete(nodes, i), r=True)
        polynomial = polynomial / polynomial(nodes[i])
        value[:, i], slope[:, i] = polynomial(points), polynomial.deriv()(points)
    return value, slope


@lru_cache(maxsize=32)
def facet_template(intervals: int, order: int) -> FacetTemplate:
    """The template with so many node intervals along an edge."""
    wide = intervals + 1
    number = np.arange(wide * wide).reshape(wide, wide)
    start = order * np.arange(intervals // order)
    steps = np.arange(order + 1)
    s0, t0 = (grid.ravel() for grid in np.meshgrid(start, start, indexing="ij"))
    ds, dt = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    elements = number[s0[:, None] + ds, t0[:, None] + dt]
    edges = np.stack([number[0], number[:, -1], number[-1, ::-1], number[::-1, 0]])
    points, weights = np.polynomial.legendre.leggauss(order + 1)
    value, slope = lagrange(points, order)
    by_t = np.einsum("pi,qj->pqij", value, slope).reshape(len(points) ** 2, -1)
    by_s = np.einsum("pi,qj->pqij", slope, value).reshape(len(points) ** 2, -1)
    return FacetTemplate(
        intervals,
        order,
        np.ascontiguousarray(elements),
        edges,
        np.unique(edges),
        _spread(number, edges, order),
        np.stack([by_t, by_s], axis=-1),
        np.outer(weights, weights).ravel(),
    )


def _spread(number: IntArray, edges: IntArray, order: int) -> FloatArray:
    """The harmonic map of the vertices, and the mid-side and centre nodes between them."""
    wide = len(number)
    outline = np.unique(edges)
    vertices = number[::order, ::order]
    inner, on = np.setdiff1d(vertices, outline), np.intersect1d(vertices, outline)
    spread = np.zeros((wide * wide, len(outline)))
    spread[outline, np.arange(len(outline))] = 1.0
    laplace = np.zeros((wide * wide, wide * wide))
    for near in (order, -order, order * wide, -order * wide):
        laplace[inner, inner + near] = -1.0
    laplace[inner, inner] = 4.0
    spread[inner] = np.linalg.solve(
        laplace[np.ix_(inner, inner)], -laplace[np.ix_(inner, on)] @ spread[on]
    )
    if order == 1:
        return spread
    level, upright = number[2:-2:2, 1::2], number[1::2, 2:-2:2]
    spread[level] = 0.5 * (spread[level - 1] + spread[level + 1])
    spread[upright] = 0.5 * (spread[upright - wide] + spread[upright + wide])
    tip = _cut_nodes(wide - 1, order)
    for node, inward in zip(edges[:, tip], (wide, -1, -wide, 1), strict=True):
        spread[node + inward] = 0.75 * spread[node] + 0.25 * spread[node + 2 * inward]
    # Centres such that the map of an element is that of its eight other nodes.
    centre = number[1::2, 1::2]
    sides = sum(spread[centre + step] for step in (-1, 1, -wide, wide))
    corners = sum(spread[centre + i + j] for i in (-1, 1) for j in (-wide, wide))
    spread[centre] = 0.5 * sides - 0.25 * corners
    return spread


def _cut_nodes(intervals: int, order: int) -> int:
    """Nodes of an edge before its tip: half of its elements, rounded down."""
    return intervals // order // 2 * order


@lru_cache(maxsize=128)
def facet_plan(intervals: int, order: int, full: tuple[bool, bool, bool, bool]) -> Elimination:
    """Elimination of a facet that keeps its ligaments, and all of the edges named ``full``."""
    template = facet_template(intervals, order)
    kept = [
        edge if whole else edge[template.cut_nodes :]
        for edge, whole in zip(template.edges, full, strict=True)
    ]
    return plan_nodes(template.elements, len(template.spread), np.unique(np.concatenate(kept)))


def edge_nodes(cut: FloatArray, template: FacetTemplate) -> tuple[FloatArray, FloatArray]:
    """Places (..., intervals + 1) of the nodes on edges with half-cuts ``cut`` (...), and their
    derivatives by ``cut``; fractions of the facet edge. Uncut edges are divided evenly.
    """
    before = template.cut_nodes
    after = template.intervals - before
    h = np.asarray(cut, dtype=np.float64)[..., None]
    from_start = 1 - _from_tip(before, template.order)[::-1]
    from_tip = _from_tip(after, template.order)[1:]
    place = np.concatenate([h * from_start, h + (1 - h) * from_tip], axis=-1)
    change = np.broadcast_to(np.concatenate([from_start, 1 - from_tip]), place.shape)
    even = np.arange(template.intervals + 1) / template.intervals
    return np.where(h > 0, place, even), np.where(h > 0, change, 0.0)


def _from_tip(intervals: int, order: int) -> FloatArray:
    """(intervals + 1,) distances from the tip on a side of length 1, with its quarter point."""
    distance = np.arange(intervals + 1) / intervals
    if order == 2:
        distance[1] = 0.25 * distance[2]
    return distance


_START = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
_ALONG = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def facet_points(half_cuts: FloatArray, template: FacetTemplate) -> tuple[FloatArray, FloatArray]:
    """Nodes (f, n, 2) of facets with half-cuts (f, 4) on the unit square, and (f, 4, n, 2)
    their derivatives by each half-cut."""
    place, change = edge_nodes(half_cuts, template)
    column = np.full(len(template.spread), -1)
    column[template.outline] = np.arange(len(template.outline))
    outline = np.zeros((len(half_cuts), len(template.outline), 2))
    moved = np.zeros((len(half_cuts), 4, len(template.outline), 2))
    for edge in range(4):
        at = column[template.edges[edge]]
        outline[:, at] = _START[edge] + place[:, edge, :, None] * _ALONG[edge]
        moved[:, edge, at] = change[:, edge, :, None] * _ALONG[edge]
    return (
        np.einsum("no,foi->fni", template.spread, outline, optimize=True),
        np.einsum("no,feoi->feni", template.spread, moved, optimize=True),
    )


@dataclass(frozen=True, eq=False)
class PatchMesh:
    """A meshed patch of F facets with n nodes each; U nodes in all.

    Attributes:
        template: of every facet.
        cut_map: what was meshed: cuts below ``NO_CUT`` are 0.
        points_mm: (U, 2) nodes at rest, patch coordinates.
        nodes: (F, n) patch node of each facet node; facets row by row.
        facet_mm: (F, n, 2) nodes at rest by facet.
        moved_mm: (F, 4, n, 2) their derivatives by the half-cuts / facet edge on each edge.
        full: (F, 4) edges of which all nodes are kept by the elimination.
        half_cuts: (F, 4) half-cuts / facet edge.
        mirrored: (F,) facets that are mirror images.
        shape: (Q, P) rows and columns of facets.
    """

    template: FacetTemplate
    cut_map: CutMap
    points_mm: FloatArray
    nodes: IntArray
    facet_mm: FloatArray
    moved_mm: FloatArray
    full: BoolArray
    half_cuts: FloatArray
    mirrored: BoolArray
    shape: tuple[int, int]

    def gradients(self) -> tuple[FloatArray, FloatArray]:
        """(F, m, Q, k, 2) gradients of the shape functions, 1/mm, and (F, m, Q) areas, mm^2.

        Raises:
            ValueError: an element is folded.
        """
        template = self.template
        corners = self.facet_mm[:, template.elements]
        jacobian = np.einsum("fmai,qar->fmqir", corners, template.shapes, optimize=True)
        determinant = (
            jacobian[..., 0, 0] * jacobian[..., 1, 1] - jacobian[..., 0, 1] * jacobian[..., 1, 0]
        )
        sign = np.where(self.mirrored, -1.0, 1.0)[:, None, None]
        if not np.all(sign * determinant > 0):
            raise ValueError("an element of the mesh is folded")
        inverse = np.empty_like(jacobian)
        inverse[..., 0, 0] = jacobian[..., 1, 1] / determinant
        inverse[..., 1, 1] = jacobian[..., 0, 0] / determinant
        inverse[..., 0, 1] = -jacobian[..., 0, 1] / determinant
        inverse[..., 1, 0] = -jacobian[..., 1, 0] / determinant
        gradients = np.einsum("qar,fmqri->fmqai", template.shapes, inverse, optimize=True)
        return gradients, np.abs(determinant) * template.weights

    def site_nodes(self) -> IntArray:
        """(F, 4) patch node at the corner of each facet: sites (0,0), (0,1), (1,1), (1,0) of
        (row, column) counted from the facet's own."""
        walk = self.template.edges[:, 0]
        plain, turned = walk, walk[[1, 0, 3, 2]]
        local = np.where(self.mirrored[:, None], turned, plain)
        return np.take_along_axis(self.nodes, local, axis=1)


def physical_edge(edge: int, mirrored: bool) -> int:
    """Which edge of the template lies on a physical edge (0 bottom, 1 right, 2 top, 3 left)."""
    return (0, 3, 2, 1)[edge] if mirrored else edge


def mesh_patch(
    cut_map: CutMap, intervals: int, order: int, *, hold: tuple[bool, bool] = (True, True)
) -> PatchMesh:
    """Mesh a patch; ``hold`` says whether the proximal and the distal edge will be strapped.

    Cuts shorter than ``NO_CUT`` of the cell are none.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = (np.where(cuts < NO_CUT, 0.0, cuts) for cuts in (cut_map.a, cut_map.b))
    cut_map = CutMap(a, b, cut_map.cell_mm)
    template = facet_template(intervals, order)
    half_cuts, mirrored = cut_map.facet_half_cuts()
    rows, columns = mirrored.shape
    half_cuts = half_cuts.reshape(-1, 4)
    flip = mirrored.ravel()
    points, moved = facet_points(half_cuts, template)
    points[flip, :, 0] = 1 - points[flip, :, 0]
    moved[flip, ..., 0] *= -1
    size = cut_map.cell_mm / 2
    place = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    facet_mm = size * (place[:, None, :] + points)

    # Facets share the nodes of ligaments: edge k of one is edge k' of its neighbour, walked
    # alike from the site whose half-cut lies along it.
    count = len(template.spread)
    facet = np.arange(rows * columns).reshape(rows, columns)
    full = np.zeros((rows * columns, 4), dtype=bool)
    ones, twos = [], []
    for one, two, edge, opposite in (
        (facet[:, :-1].ravel(), facet[:, 1:].ravel(), 1, 3),
        (facet[:-1].ravel(), facet[1:].ravel(), 2, 0),
    ):
        for turned in (False, True):
            chosen = flip[one] == turned
            mine = physical_edge(edge, turned)
            theirs = physical_edge(opposite, not turned)
            uncut = half_cuts[one[chosen], mine] <= 0
            for whole in (False, True):
                pick = uncut == whole
                start = 0 if whole else template.cut_nodes
                here, there = one[chosen][pick], two[chosen][pick]
                ones.append((here[:, None] * count + template.edges[mine, start:]).ravel())
                twos.append((there[:, None] * count + template.edges[theirs, start:]).ravel())
                full[here, mine] |= whole
                full[there, theirs] |= whole
    for row, edge, held in ((0, 0, hold[0]), (rows - 1, 2, hold[1])):
        full[facet[row], edge] |= held
    total = rows * columns * count
    one, two = np.concatenate(ones), np.concatenate(twos)
    links = coo_array((np.ones(len(one)), (one, two)), shape=(total, total))
    used, number = connected_components(links, directed=False)
    nodes = number.astype(np.int64).reshape(rows * columns, count)
    points_mm = np.empty((used, 2))
    points_mm[nodes] = facet_mm
    return PatchMesh(
        template,
        cut_map,
        points_mm,
        nodes,
        facet_mm,
        size * moved,
        full,
        half_cuts,
        flip,
        (rows, columns),
    )
