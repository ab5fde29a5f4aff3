"""The health report of a scan: what is wrong with it, how much, and what can be done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault
from kiribench.surface import connectivity
from kiribench.surface.clean import clean
from kiribench.surface.clean_state import Cleaned
from kiribench.surface.mesh import IntArray, Mesh


@dataclass(frozen=True)
class MeshHealth:
    """Counts, sizes and faults of a scan.

    The counts are of the mesh as given, each after the faults named before it are mended
    (an unwelded mesh is welded before its holes are counted). Where an error ends the check
    early (``faults``), later counts are 0. Self-intersections are not looked for.

    Attributes:
        vertices, faces: how many.
        nonfinite_vertices: NaN or infinite coordinates, referenced or not.
        unreferenced_vertices: in no face.
        unwelded_vertices: repeat another vertex so that edges do not join.
        degenerate_faces: a repeated vertex, or corners on one line.
        duplicate_faces: the same three vertices as an earlier face.
        components: edge-connected pieces, specks included.
        nonmanifold_edges: with three or more faces, once duplicates and specks are gone.
        inconsistent_edges: whose two faces are wound against each other.
        bowtie_vertices: where two fans of faces touch in one point.
        borders: border loops; each piece has one outer border, the longest.
        hole_perimeters_mm: of the other loops, longest first.
        border_perimeter_mm: of the outer borders together; 0 for a closed surface.
        bounds_mm: lower and upper corner of the bounding box of all finite vertices.
        edge_mm: shortest, median, mean and longest edge.
        area_mm2: of the surface.
        faults: errors and warnings with remedies.
    """

    vertices: int
    faces: int
    nonfinite_vertices: int
    unreferenced_vertices: int
    unwelded_vertices: int
    degenerate_faces: int
    duplicate_faces: int
    components: int
    nonmanifold_edges: int
    inconsistent_edges: int
    bowtie_vertices: int
    borders: int
    hole_perimeters_mm: tuple[float, ...]
    border_perimeter_mm: float
    bounds_mm: tuple[tuple[float, float, float], tuple[float, float, float]] | None
    edge_mm: tuple[float, float, float, float] | None
    area_mm2: float
    faults: tuple[Fault, ...]

    @property
    def holes(self) -> int:
        """Border loops beside the outer border of each piece."""
        return len(self.hole_perimeters_mm)

    @property
    def usable(self) -> bool:
        """Whether no error was found."""
        return not any(fault.severity == "error" for fault in self.faults)


def check_mesh(mesh: Mesh, *, file: str | None = None) -> MeshHealth:
    """Check ``mesh`` (mm) without changing it; every fault at once, nothing is raised.

    An error is what :func:`kiribench.surface.repair.repair_mesh` refuses, a warning is what it
    mends (or what needs no mending, such as a hole).
    """
    work = clean(mesh, file=file)
    counts = work.counts
    whole = work.usable
    loops = _border_loops(work) if whole else _NO_LOOPS
    faults = list(work.faults)
    if loops.holes:
        faults.append(
            Fault(
                "mesh-holes",
                f"The surface has {len(loops.holes)} holes; the largest has a perimeter of "
                f"{loops.holes[0]:.1f} mm near ({loops.at[0]:.1f}, {loops.at[1]:.1f}, "
                f"{loops.at[2]:.1f}) mm. Paths lead around holes and come out too long there.",
                remedy="Fill holes inside the grid in the scanner's software, or scan again.",
                file=file,
                severity="warning",
            )
        )
    finite = mesh.vertices_mm[np.isfinite(mesh.vertices_mm).all(axis=1)]
    edges, area = _sizes(work) if whole else (None, 0.0)
    return MeshHealth(
        vertices=len(mesh.vertices_mm),
        faces=len(mesh.faces),
        nonfinite_vertices=counts.get("nonfinite_vertices", 0),
        unreferenced_vertices=counts.get("unreferenced_vertices", 0),
        unwelded_vertices=counts.get("unwelded_vertices", 0),
        degenerate_faces=counts.get("degenerate_faces", 0),
        duplicate_faces=counts.get("duplicate_faces", 0),
        components=counts.get("components", 0),
        nonmanifold_edges=counts.get("nonmanifold_edges", 0),
        inconsistent_edges=counts.get("inconsistent_edges", 0),
        bowtie_vertices=counts.get("bowtie_vertices", 0),
        borders=loops.outer_count + len(loops.holes),
        hole_perimeters_mm=loops.holes,
        border_perimeter_mm=loops.outer,
        bounds_mm=(_corner(finite.min(axis=0)), _corner(finite.max(axis=0)))
        if len(finite)
        else None,
        edge_mm=edges,
        area_mm2=area,
        faults=tuple(faults),
    )


@dataclass(frozen=True)
class _Loops:
    holes: tuple[float, ...]
    outer: float
    outer_count: int
    at: tuple[float, float, float]


_NO_LOOPS = _Loops((), 0.0, 0, (0.0, 0.0, 0.0))


def _border_loops(work: Cleaned) -> _Loops:
    """Perimeters of the border loops; bow-ties are parted already, so a loop is a component."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    order, starts = work.edges()
    half = order[starts[:-1][np.diff(starts) == 1]]
    if len(half) == 0:
        return _NO_LOOPS
    tail, head = work.faces[half // 3, half % 3], work.faces[half // 3, (half + 1) % 3]
    used, local = np.unique(np.concatenate([tail, head]), return_inverse=True)
    tails, heads = local[: len(half)], local[len(half) :]
    graph = coo_array((np.ones(len(half), dtype=bool), (tails, heads)), shape=(len(used),) * 2)
    count, label = connected_components(graph, directed=False)
    loop = label[tails]
    length = np.linalg.norm(work.xyz[head] - work.xyz[tail], axis=1)
    perimeter = np.bincount(loop, weights=length, minlength=count)
    piece = connectivity.face_components(work.faces, order, starts, False)[half // 3]
    piece_of_loop = np.zeros(count, dtype=np.int64)
    piece_of_loop[loop] = piece
    outer = np.zeros(count, dtype=bool)
    by_length = np.argsort(-perimeter, kind="stable")
    _, first = np.unique(piece_of_loop[by_length], return_index=True)
    outer[by_length[first]] = True
    holes = by_length[~outer[by_length]]
    at = _NO_LOOPS.at
    if len(holes):
        at = _corner(work.xyz[tail[loop == holes[0]]].mean(axis=0))
    return _Loops(
        holes=tuple(float(value) for value in perimeter[holes]),
        outer=float(perimeter[outer].sum()),
        outer_count=int(outer.sum()),
        at=at,
    )


def _sizes(work: Cleaned) -> tuple[tuple[float, float, float, float], float]:
    order, starts = work.edges()
    lengths = edge_lengths_mm(work, order, starts)
    p, q, r = (work.xyz[work.faces[:, corner]] for corner in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(q - p, r - p), axis=1).sum())
    statistics = (lengths.min(), np.median(lengths), lengths.mean(), lengths.max())
    return (
        float(statistics[0]),
        float(statistics[1]),
        float(statistics[2]),
        float(statistics[3]),
    ), area


def edge_lengths_mm(
    work: Cleaned, order: IntArray, starts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """(e,) length of every edge, mm."""
    half = order[starts[:-1]]
    tail, head = work.faces[half // 3, half % 3], work.faces[half // 3, (half + 1) % 3]
    return np.asarray(np.linalg.norm(work.xyz[head] - work.xyz[tail], axis=1))


def _corner(row: NDArray[np.float64]) -> tuple[float, float, float]:
    return (float(row[0]), float(row[1]), float(row[2]))
