"""Which marker is which in the next picture.

Small steps: the nearest marker to where it is expected. Large ones: an affine map is sought
that lays the markers of the last picture on those of the new one. Markers on a regular grid
look alike, so a map that is shifted by a pitch fits nearly as well; what tells it from the true
one is the rim of the grid, where markers are left over. Where the rim is not seen, the map that
moves the markers least is taken, with a warning; two maps with different stretches that fit
equally well are an ambiguity, and nothing is claimed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

GATE = 0.30
"""Of the distance between markers: farther away is another one."""
ENOUGH = 0.93
"""Share of paired markers with which the nearest ones are believed."""
RIVAL = 0.97
"""A second map with this part of the best one's score makes the pairing ambiguous."""


@dataclass(frozen=True, eq=False)
class Pairing:
    """Pairs of k expected markers with those of the new picture.

    Attributes:
        to: (k,) number in the new picture, -1 for none.
        score: pairs / the larger number of markers.
        ambiguous: a map with another stretch is as good.
        shifted: a map that is shifted by a whole pitch is as good; the one that moves the markers
            least was taken. The stretches are the same where neighbouring cells are alike.
    """

    to: IntArray
    score: float
    ambiguous: bool
    shifted: bool = False


def pair_nearest(expected: FloatArray, there: FloatArray, spacing_px: float) -> Pairing:
    """Pair markers that are each other's nearest, within the gate.

    Args:
        expected: (k, 2) px. there: (l, 2) px. spacing_px: distance of neighbours.
    """
    from scipy.spatial import cKDTree

    to = np.full(len(expected), -1, dtype=np.int64)
    known = np.isfinite(expected).all(axis=1)
    if not len(there) or not known.any():
        return Pairing(to, 0.0, False)
    here = np.flatnonzero(known)
    away, nearest = (np.asarray(part) for part in cKDTree(there).query(expected[here]))
    back = np.asarray(cKDTree(expected[here]).query(there)[1])
    mutual = back[nearest] == np.arange(len(here))
    good = np.asarray(mutual & (away <= GATE * spacing_px))
    to[here[good]] = nearest[good]
    return Pairing(to, float(good.sum() / max(len(here), len(there))), False)


def pair_by_map(
    here: FloatArray, there: FloatArray, spacing_px: float, pull: FloatArray
) -> Pairing:
    """Pair markers over a large step: stretches along and across the pull, then any affine map.

    Args:
        here: (k, 2) px where the markers were last. there: (l, 2) px. spacing_px: their distance.
        pull: (2,) direction.
    """
    known = np.flatnonzero(np.isfinite(here).all(axis=1))
    if len(known) < 6 or len(there) < 6:
        return Pairing(np.full(len(here), -1, dtype=np.int64), 0.0, False)
    points = here[known]
    middle = points.mean(axis=0)
    across = np.array([-pull[1], pull[0]])
    found: list[tuple[float, FloatArray, IntArray]] = []
    for along_stretch in np.arange(0.85, 2.35, 0.1):
        for across_stretch in np.arange(0.6, 1.5, 0.1):
            turn = along_stretch * np.outer(pull, pull) + across_stretch * np.outer(across, across)
            moved = (points - middle) @ turn.T
            for shift in _likely_shifts(moved, there, spacing_px):
                score, image, to = _refine(points, moved + shift, there, spacing_px)
                found.append((score, image, to))
    found.sort(key=lambda item: -item[0])
    score, image, to = found[0]
    ambiguous = shifted = False
    for other, rival, rival_to in found[1:]:
        if other <= RIVAL * score:
            break
        away = np.linalg.norm(rival - image, axis=1)
        if np.median(away) <= 0.5 * spacing_px:
            continue
        if np.ptp(away) > 0.5 * spacing_px:  # another stretch, not another pitch
            ambiguous = True
            break
        shifted = True
        if np.linalg.norm(rival.mean(axis=0) - middle) < np.linalg.norm(
            image.mean(axis=0) - middle
        ):
            image, to = rival, rival_to
    whole = np.full(len(here), -1, dtype=np.int64)
    whole[known] = to
    return Pairing(whole, score, ambiguous, shifted)


def _likely_shifts(moved: FloatArray, there: FloatArray, spacing_px: float) -> FloatArray:
    """The four shifts for which most differences between markers agree."""
    width = 0.4 * spacing_px
    some = moved[:: max(1, len(moved) // 60)]
    differences = (there[:, None] - some[None]).reshape(-1, 2)
    low = differences.min(axis=0)
    cell = ((differences - low) / width).astype(np.int64)
    columns = int(cell[:, 0].max()) + 1
    key = cell[:, 1] * columns + cell[:, 0]
    counts = np.bincount(key)
    best = np.argsort(-counts, kind="stable")[:4]
    return np.array([differences[key == k].mean(axis=0) for k in best])


def _refine(
    points: FloatArray, image: FloatArray, there: FloatArray, spacing_px: float
) -> tuple[float, FloatArray, IntArray]:
    """Improve a map by its own pairs: score, images (k, 2) and pairs (k,)."""
    pairing = pair_nearest(image, there, 1.5 * spacing_px)
    design = np.column_stack([np.ones(len(points)), points])
    for _ in range(6):
        good = pairing.to >= 0
        if good.sum() < 6:
            break
        fit, *_ = np.linalg.lstsq(design[good], there[pairing.to[good]], rcond=None)
        image = design @ fit
        pairing = pair_nearest(image, there, spacing_px)
    return pairing.score, image, pairing.to
