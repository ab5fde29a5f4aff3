"""The one pass over a scan's connectivity that both the health report and the repair use.

Stages, in order: refuse what has no meaning (no faces, wrong indices, NaN, absurd size), weld,
drop degenerate and duplicate faces, drop specks, refuse edges with three faces, make the
winding consistent and outward, split bow-ties, drop unreferenced vertices. Every stage leaves
a fault: an error if it cannot be mended, a warning with the magnitude if it was.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.surface import connectivity
from kiribench.surface.clean_flat import drop_degenerate
from kiribench.surface.clean_state import Cleaned
from kiribench.surface.clean_weld import weld
from kiribench.surface.mesh import FloatArray, IntArray, Mesh

SPECK_FRACTION = 0.01
"""A component with less than this share of the largest one's area is a speck."""

LARGEST_DIAGONAL_MM = 10_000.0
SMALLEST_DIAGONAL_MM = 5.0
FARTHEST_ORIGIN_MM = 1e6

INWARD_LIMIT = -0.2
"""Below this mean cosine between normals and directions from the centre, it is inside out."""


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
        weld,
        drop_degenerate,
        _duplicates,
        _specks,
        _three_faces,
        _winding,
        _outward,
        _bow_ties,
        _unreferenced,
    ):
        stage(work)
        if not work.usable and stage in (_meaning, _size, drop_degenerate):
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
