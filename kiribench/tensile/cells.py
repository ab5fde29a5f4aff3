"""From followed points to the corners and stretches of cells, with their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.tensile.camera import PlaneView
from kiribench.tensile.elements import SUBSETS, Block, Elements
from kiribench.tensile.follow import Followed

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
StringArray = npt.NDArray[np.str_]

_RANK = {"ok": 0, "updated": 1, "doubtful": 2, "hidden": 3, "outside": 4, "lost": 5}
_LEAST = 5
"""Subsets of a facet that must be found, of nine."""
_STRAY = 5.0
"""A subset this many median distances off its facet's affine map is left out."""


@dataclass(frozen=True, eq=False)
class CellStates:
    """The cells in one picture, (k,) each, row after row.

    Attributes:
        longitudinal, lateral: stretches, NaN where not measured.
        sd: (k, 2) of the two. status: as in ``result.STATES``.
        corner: (R + 1, C + 1, 2) in the plane, NaN where not known.
        block: (2,) stretches of one affine map over all that was followed.
    """

    longitudinal: FloatArray
    lateral: FloatArray
    sd: FloatArray
    status: StringArray
    corner: FloatArray
    block: FloatArray


def worst(states: StringArray) -> str:
    """The worst of several states."""
    return max((str(state) for state in states), key=lambda state: _RANK.get(state, 9))


def cells_of_corners(
    rest: FloatArray, now: FloatArray, sd: FloatArray, status: StringArray
) -> CellStates:
    """Cells from their corners: each stretch is the mean over two opposite edges.

    Args:
        rest, now: (R + 1, C + 1, 2) corners in the plane. sd: (R + 1, C + 1) of a coordinate, in
            the plane. status: (R + 1, C + 1).
    """
    along = np.linalg.norm(np.diff(now, axis=0), axis=2)
    across = np.linalg.norm(np.diff(now, axis=1), axis=2)
    along0 = np.linalg.norm(np.diff(rest, axis=0), axis=2)
    across0 = np.linalg.norm(np.diff(rest, axis=1), axis=2)
    one, two = along / along0, across / across0
    longitudinal = 0.5 * (one[:, :-1] + one[:, 1:])
    lateral = 0.5 * (two[:-1] + two[1:])
    variance = sd * sd
    v_along = (variance[1:] + variance[:-1]) / along0**2
    v_across = (variance[:, 1:] + variance[:, :-1]) / across0**2
    sd_along = 0.5 * np.sqrt(v_along[:, :-1] + v_along[:, 1:])
    sd_across = 0.5 * np.sqrt(v_across[:-1] + v_across[1:])
    rows, columns = longitudinal.shape
    words = np.empty((rows, columns), dtype="<U16")
    for r, c in np.ndindex(rows, columns):
        words[r, c] = worst(status[r : r + 2, c : c + 2].ravel())
    bad = ~np.isin(words, ("ok", "updated"))
    bad |= ~np.isfinite(longitudinal) | ~np.isfinite(lateral)
    words[bad & np.isin(words, ("ok", "updated"))] = "lost"
    longitudinal, lateral = longitudinal.copy(), lateral.copy()
    longitudinal[bad] = lateral[bad] = np.nan
    known = np.asarray(np.isfinite(now).all(axis=2))
    return CellStates(
        longitudinal.ravel(),
        lateral.ravel(),
        np.stack([np.where(bad, np.nan, sd_along), np.where(bad, np.nan, sd_across)], -1).reshape(
            -1, 2
        ),
        words.ravel(),
        now,
        affine_stretches(rest[known], now[known], rest),
    )


def affine_stretches(rest: FloatArray, now: FloatArray, corner: FloatArray) -> FloatArray:
    """(2,) stretches along and across of the affine map of points (n, 2); NaN below 3 points.

    Args:
        rest, now: the points in the plane. corner: (R + 1, C + 1, 2) at rest, for the directions.
    """
    if len(rest) < 3:
        return np.full(2, np.nan)
    gradient, _, _ = affine(rest, now)
    directions = _directions(corner)
    return np.array([np.linalg.norm(gradient @ direction) for direction in directions])


def affine(rest: FloatArray, now: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(2, 2) gradient, (2,) shift of the middle, and (n, 2) residuals of an affine map."""
    middle = rest.mean(axis=0)
    design = np.column_stack([np.ones(len(rest)), rest - middle])
    fit, *_ = np.linalg.lstsq(design, now, rcond=None)
    return fit[1:].T, fit[0], now - design @ fit


def _directions(corner: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along and across of cells (.., 2 x 2 or more corners) at rest."""
    along = (corner[-1] - corner[0]).mean(axis=0)
    across = (corner[:, -1] - corner[:, 0]).mean(axis=0)
    return along / np.linalg.norm(along), across / np.linalg.norm(across)


class SpeckleCells:
    """Cells of a speckled sheet, from the subsets of its elements."""

    def __init__(self, block: Block, elements: Elements, view: PlaneView, *, cut: bool) -> None:
        self._block, self._elements, self._view, self._cut = block, elements, view, cut
        shape = (block.rows + 1, block.columns + 1)
        self.rest = view.plane(block.px(block.corner_lattice())).reshape(*shape, 2)
        self._subset_rest = view.plane(elements.subset_centre)
        self._inside = np.all(
            (elements.place >= 0) & (elements.place < [2 * block.rows, 2 * block.columns]), axis=1
        )

    def read(self, seen: Followed, back: FloatArray) -> CellStates:
        """The cells in one picture.

        Args:
            seen: what was followed. back: (2, 3) affine map that undoes the camera's motion.
        """
        now = self._view.plane(seen.subset_px) @ back[:, :2].T + back[:, 2]
        scale = _local_scale(self._view, self._elements.subset_centre)
        sd = seen.subset_sd.max(axis=1) * scale * self._elements.overlap
        corner, corner_sd, status = self._corners(now, sd, seen, self._subset_rest, self.rest)
        if self._cut:
            return cells_of_corners(self.rest, corner, corner_sd, status)
        return self._uncut(now, sd, seen, corner)

    def corner_px(self, seen: Followed) -> FloatArray:
        """(R + 1, C + 1, 2) the corners in the picture, for drawing."""
        px, _, _ = self._corners(
            seen.subset_px,
            np.ones(len(seen.subset_px)),
            seen,
            self._elements.subset_centre,
            self._block.px(self._block.corner_lattice()).reshape(self.rest.shape),
        )
        return px

    def _uncut(
        self, now: FloatArray, sd: FloatArray, seen: Followed, corner: FloatArray
    ) -> CellStates:
        rows, columns = self._block.rows, self._block.columns
        count = rows * columns
        along, across = np.full(count, np.nan), np.full(count, np.nan)
        spread, words = np.full((count, 2), np.nan), np.full(count, "lost", dtype="<U16")
        e = self._elements
        known = np.isfinite(now).all(axis=1)
        for index, (r, c) in enumerate(np.ndindex(rows, columns)):
            elements = np.flatnonzero(np.all(e.place // 2 == [r, c], axis=1))
            words[index] = worst(seen.status[elements])
            mine = np.flatnonzero(np.isin(e.subset_of, elements) & known)
            if words[index] not in ("ok", "updated"):
                continue
            if len(mine) < 0.7 * len(elements) * SUBSETS**2:
                words[index] = "lost"
                continue
            rest = self._subset_rest[mine]
            gradient, _, residual = affine(rest, now[mine])
            kept = _kept(residual)
            gradient, _, _ = affine(rest[kept], now[mine][kept])
            one, two = _directions(self.rest[r : r + 2, c : c + 2])
            along[index] = np.linalg.norm(gradient @ one)
            across[index] = np.linalg.norm(gradient @ two)
            centred = rest[kept] - rest[kept].mean(axis=0)
            inverse = np.linalg.inv(centred.T @ centred)
            noise = float(np.sqrt(np.mean(sd[mine][kept] ** 2)))
            spread[index] = [noise * np.sqrt(d @ inverse @ d) for d in (one, two)]
        inner = known & self._inside[e.subset_of]
        block = affine_stretches(self._subset_rest[inner], now[inner], self.rest)
        return CellStates(along, across, spread, words, corner, block)

    def _corners(
        self,
        now: FloatArray,
        sd: FloatArray,
        seen: Followed,
        points: FloatArray,
        corners: FloatArray,
    ) -> tuple[FloatArray, FloatArray, StringArray]:
        """Corners as the mean of what the elements around them say.

        An element's affine map says where its corner is. At the middle of a cut the elements of
        both faces count alike, as in ``fem.gauge.site_positions``; what the maps leave out near
        the hinges is opposite on the two faces.
        """
        e = self._elements
        shape = self.rest.shape[:2]
        total, variance = np.zeros((*shape, 2)), np.zeros(shape)
        count = np.zeros(shape, dtype=np.int64)
        status = np.full(shape, "ok", dtype="<U16")
        known = np.asarray(np.isfinite(now).all(axis=1))
        per = SUBSETS * SUBSETS
        for element in range(len(e)):
            i, j = (int(value) for value in e.place[element])
            corner = ((i + 1) // 2, (j + 1) // 2)
            if not (0 <= corner[0] < shape[0] and 0 <= corner[1] < shape[1]):
                continue
            mine = np.arange(element * per, (element + 1) * per)
            mine = mine[known[mine]]
            word = str(seen.status[element])
            if word in ("ok", "updated") and len(mine) < _LEAST:
                word = "lost"
            status[corner] = worst(np.array([status[corner], word]))
            if word not in ("ok", "updated"):
                continue
            rest = points[mine]
            _, _, residual = affine(rest, now[mine])
            mine = mine[_kept(residual)]
            rest = points[mine]
            gradient, shift, _ = affine(rest, now[mine])
            away = corners[corner] - rest.mean(axis=0)
            total[corner] += shift + gradient @ away
            centred = rest - rest.mean(axis=0)
            lever = away @ np.linalg.inv(centred.T @ centred) @ away + 1 / len(rest)
            variance[corner] += lever * float(np.mean(sd[mine] ** 2))
            count[corner] += 1
        known_corner = np.isin(status, ("ok", "updated")) & (count > 0)
        safe = np.maximum(count, 1)
        place = np.where(known_corner[..., None], total / safe[..., None], np.nan)
        return place, np.where(known_corner, np.sqrt(variance) / safe, np.nan), status


def _kept(residual: FloatArray) -> npt.NDArray[np.bool_]:
    """Points whose residual is not far above the usual one."""
    away = np.linalg.norm(residual, axis=1)
    keep = away <= _STRAY * max(float(np.median(away)), 1e-12)
    return keep if keep.sum() >= _LEAST else np.ones(len(away), dtype=bool)


def _local_scale(view: PlaneView, px: FloatArray) -> FloatArray:
    """(n,) plane units a pixel at px (n, 2)."""
    one = view.plane(px + np.array([0.5, 0.0])) - view.plane(px - np.array([0.5, 0.0]))
    two = view.plane(px + np.array([0.0, 0.5])) - view.plane(px - np.array([0.0, 0.5]))
    return np.sqrt(np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]))


def local_scale(view: PlaneView, px: FloatArray) -> FloatArray:
    """(n,) plane units a pixel at px (n, 2); NaN where px is."""
    out = np.full(len(px), np.nan)
    known = np.isfinite(px).all(axis=1)
    out[known] = _local_scale(view, px[known])
    return out
