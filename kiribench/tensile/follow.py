"""Elements followed from picture to picture, each against its looks in the first one.

Each picture is matched to the first, so errors do not add up. Where the looks have changed too
much, the last picture in which the element was found becomes its reference; the warp still
counts from the first picture, and the element says so ("updated") until it is found against the
first picture again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.tensile.elements import Elements
from kiribench.tensile.icgn import (
    DIVERGED,
    FOUND,
    OUTSIDE,
    Matches,
    Templates,
    make_templates,
    match,
)
from kiribench.tensile.relocate import Keypoints

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
StringArray = npt.NDArray[np.str_]

_COARSEST = 20.0
"""Edge of an element in the smallest picture, px."""
_ANY_STEP = 2.0
"""Step, px, up to which a subset may want to move off the place that its element gives it."""
_RETURN_PX = 0.5
"""A relocated element that is matched back must come home within this."""


@dataclass(frozen=True)
class FollowOptions:
    """Limits of following.

    Attributes:
        element_zncc: least correlation of an element. subset_zncc: of a subset.
    """

    element_zncc: float = 0.75
    subset_zncc: float = 0.75


@dataclass(frozen=True, eq=False)
class Followed:
    """One picture; m elements, n subsets.

    Attributes:
        warp: (m, 6) of the elements, NaN where not found. zncc: (m,).
        status: (m,) ``ok``, ``updated``, ``lost``, ``outside`` or ``doubtful``.
        subset_px: (n, 2) where the subsets' middles are, NaN where not found.
        subset_warp: (n, 6). subset_sd: (n, 2) px.
    """

    warp: FloatArray
    zncc: FloatArray
    status: StringArray
    subset_px: FloatArray
    subset_warp: FloatArray
    subset_sd: FloatArray


class Follower:
    """Follows elements through pictures that are given one after the other."""

    def __init__(
        self,
        first: Float32Array,
        elements: Elements,
        pull: FloatArray,
        *,
        cut: bool,
        options: FollowOptions | None = None,
    ) -> None:
        self.elements = elements
        self._options = options or FollowOptions()
        self._cut = cut
        zero = np.zeros((len(elements), 6))
        self._levels = _levels(float(elements.edge_px.min()))
        self._first = _pyramid(first, self._levels)
        self._templates = [
            make_templates(picture, elements.centre / 2**level, _coarser(elements.xi, level), zero)
            for level, picture in enumerate(self._first)
        ]
        self._subsets = make_templates(
            first,
            elements.subset_centre,
            elements.subset_xi,
            np.zeros((len(elements.subset_centre), 6)),
        )
        self._keypoints = Keypoints(first, elements, pull)
        self._last: Float32Array = first
        self._warp = zero
        self._before = zero
        self._seen = np.zeros(len(elements), dtype=np.int64)
        self._frame = 0
        self.relocated = 0

    @property
    def usable(self) -> BoolArray:
        """(m,) elements that show something in the first picture."""
        return self._templates[0].good

    def step(self, picture: Float32Array) -> Followed:
        """Find everything in the next picture."""
        self._frame += 1
        m = len(self.elements)
        found = _Found.none(m)
        usable = self._templates[0].good
        recent = usable & (self._seen == self._frame - 1)
        pyramid: list[Float32Array] = [picture]
        guess = 2 * self._warp - self._before
        self._try(pyramid, found, np.flatnonzero(recent), guess[recent], 0)
        if self._share(found, usable) < 0.999:
            self._flow(pyramid, found, recent)
            if self._frame > 1:
                self._try_rest(pyramid, found, recent, self._warp, 0)
        if self._share(found, usable) < 0.999:
            pyramid = _pyramid(picture, self._levels)
            if self._levels > 1:
                for start in (guess, self._warp):
                    self._try_rest(pyramid, found, recent, start, self._levels - 1)
            self._spread(pyramid, found, usable)
        rest = np.flatnonzero(usable & ~found.good)
        if len(rest) > 0.02 * m:
            where, warps = self._keypoints.relocate(picture, rest)
            self.relocated += len(where)
            self._try(pyramid, found, where, warps, 1, check=True)
            self._spread(pyramid, found, usable)
        self._update(picture, found, usable & recent & ~found.good)
        followed = self._finish(picture, found, usable)
        self._before = np.where(found.good[:, None], self._warp, self._before)
        self._warp = np.where(found.good[:, None], found.warp, self._warp)
        known = found.good & (self._seen < self._frame - 1)
        self._before[known] = found.warp[known]
        self._seen[found.good] = self._frame
        self._last = picture
        return followed

    def _share(self, found: _Found, usable: BoolArray) -> float:
        return float(found.good[usable].mean()) if usable.any() else 1.0

    def _try_rest(
        self,
        pyramid: list[Float32Array],
        found: _Found,
        among: BoolArray,
        start: FloatArray,
        level: int,
    ) -> None:
        rest = np.flatnonzero(among & ~found.good)
        self._try(pyramid, found, rest, start[rest], level)

    def _flow(self, pyramid: list[Float32Array], found: _Found, among: BoolArray) -> None:
        """Starts from pyramidal Lucas-Kanade: shifts of many pixels without much turning."""
        import cv2

        rest = np.flatnonzero(among & ~found.good)
        if not len(rest):
            return
        here = (self.elements.centre[rest] + self._warp[rest, :2]).astype(np.float32)
        there, state, _ = cv2.calcOpticalFlowPyrLK(
            cv2.convertScaleAbs(self._last),
            cv2.convertScaleAbs(pyramid[0]),
            here.reshape(-1, 1, 2),
            here.reshape(-1, 1, 2).copy(),
            winSize=(31, 31),
            maxLevel=5,
        )
        kept = state.ravel() == 1
        start = self._warp[rest[kept]].copy()
        start[:, :2] += (there.reshape(-1, 2) - here)[kept]
        self._try(pyramid, found, rest[kept], start, 0, check=True)

    def _try(
        self,
        pyramid: list[Float32Array],
        found: _Found,
        which: IntArray,
        start: FloatArray,
        level: int,
        *,
        check: bool = False,
    ) -> None:
        """Match elements from a coarse level to the finest; keep those with good correlation."""
        if not len(which):
            return
        warp = start.copy()
        for at in range(min(level, len(pyramid) - 1), -1, -1):
            warp[:, :2] /= 2**at
            reach = float(self.elements.edge_px.min()) / 2**at
            matches = match(
                pyramid[at], self._templates[at].some(which), warp, reach_px=0.4 * reach
            )
            better = (matches.code == FOUND) & (matches.zncc > 0.4)
            warp = np.where(better[:, None], matches.warp, warp)
            warp[:, :2] *= 2**at
        good = (matches.code == FOUND) & (matches.zncc >= self._options.element_zncc)
        good &= _sound(matches.warp)
        if check:
            good[good] = self._comes_home(pyramid[0], which[good], matches.warp[good])
        found.take(which, matches, good)

    def _comes_home(self, picture: Float32Array, which: IntArray, warp: FloatArray) -> BoolArray:
        """Whether elements, read where they were found, match the first picture at home."""
        there = make_templates(picture, self.elements.centre[which], self.elements.xi[which], warp)
        back = match(self._first[0], there, np.zeros_like(warp))
        away = np.linalg.norm(back.warp[:, :2], axis=1)
        return np.asarray((back.code == FOUND) & (away < _RETURN_PX))

    def _spread(self, pyramid: list[Float32Array], found: _Found, usable: BoolArray) -> None:
        """From found elements to their neighbours, as far as it goes."""
        tried = np.zeros(len(usable), dtype=np.int64)
        for _ in range(60):
            rest = np.flatnonzero(usable & ~found.good)
            ready, starts = [], []
            for element in rest.tolist():
                away = np.abs(self.elements.place - self.elements.place[element]).max(axis=1)
                near = np.flatnonzero(found.good & (away <= 2))
                if len(near) < 3 or tried[element] == len(near):
                    continue
                tried[element] = len(near)
                ready.append(element)
                starts.append(self._guess(element, near, found.warp))
            if not ready:
                return
            before = int(found.good.sum())
            self._try(pyramid, found, np.array(ready), np.array(starts), 0, check=True)
            late = np.array([k for k, e in enumerate(ready) if not found.good[e]], dtype=np.int64)
            if len(late):
                which = np.array(ready)[late]
                self._try(
                    pyramid, found, which, np.array(starts)[late], self._levels - 1, check=True
                )
            if int(found.good.sum()) == before and not len(late):
                return

    def _guess(self, element: int, near: IntArray, warp: FloatArray) -> FloatArray:
        """A warp from neighbours: their places give the place, their own kind the turn."""
        place = self.elements.lattice[near] - self.elements.lattice[element]
        weight = np.exp(-np.sum(place * place, axis=1))[:, None]
        design = np.column_stack([np.ones(len(near)), place])
        moved, *_ = np.linalg.lstsq(weight * design, weight * warp[near, :2], rcond=1e-6)
        kind = np.zeros(len(near), dtype=bool)
        if self._cut:  # facets turn against their neighbours
            parity = self.elements.place.sum(axis=1) % 2
            kind = parity[near] == parity[element]
        use = kind if kind.any() else np.ones(len(near), dtype=bool)
        gradient = np.average(warp[near[use], 2:], axis=0, weights=weight[use, 0])
        return np.concatenate([moved[0], gradient])

    def _update(self, picture: Float32Array, found: _Found, which: BoolArray) -> None:
        """Elements that look no longer as at first: against the last picture they were in."""
        rest = np.flatnonzero(which)
        if not len(rest) or self._frame == 1:
            return
        looks = make_templates(
            self._last, self.elements.centre[rest], self.elements.xi[rest], self._warp[rest]
        )
        start = 2 * self._warp[rest] - self._before[rest]
        matches = match(picture, looks, start)
        good = (matches.code == FOUND) & (matches.zncc >= self._options.element_zncc)
        good &= _sound(matches.warp)
        found.take(rest, matches, good)
        found.updated[rest[good]] = True

    def _finish(self, picture: Float32Array, found: _Found, usable: BoolArray) -> Followed:
        """The subsets, started from their elements, and the words for all."""
        e = self.elements
        status = np.full(len(e), "lost", dtype="<U16")
        status[found.outside & ~found.good] = "outside"
        status[found.good] = "ok"
        status[found.good & found.updated] = "updated"
        status[~usable] = "hidden"
        n = len(e.subset_of)
        use = np.flatnonzero(found.good[e.subset_of])
        start = found.warp[e.subset_of[use]]
        offset = e.subset_centre[use] - e.centre[e.subset_of[use]]
        start[:, 0] += start[:, 2] * offset[:, 0] + start[:, 3] * offset[:, 1]
        start[:, 1] += start[:, 4] * offset[:, 0] + start[:, 5] * offset[:, 1]
        looks = self._subsets.some(use)
        changed = found.updated[e.subset_of[use]]
        if changed.any():
            old = self._warp[e.subset_of[use]][changed]
            shift = old.copy()
            shift[:, 0] += old[:, 2] * offset[changed, 0] + old[:, 3] * offset[changed, 1]
            shift[:, 1] += old[:, 4] * offset[changed, 0] + old[:, 5] * offset[changed, 1]
            again = make_templates(self._last, looks.centre[changed], looks.xi[changed], shift)
            looks = _replaced(looks, np.flatnonzero(changed), again)
        reach = 0.25 * float(e.edge_px.min())
        matches = match(picture, looks, start, reach_px=reach)
        good = (matches.code == FOUND) & (matches.zncc >= self._options.subset_zncc)
        good &= _sound(matches.warp)
        self._by_element(picture, looks, start, matches, good)
        px, warp, sd = np.full((n, 2), np.nan), np.full((n, 6), np.nan), np.full((n, 2), np.nan)
        warp[use[good]] = matches.warp[good]
        px[use[good]] = e.subset_centre[use[good]] + matches.warp[good, :2]
        sd[use[good]] = matches.sd_px[good]
        where = np.where(found.good[:, None], found.warp, np.nan)
        return Followed(where, found.zncc, status, px, warp, sd)

    def _by_element(
        self,
        picture: Float32Array,
        looks: Templates,
        start: FloatArray,
        matches: Matches,
        good: BoolArray,
    ) -> None:
        """Where noise keeps a subset from settling, its element says where it is.

        Six numbers from a few grains are more than noisy pictures tell; the element has five
        times the points. The subset has to correlate there by itself: what is covered stays lost.
        Changes ``matches`` and ``good``.
        """
        rest = np.flatnonzero(looks.good & (matches.code == DIVERGED))
        if not len(rest):
            return
        there = match(picture, looks.some(rest), start[rest], iterations=1, tolerance_px=_ANY_STEP)
        fine = (there.code == FOUND) & (there.zncc >= self._options.subset_zncc)
        kept = rest[fine]
        matches.warp[kept], matches.sd_px[kept] = start[kept], there.sd_px[fine]
        good[kept] = _sound(start[kept])


@dataclass(eq=False)
class _Found:
    """What has been found so far in one picture."""

    warp: FloatArray
    zncc: FloatArray
    good: BoolArray
    updated: BoolArray
    outside: BoolArray

    @classmethod
    def none(cls, count: int) -> _Found:
        no = np.zeros(count, dtype=bool)
        return cls(np.full((count, 6), np.nan), np.zeros(count), no, no.copy(), no.copy())

    def take(self, which: IntArray, matches: Matches, good: BoolArray) -> None:
        kept = which[good]
        self.warp[kept] = matches.warp[good]
        self.zncc[kept] = matches.zncc[good]
        self.good[kept] = True
        self.outside[which] |= matches.code == OUTSIDE


def _sound(warp: FloatArray) -> BoolArray:
    """Warps that no sheet contradicts: no mirror image, stretches within 0.3 and 4."""
    matrix = np.eye(2) + warp[:, 2:].reshape(-1, 2, 2)
    stretch = np.linalg.svd(matrix, compute_uv=False)
    return np.asarray((np.linalg.det(matrix) > 0) & (stretch[:, 1] > 0.3) & (stretch[:, 0] < 4.0))


def _replaced(looks: Templates, which: IntArray, by: Templates) -> Templates:
    value, slope, good = looks.value.copy(), looks.slope.copy(), looks.good.copy()
    value[which], slope[which], good[which] = by.value, by.slope, by.good
    return Templates(looks.centre, looks.xi, value, slope, good)


def _levels(edge_px: float) -> int:
    """How many pictures the pyramid has, the full one included."""
    return 1 + max(0, min(4, int(np.log2(max(edge_px, 1.0) / _COARSEST))))


def _pyramid(picture: Float32Array, levels: int) -> list[Float32Array]:
    import cv2

    pictures = [picture]
    for _ in range(levels - 1):
        pictures.append(np.asarray(cv2.pyrDown(pictures[-1]), dtype=np.float32))
    return pictures


def _coarser(xi: FloatArray, level: int) -> FloatArray:
    """The points of elements in a smaller picture, no denser than its pixels need."""
    if level == 0:
        return xi
    side = round(np.sqrt(xi.shape[1]))
    keep = np.unique(np.linspace(0, side - 1, max(14, side // 2)).round().astype(int))
    grid = xi.reshape(len(xi), side, side, 2)[:, keep][:, :, keep]
    return np.asarray(grid.reshape(len(xi), -1, 2) / 2**level)
