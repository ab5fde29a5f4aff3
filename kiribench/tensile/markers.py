"""Single markers followed from picture to picture: dots, open slits, crossings of lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError
from kiribench.tensile.blobs import Blobs, find_blobs, find_crossings
from kiribench.tensile.elements import Block
from kiribench.tensile.icgn import FOUND, make_templates, match
from kiribench.tensile.pairing import ENOUGH, pair_by_map, pair_nearest

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
StringArray = npt.NDArray[np.str_]

SNAP = 0.3
"""Of the distance between markers: how far a marker may be from where it was declared."""
OUTLIER = 0.2
"""Of the distance: farther from the affine map of its neighbours is doubtful."""
_ZNCC = 0.7


@dataclass(frozen=True, eq=False)
class MarkersSeen:
    """The corners of the cells in one picture; k corners.

    Attributes:
        px: (k, 2), NaN where not found. sd_px: (k,). status: (k,) as in ``result.STATES``.
    """

    px: FloatArray
    sd_px: FloatArray
    status: StringArray


class MarkerFollower:
    """Follows the markers at the cells' corners, and all others as their neighbours."""

    def __init__(
        self,
        first: Float32Array,
        block: Block,
        kind: str,
        *,
        bright: bool,
        pull: FloatArray,
        file: str,
    ) -> None:
        self._block, self._kind, self._bright, self._pull = block, kind, bright, pull
        corners = block.px(block.corner_lattice())
        grid = corners.reshape(block.rows + 1, block.columns + 1, 2)
        self.pitch_px = float(
            min(
                np.linalg.norm(np.diff(grid, axis=0), axis=2).min(),
                np.linalg.norm(np.diff(grid, axis=1), axis=2).min(),
            )
        )
        # Open slits stand at every half cell.
        self.spacing_px = self.pitch_px * (0.5 if kind == "slits" else 1.0)
        found = self._find(first)
        pairing = pair_nearest(corners, found.px, self.spacing_px * SNAP / 0.3)
        missing = pairing.to < 0
        if missing.mean() > 0.25:
            raise DatasetError(
                "tensile-markers",
                f"{int(missing.sum())} of {len(corners)} corners have no marker in the first "
                "frame.",
                remedy="Check corners_px, rows, columns, marker and bright in tensile.json; closed "
                "slits must be seen as dark lines.",
                file=file,
                got=f"{len(found)} markers in the picture",
            )
        self.first_status = np.where(missing, "hidden", "ok").astype("<U16")
        others = np.setdiff1d(np.arange(len(found)), pairing.to[~missing])
        self._corner_count = len(corners)
        self._here = np.concatenate(
            [np.where(missing[:, None], np.nan, found.px[pairing.to]), found.px[others]]
        )
        self._area = np.concatenate([found.area_px[pairing.to], found.area_px[others]])
        self._roundness = float(np.median(found.roundness[pairing.to[~missing]]))
        self._before = self._here.copy()
        self._rest = self._here.copy()
        self.first_px = self._here[: len(corners)].copy()
        self.first_sd = np.where(missing, np.nan, found.sd_px[pairing.to])
        self.large_steps = 0
        self.shifted_steps = 0
        if kind == "grid":
            self._start_templates(first, corners)

    @property
    def by_templates(self) -> bool:
        """Whether the markers are matched to their looks in the first picture."""
        return self._kind == "grid"

    def marks(self) -> tuple[FloatArray, FloatArray]:
        """Places in cells (across, along) and px of the markers of the first picture."""
        good = np.isfinite(self.first_px).all(axis=1)
        return self._block.corner_lattice()[good][:, ::-1], self.first_px[good]

    def step(self, picture: Float32Array) -> MarkersSeen:
        """Find the markers in the next picture."""
        found = self._find(picture)
        guess = 2 * self._here - self._before
        pairing = pair_nearest(guess, found.px, self.spacing_px)
        still = pair_nearest(self._here, found.px, self.spacing_px)
        if still.score > pairing.score:
            pairing = still
        if pairing.score < ENOUGH:
            large = pair_by_map(self._here, found.px, self.spacing_px, self._pull)
            if large.score > pairing.score + 0.02 or (large.ambiguous and pairing.score < 0.7):
                pairing = large
                self.large_steps += 1
                self.shifted_steps += int(large.shifted)
        k = self._corner_count
        px = np.full(self._here.shape, np.nan)
        paired = pairing.to >= 0
        if pairing.ambiguous:
            paired[:] = False
        px[paired] = found.px[pairing.to[paired]]
        status = np.where(paired, "ok", "lost").astype("<U16")
        if pairing.ambiguous:
            status[:] = "doubtful"
        strange = self._outliers(px)
        status[strange], px[strange] = "doubtful", np.nan
        sd = np.where(paired & ~strange, found.sd_px[pairing.to] if len(found) else np.nan, np.nan)
        self._before = np.where(np.isfinite(px), self._here, self._before)
        self._here = np.where(np.isfinite(px), px, self._filled(px))
        out = px[:k].copy()
        if self._kind == "grid":
            out, sd_k, status_k = self._refine(picture, px, status[:k])
            self._here[:k] = np.where(np.isfinite(out), out, self._here[:k])
            return MarkersSeen(out, sd_k, status_k)
        return MarkersSeen(out, sd[:k], status[:k])

    def _find(self, picture: Float32Array) -> Blobs:
        rows, columns = picture.shape
        box = (0, 0, columns - 1, rows - 1)
        if self._kind == "grid":
            return find_crossings(picture, self.pitch_px, bright=self._bright, box=box)
        blobs = find_blobs(picture, self.pitch_px, bright=self._bright, box=box)
        if self._kind == "dots" and hasattr(self, "_area"):
            # Holes and slits are no dots: too large, or far from round.
            usual = float(np.median(self._area))
            keep = (blobs.area_px > 0.3 * usual) & (blobs.area_px < 2.5 * usual)
            keep &= blobs.roundness > 0.5 * self._roundness
        elif self._kind == "dots":
            keep = blobs.roundness > 0.6
        else:
            keep = np.ones(len(blobs), dtype=bool)
        return Blobs(blobs.px[keep], blobs.area_px[keep], blobs.sd_px[keep], blobs.roundness[keep])

    def _outliers(self, px: FloatArray) -> npt.NDArray[np.bool_]:
        """Markers that contradict the affine map of their eight nearest neighbours at rest."""
        from scipy.spatial import cKDTree

        strange = np.zeros(len(px), dtype=bool)
        known = np.flatnonzero(np.isfinite(px).all(axis=1) & np.isfinite(self._rest).all(axis=1))
        if len(known) < 8:
            return strange
        count = min(9, len(known))
        _, near = cKDTree(self._rest[known]).query(self._rest[known], k=count)
        for index, row in enumerate(np.asarray(near)):
            me, others = known[index], known[row[1:]]
            design = np.column_stack([np.ones(len(others)), self._rest[others] - self._rest[me]])
            fit, *_ = np.linalg.lstsq(design, px[others], rcond=None)
            strange[me] = np.linalg.norm(px[me] - fit[0]) > OUTLIER * self.spacing_px
        return strange

    def _filled(self, px: FloatArray) -> FloatArray:
        """Where lost markers should be, by an affine map of all others: to find them again."""
        known = np.isfinite(px).all(axis=1) & np.isfinite(self._here).all(axis=1)
        if known.sum() < 6:
            return self._here
        design = np.column_stack([np.ones(len(px)), self._here])
        fit, *_ = np.linalg.lstsq(design[known], px[known], rcond=None)
        return np.asarray(design @ fit)

    def _start_templates(self, first: Float32Array, corners: FloatArray) -> None:
        half = 0.22 * self.pitch_px
        steps = np.linspace(-half, half, min(41, max(9, int(2 * half + 1))))
        xi = np.asarray(np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2), dtype=np.float64)
        middle = np.where(np.isfinite(self.first_px), self.first_px, corners)
        self._centre: FloatArray = np.asarray(np.round(middle), dtype=np.float64)
        zero = np.zeros((len(corners), 6))
        every: FloatArray = np.tile(xi, (len(corners), 1, 1))
        self._templates = make_templates(first, self._centre, every, zero)
        self._warp = zero
        self.first_px = self._centre.copy()

    def _refine(
        self, picture: Float32Array, px: FloatArray, status: StringArray
    ) -> tuple[FloatArray, FloatArray, StringArray]:
        """Crossings to a part of a pixel, by their looks in the first picture."""
        k = self._corner_count
        status = status.copy()
        use = np.flatnonzero(np.isfinite(px[:k]).all(axis=1) & self._templates.good)
        out, sd = np.full((k, 2), np.nan), np.full(k, np.nan)
        known = np.flatnonzero(np.isfinite(px).all(axis=1) & np.isfinite(self._rest).all(axis=1))
        if len(use) and len(known) >= 6:
            design = np.column_stack([np.ones(len(known)), self._rest[known]])
            fit, *_ = np.linalg.lstsq(design, px[known], rcond=None)
            turn = fit[1:].T - np.eye(2)
            start = np.zeros((len(use), 6))
            start[:, :2] = px[use] - self._centre[use]
            start[:, 2:] = turn.ravel()
            matches = match(picture, self._templates.some(use), start, reach_px=0.3 * self.pitch_px)
            good = (matches.code == FOUND) & (matches.zncc >= _ZNCC)
            out[use[good]] = self._centre[use[good]] + matches.warp[good, :2]
            sd[use[good]] = matches.sd_px[good].max(axis=1)
            status[use[~good]] = "lost"
        return out, sd, status
