"""The one pass over a scan's connectivity that both the health report and the repair use.

Stages, in order: refuse what has no meaning (no faces, wrong indices, NaN, absurd size), weld,
drop degenerate and duplicate faces, drop specks, refuse edges with three faces, make the
winding consistent and outward, split bow-ties, drop unreferenced vertices. Every stage leaves
a fault: an error if it cannot be mended, a warning with the magnitude if it was.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, Severity
from kiribench.surface import connectivity
from kiribench.surface.mesh import FloatArray, IntArray, Mesh

SPECK_FRACTION = 0.01
"""A component with less than this share of the largest one's area is a speck."""

LARGEST_DIAGONAL_MM = 10_000.0
SMALLEST_DIAGONAL_MM = 5.0
FARTHEST_ORIGIN_MM = 1e6

NEAR_FRACTION = 1e-3
"""Border vertices closer than this share of the shortest edge at them are one vertex."""

FLAT_FRACTION = 1e-7
"""A face is degenerate if its height over the longest edge is below this share of it."""

INWARD_LIMIT = -0.2
"""Below this mean cosine between normals and directions from the centre, it is inside out."""


@dataclass
class Cleaned:
    """The state of a scan on its way through the stages.

    Attributes:
        xyz: (n, 3) float64 vertices, mm; faces: (m, 3) int32, as they are now.
        face_source: (m,) the face of the given mesh that each face was (or lies in, if remade).
        vertex_source: (n,) the vertex of the given mesh that each vertex was.
        welded_to: (n given,) the vertex that stands for each given vertex.
        twin: (m given,) the face that a dropped duplicate equals, itself otherwise.
        flipped: (m,) whether the winding was reversed.
        remade: (m,) whether an edge flip changed the corners (degenerate neighbours).
        faults: what was found, with severity.
        counts: the numbers for the health report.
    """

    xyz: FloatArray
    faces: IntArray
    file: str | None
    face_source: NDArray[np.int64]
    vertex_source: NDArray[np.int64]
    welded_to: NDArray[np.int64]
    twin: NDArray[np.int64]
    flipped: NDArray[np.bool_]
    remade: NDArray[np.bool_]
    faults: list[Fault] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    _grouped: tuple[IntArray, IntArray, NDArray[np.int64]] | None = None

    def edges(self) -> tuple[IntArray, NDArray[np.int64]]:
        """The edge groups (order, starts) of the faces as they are now, computed once."""
        if self._grouped is None or self._grouped[0] is not self.faces:
            order, starts = connectivity.edge_groups(self.faces, len(self.xyz))
            self._grouped = (self.faces, order, starts)
        return self._grouped[1], self._grouped[2]

    @property
    def usable(self) -> bool:
        """Whether no error was found so far."""
        return not any(fault.severity == "error" for fault in self.faults)

    def found(
        self, code: str, what: str, remedy: str, *, severity: Severity = "warning", **more: Any
    ) -> None:
        """Note a fault of this scan."""
        self.faults.append(
            Fault(code, what, remedy=remedy, file=self.file, severity=severity, **more)
        )

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Keep only the faces where ``kept`` (m,) is true."""
        self.faces = np.ascontiguousarray(self.faces[kept])
        self.face_source = self.face_source[kept]
        self.flipped = self.flipped[kept]
        self.remade = self.remade[kept]


def clean(mesh: Mesh, *, file: str | None = None) -> Cleaned:
    """Take ``mesh`` through all stages; it stops at the first that leaves nothing to go on."""
    count, faces = len(mesh.vertices_mm), len(mesh.faces)
    work = Cleaned(
        xyz=mesh.vertices_mm,
        faces=np.ascontiguousarray(mesh.faces, dtype=np.int32),
        file=file,
        face_source=np.arange(faces),
        vertex_source=np.arange(count),
        welded_to=np.arange(count),
        twin=np.arange(faces),
        flipped=np.zeros(faces, dtype=bool),
        remade=np.zeros(faces, dtype=bool),
    )
    for stage in (
        _meaning,
        _size,
        _weld,
        _degenerate,
        _duplicates,
        _specks,
        _three_faces,
        _winding,
        _outward,
        _bow_ties,
        _unreferenced,
    ):
        stage(work)
        if not work.usable and stage in (_meaning, _size, _degenerate):
            break
    return work


def _meaning(work: Cleaned) -> None:
    """Faces, valid indices, finite coordinates."""
    count = len(work.xyz)
    again = "Export or copy the scan again."
    if len(work.faces) == 0:
        work.found("mesh-no-faces", "The scan has no faces.", again, severity="error")
        return
    wrong = np.flatnonzero(((work.faces < 0) | (work.faces >= count)).any(axis=1))
    if len(wrong):
        work.found(
            "mesh-index-range",
            f"{len(wrong)} faces name vertices that do not exist; the first is face {wrong[0]}.",
            again,
            severity="error",
            got=str(work.faces[wrong[0]].tolist()),
            expected=f"0 to {count - 1}",
        )
        return
    used = np.zeros(count, dtype=bool)
    used[work.faces.reshape(-1)] = True
    unfinished = ~np.isfinite(work.xyz).all(axis=1)
    work.counts["nonfinite_vertices"] = int(unfinished.sum())
    work.counts["unreferenced_vertices"] = int((~used).sum())
    bad = np.flatnonzero(unfinished & used)
    if len(bad):
        work.found(
            "mesh-nan-vertex",
            f"{len(bad)} vertices that faces use have no finite position; "
            f"the first is vertex {bad[0]}.",
            "Export the scan again; NaN marks points that the scanner did not measure, and "
            "their faces must be left out.",
            severity="error",
            got=str(work.xyz[bad[0]].tolist()),
            expected="three finite numbers",
        )


def _size(work: Cleaned) -> None:
    """Refuse what no body part in millimetres can be."""
    used = np.unique(work.faces)
    low, high = work.xyz[used].min(axis=0), work.xyz[used].max(axis=0)
    with np.errstate(over="ignore"):
        diagonal = float(np.linalg.norm(high - low))
    farthest = float(max(np.abs(low).max(), np.abs(high).max()))
    units = 'Check "Units" in the scan\'s sidecar (mm, cm, m, in).'
    if not diagonal <= LARGEST_DIAGONAL_MM:
        work.found(
            "mesh-huge",
            "The scan is larger than any body part.",
            f"{units} Or single vertices lie far off: remove them.",
            severity="error",
            got=f"a bounding box diagonal of {diagonal:.6g} mm",
            expected=f"at most {LARGEST_DIAGONAL_MM:g} mm",
        )
    elif diagonal < SMALLEST_DIAGONAL_MM:
        work.found(
            "mesh-tiny",
            "The scan is smaller than a single drawn cell.",
            f"{units} Metres taken for millimetres look like this.",
            severity="error",
            got=f"a bounding box diagonal of {diagonal:.6g} mm",
            expected=f"at least {SMALLEST_DIAGONAL_MM:g} mm",
        )
    elif farthest > FARTHEST_ORIGIN_MM:
        work.found(
            "mesh-far-off",
            "The scan lies so far from the origin that its coordinates are rounded.",
            "Export it in a frame near the body; single precision is used by most scanners.",
            severity="error",
            got=f"{farthest:.6g} mm from the origin",
            expected=f"at most {FARTHEST_ORIGIN_MM:g} mm",
        )


def _weld(work: Cleaned) -> None:
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


def _degenerate(work: Cleaned) -> None:
    """Drop faces with a repeated vertex; flip away faces whose corners lie on one line."""
    a, b, c = work.faces.T
    repeated = (a == b) | (b == c) | (c == a)
    number = int(repeated.sum())
    if number:
        work.keep(~repeated)
    flat = _flat_faces(work.xyz, work.faces)
    in_line = int(flat.sum())
    work.counts["degenerate_faces"] = number + in_line
    if len(work.faces) == in_line:
        work.found(
            "mesh-no-area",
            "Every face of the scan is degenerate: the surface has no area.",
            "Export the scan again.",
            severity="error",
        )
        return
    if in_line > 0.05 * len(work.faces):
        work.found(
            "mesh-degenerate",
            f"{in_line} of {len(work.faces)} faces have no area.",
            "Remesh the scan in the scanner's software and export it again.",
            severity="error",
            got=f"{in_line / len(work.faces):.1%}",
            expected="at most 5%",
        )
        return
    if in_line:
        _flip_flat(work)
    if number + in_line:
        work.found(
            "mesh-degenerate-faces",
            f"{number + in_line} faces without area ({number} with a repeated vertex, {in_line} "
            "with corners on one line) are removed, the latter by edge flips.",
            "Nothing to do.",
        )


def _flat_faces(xyz: FloatArray, faces: IntArray) -> NDArray[np.bool_]:
    """(m,) bool: height over the longest edge below ``FLAT_FRACTION`` of it."""
    p, q, r = (xyz[faces[:, corner]] for corner in range(3))
    longest = np.zeros(len(faces))
    for s, t in ((p, q), (q, r), (r, p)):
        difference = t - s
        np.maximum(longest, np.einsum("ij,ij->i", difference, difference), out=longest)
    twice_area = np.linalg.norm(np.cross(q - p, r - p), axis=1)
    return np.asarray(twice_area <= FLAT_FRACTION * longest)


def _collapse_short(work: Cleaned) -> None:
    """Make one the ends of the short side of each flat face that has a short side."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    flat = np.flatnonzero(_flat_faces(work.xyz, work.faces))
    corners = work.xyz[work.faces[flat]]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    short = sides.argmin(axis=1)
    needle = sides.min(axis=1) <= 10 * FLAT_FRACTION * sides.max(axis=1)
    if not needle.any():
        return
    face, side = flat[needle], short[needle]
    ends = work.faces[face, side], work.faces[face, (side + 1) % 3]
    count = len(work.xyz)
    joined = coo_array((np.ones(len(face), dtype=bool), ends), shape=(count, count))
    label = connected_components(joined, directed=False)[1]
    lowest = np.full(label.max() + 1, count)
    np.minimum.at(lowest, label, np.arange(count))
    target = lowest[label]
    work.welded_to = target[work.welded_to]
    work.faces = np.ascontiguousarray(target[work.faces].astype(np.int32))
    p, q, r = work.faces.T
    work.keep((p != q) & (q != r) & (r != p))


def _flip_flat(work: Cleaned) -> None:
    """Flip the longest side of each flat face with its neighbour; drop it on a border."""
    _collapse_short(work)
    for _ in range(8):
        flat = _flat_faces(work.xyz, work.faces)
        if not flat.any():
            return
        order, starts = work.edges()
        edge_of = np.empty(len(order), dtype=np.int64)
        edge_of[order] = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        touched = flat.copy()
        faces = work.faces.copy()
        dropped = np.zeros(len(faces), dtype=bool)
        for face in np.flatnonzero(flat):
            side = _longest_side(work.xyz[work.faces[face]])
            edge = edge_of[3 * face + side]
            halves = order[starts[edge] : starts[edge + 1]]
            if len(halves) != 2:
                dropped[face] = True
                continue
            other, other_side = divmod(int(halves.sum()) - int(3 * face + side), 3)
            if touched[other]:
                continue
            u, v = work.faces[face, side], work.faces[face, (side + 1) % 3]
            w = work.faces[face, (side + 2) % 3]
            x = work.faces[other, (other_side + 2) % 3]
            if x != w and work.faces[other, other_side] == v:
                faces[face] = (u, x, w)
                faces[other] = (x, v, w)
                touched[other] = True
                work.remade[face] = work.remade[other] = True
                work.face_source[face] = work.face_source[other]
        work.faces = faces
        if dropped.any():
            work.keep(~dropped)
    work.keep(~_flat_faces(work.xyz, work.faces))


def _longest_side(corners: FloatArray) -> int:
    return int(np.argmax(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)))


def _duplicates(work: Cleaned) -> None:
    first = connectivity.duplicate_faces(work.faces)
    repeated = first != np.arange(len(first))
    number = int(repeated.sum())
    work.counts["duplicate_faces"] = number
    if number:
        work.twin[work.face_source[repeated]] = work.face_source[first[repeated]]
        work.keep(~repeated)
        work.found(
            "mesh-duplicate-faces",
            f"{number} faces repeat another one; they are dropped.",
            "Nothing to do.",
        )


def _specks(work: Cleaned) -> None:
    """Drop components below ``SPECK_FRACTION`` of the largest; name several large ones."""
    order, starts = work.edges()
    root = connectivity.face_components(work.faces, order, starts, False)
    roots, label = np.unique(root, return_inverse=True)
    area = np.bincount(label, weights=_areas(work.xyz, work.faces))
    work.counts["components"] = len(roots)
    if len(roots) == 1:
        return
    speck = area < SPECK_FRACTION * area.max()
    if speck.any():
        dropped = speck[label]
        work.found(
            "mesh-specks",
            f"{int(speck.sum())} loose pieces ({int(dropped.sum())} faces, "
            f"{area[speck].sum():.3g} mm^2, each below {SPECK_FRACTION:.0%} of the main piece) "
            "are dropped.",
            "Nothing to do.",
        )
        work.keep(~dropped)
    work.counts["large_components"] = int((~speck).sum())


def _areas(xyz: FloatArray, faces: IntArray) -> FloatArray:
    p, q, r = (xyz[faces[:, corner]] for corner in range(3))
    return np.asarray(0.5 * np.linalg.norm(np.cross(q - p, r - p), axis=1))


def _three_faces(work: Cleaned) -> None:
    order, starts = work.edges()
    root = connectivity.face_components(work.faces, order, starts, True)
    pieces = len(np.unique(root))
    if pieces > 1:
        work.found(
            "mesh-pieces",
            f"The scan consists of {pieces} large pieces that are not connected; no path can "
            "lead from one to another.",
            "Close the gaps in the scanner's software, or crop to the piece with the grid.",
        )
    many = np.flatnonzero(np.diff(starts) > 2)
    work.counts["nonmanifold_edges"] = len(many)
    if len(many):
        half = order[starts[many[0]]]
        ends = work.faces[half // 3, [half % 3, (half + 1) % 3]]
        middle = work.xyz[ends].mean(axis=0)
        work.found(
            "mesh-nonmanifold",
            f"{len(many)} edges have more than two faces; the first is near "
            f"({middle[0]:.2f}, {middle[1]:.2f}, {middle[2]:.2f}) mm.",
            "Remove the fins or the inner sheets there in the scanner's software "
            '("remove non-manifold"), and export again.',
            severity="error",
        )


def _winding(work: Cleaned) -> None:
    order, starts = work.edges()
    flip, disagreeing, conflicts = connectivity.orientation(work.faces, order, starts)
    work.counts["inconsistent_edges"] = int(disagreeing)
    if conflicts:
        work.found(
            "mesh-one-sided",
            "The surface has only one side (like a Moebius strip): no inside and outside.",
            "Remove the faces that join the front to the back, and export again.",
            severity="error",
            got=f"{int(conflicts)} edges that no winding satisfies",
        )
        return
    if not disagreeing:
        return
    # Of the two consistent windings of a component keep the one that most area has already.
    root = connectivity.face_components(work.faces, order, starts, False)
    area = _areas(work.xyz, work.faces)
    total = np.bincount(root, weights=area, minlength=len(root))
    turned = np.bincount(root, weights=area * flip, minlength=len(root))
    flip = flip ^ (turned > 0.5 * total)[root]
    _reverse(work, flip)
    work.found(
        "mesh-winding",
        f"{int(flip.sum())} of {len(flip)} faces were wound against their neighbours "
        f"({int(disagreeing)} edges); they are turned.",
        "Nothing to do.",
    )


def _reverse(work: Cleaned, flip: NDArray[np.bool_]) -> None:
    work.faces = work.faces.copy()
    work.faces[flip] = work.faces[flip][:, [0, 2, 1]]
    work.flipped = work.flipped ^ flip


def outwardness(xyz: FloatArray, faces: IntArray) -> float:
    """Area mean of the cosine between face normals and directions from the area centre.

    1 on a sphere seen from outside, -1 from inside, about 0 on a plane or a saddle.
    """
    p, q, r = (xyz[faces[:, corner]] for corner in range(3))
    normal = 0.5 * np.cross(q - p, r - p)
    area = np.linalg.norm(normal, axis=1)
    centre = (p + q + r) / 3.0
    from_centre = centre - (area @ centre) / area.sum()
    reach = np.linalg.norm(from_centre, axis=1)
    return float(np.einsum("ij,ij->", normal, from_centre) / (area @ reach))


def _outward(work: Cleaned) -> None:
    if not work.usable:
        return
    cosine = outwardness(work.xyz, work.faces)
    if cosine < INWARD_LIMIT:
        _reverse(work, np.ones(len(work.faces), dtype=bool))
        work.found(
            "mesh-inside-out",
            "All faces are wound inside out (normals point into the body); all are turned.",
            "Nothing to do, unless the scan is of a mould: then turn it first.",
            got=f"a mean cosine of {cosine:.2f} with the directions from the centre",
            expected=f"above {INWARD_LIMIT:g}",
        )


def _bow_ties(work: Cleaned) -> None:
    order, starts = work.edges()
    fans = connectivity.corner_fans(work.faces, order, starts)
    faces, extra = connectivity.split_fans(work.faces, fans, len(work.xyz))
    number = len(np.unique(extra))
    work.counts["bowtie_vertices"] = number
    if number:
        work.faces = faces
        work.xyz = np.concatenate([work.xyz, work.xyz[extra]])
        work.vertex_source = np.concatenate([work.vertex_source, work.vertex_source[extra]])
        work.found(
            "mesh-bow-ties",
            f"At {number} vertices parts of the surface touch in a point only (a bow-tie); they "
            "are parted there.",
            "Nothing to do; crops along a jagged line leave them.",
        )


def _unreferenced(work: Cleaned) -> None:
    count = len(work.xyz)
    used = np.zeros(count, dtype=bool)
    used[work.faces.reshape(-1)] = True
    if used.all():
        return
    number = work.counts["unreferenced_vertices"]
    if number:
        work.found(
            "mesh-unreferenced",
            f"{number} vertices belong to no face; they are dropped.",
            "Nothing to do.",
        )
    position = np.cumsum(used) - 1
    work.faces = np.ascontiguousarray(position[work.faces].astype(np.int32))
    work.xyz = work.xyz[used]
    work.vertex_source = work.vertex_source[used]
