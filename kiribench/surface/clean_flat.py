"""Cleaning, faces without area: dropped, collapsed or flipped away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.surface.clean_state import Cleaned
from kiribench.surface.mesh import FloatArray, IntArray

FLAT_FRACTION = 1e-7
"""A face is degenerate if its height over the longest edge is below this share of it."""


def drop_degenerate(work: Cleaned) -> None:
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
