"""Meshes of cut sheets: facets joined along their ligaments, seams as split nodes.

Frame: x mm across the pull, y mm along it, as in :mod:`kiribench.lattice`. The nodes of a cut
face belong to one facet each, so that coincident nodes on the two faces of a cut are free to
part; the nodes of a ligament are shared by its two facets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.facet import FacetMesh, MeshSpec, mesh_facet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

__all__ = ["FacetBlock", "FacetGrid", "MeshSpec", "SheetMesh", "mesh_sheet"]


@dataclass(frozen=True, eq=False)
class FacetGrid:
    """Facets in rows (along y) and columns (along x), before they are meshed.

    Attributes:
        half_cuts: (Q, P, 4) half-cut / facet edge on the four edges in walking order.
        mirrored: (Q, P) whether the walk goes clockwise, from the corner at larger x.
        x_mm, y_mm: (P + 1,), (Q + 1,) the grid lines, mm.
    """

    half_cuts: FloatArray
    mirrored: BoolArray
    x_mm: FloatArray
    y_mm: FloatArray


@dataclass(frozen=True, eq=False)
class FacetBlock:
    """Facets that share one template mesh.

    Attributes:
        template: the mesh in the unit square.
        size_mm: (2,) edges of the facets, mm.
        nodes: (f, n) sheet node of each template node.
        mirrored: (f,) whether the facet is the template's mirror image in x.
        place: (f, 2) row and column in the facet grid.
    """

    template: FacetMesh
    size_mm: FloatArray
    nodes: IntArray
    mirrored: BoolArray
    place: IntArray


@dataclass(frozen=True, eq=False)
class SheetMesh:
    """A meshed sheet.

    Attributes:
        points_mm: (n, 2) nodes at rest, mm.
        blocks: the facets by template.
        corners: (Q, P, 4) nodes of every facet at its corners: (x0, y0), (x1, y0), (x1, y1),
            (x0, y1).
        x_mm, y_mm: the grid lines, mm.
    """

    points_mm: FloatArray
    blocks: tuple[FacetBlock, ...]
    corners: IntArray
    x_mm: FloatArray
    y_mm: FloatArray

    def triangles(self) -> IntArray:
        """(m, 6) nodes of every triangle; those of mirrored facets run clockwise."""
        return np.concatenate(
            [block.nodes[:, block.template.triangles].reshape(-1, 6) for block in self.blocks]
        )

    def boundary_nodes(self, side: str, *, ligaments_only: bool) -> IntArray:
        """Nodes on the ``"left"``, ``"right"``, ``"bottom"`` or ``"top"`` line of the grid.

        Left and bottom are at the smallest x and y. With ``ligaments_only`` the nodes that lie
        on a cut face alone are left out.
        """
        rows, columns = len(self.y_mm) - 1, len(self.x_mm) - 1
        axis, value, edge = {
            "left": (1, 0, 3),
            "right": (1, columns - 1, 1),
            "bottom": (0, 0, 0),
            "top": (0, rows - 1, 2),
        }[side]
        found: list[IntArray] = []
        for block in self.blocks:
            for at in np.flatnonzero(block.place[:, axis] == value):
                walk = _walk(edge, bool(block.mirrored[at]))
                template = block.template
                local = template.ligament(walk) if ligaments_only else template.edges[walk]
                found.append(block.nodes[at, local])
        return np.unique(np.concatenate(found))

    def cut_faces(self) -> list[tuple[IntArray, IntArray]]:
        """Opposite faces of every half-cut inside the sheet, each a walk from site to tip.

        The first of a pair has its facet to the left of the walk, the second to the right.
        """
        where = {
            (int(i), int(j)): (block, at)
            for block in self.blocks
            for at, (i, j) in enumerate(block.place)
        }
        faces = []
        for (i, j), (block, at) in where.items():
            for step, edge, opposite in (((0, 1), 1, 3), ((1, 0), 2, 0)):
                other = where.get((i + step[0], j + step[1]))
                if other is None:
                    continue
                mine = block.template.cut_face(_walk(edge, bool(block.mirrored[at])))
                if not len(mine):
                    continue
                twin, twin_at = other
                theirs = twin.template.cut_face(_walk(opposite, bool(twin.mirrored[twin_at])))
                pair = (block.nodes[at, mine], twin.nodes[twin_at, theirs])
                faces.append(pair[::-1] if block.mirrored[at] else pair)
        return faces


def _walk(edge: int, mirrored: bool) -> int:
    """Which edge of the template lies on a physical edge (0 bottom, 1 right, 2 top, 3 left)."""
    return (0, 3, 2, 1)[edge] if mirrored else edge


def mesh_sheet(grid: FacetGrid, spec: MeshSpec) -> SheetMesh:
    """Mesh every facet of the grid and join the facets along their ligaments."""
    rows, columns = grid.mirrored.shape
    widths, heights = np.diff(grid.x_mm), np.diff(grid.y_mm)
    groups: dict[tuple[float, ...], list[tuple[int, int]]] = {}
    for i in range(rows):
        for j in range(columns):
            cuts = np.round(grid.half_cuts[i, j], 12)
            key = (*cuts.tolist(), round(widths[j], 9), round(heights[i], 9))
            groups.setdefault(key, []).append((i, j))

    first = np.empty((rows, columns), dtype=np.int64)
    templates: dict[tuple[int, int], FacetMesh] = {}
    blocks: list[tuple[FacetMesh, FloatArray, IntArray, BoolArray, IntArray]] = []
    coordinates: list[FloatArray] = []
    used = 0
    for key, members in groups.items():
        template = mesh_facet((key[0], key[1], key[2], key[3]), spec)
        size = np.array(key[4:])
        place = np.array(members, dtype=np.int64)
        mirrored = grid.mirrored[place[:, 0], place[:, 1]]
        count = len(template.points)
        start = used + count * np.arange(len(members))
        used += count * len(members)
        first[place[:, 0], place[:, 1]] = start
        nodes = start[:, None] + np.arange(count)[None, :]
        for member in members:
            templates[member] = template
        x = np.where(mirrored[:, None], 1 - template.points[:, 0], template.points[:, 0])
        y = np.broadcast_to(template.points[:, 1], x.shape)
        origin = np.stack([grid.x_mm[place[:, 1]], grid.y_mm[place[:, 0]]], axis=1)
        coordinates.append((origin[:, None, :] + size * np.stack([x, y], axis=2)).reshape(-1, 2))
        blocks.append((template, size, nodes, mirrored, place))

    number, points = _join(grid, templates, first, np.concatenate(coordinates))
    corners = np.empty((rows, columns, 4), dtype=np.int64)
    for (i, j), template in templates.items():
        walk = [int(edge[0]) for edge in template.edges]
        if grid.mirrored[i, j]:
            walk = [walk[1], walk[0], walk[3], walk[2]]
        corners[i, j] = number[first[i, j] + np.array(walk)]
    return SheetMesh(
        points,
        tuple(
            FacetBlock(template, size, number[nodes], mirrored, place)
            for template, size, nodes, mirrored, place in blocks
        ),
        corners,
        grid.x_mm,
        grid.y_mm,
    )


def _join(
    grid: FacetGrid,
    templates: dict[tuple[int, int], FacetMesh],
    first: IntArray,
    coordinates: FloatArray,
) -> tuple[IntArray, FloatArray]:
    """Merge the coincident nodes of ligaments: (k,) new numbers, and the merged points."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ones: list[IntArray] = []
    twos: list[IntArray] = []
    rows, columns = grid.mirrored.shape
    for i in range(rows):
        for j in range(columns):
            for ii, jj, edge, opposite in ((i, j + 1, 1, 3), (i + 1, j, 2, 0)):
                if ii >= rows or jj >= columns:
                    continue
                mine = templates[i, j].ligament(_walk(edge, bool(grid.mirrored[i, j])))
                theirs = templates[ii, jj].ligament(_walk(opposite, bool(grid.mirrored[ii, jj])))
                ones.append(first[i, j] + mine)
                twos.append(first[ii, jj] + theirs)
    total = len(coordinates)
    one = np.concatenate([np.empty(0, np.int64), *ones])
    two = np.concatenate([np.empty(0, np.int64), *twos])
    links = coo_array((np.ones(len(one)), (one, two)), shape=(total, total))
    count, number = connected_components(links, directed=False)
    points = np.empty((count, 2))
    points[number] = coordinates
    return number.astype(np.int64), points
