"""Overlaps of a patch at hundreds of places, by a polynomial chart for every skin cell.

The exact route draws geodesics on the scan for every patch it scores: half a second. Here the
flat coordinates of the skin about each cell are sampled once, by the same log map, and fitted by
a bicubic polynomial in skin coordinates; a patch cell is then the straight-sided quad of its
corners' images. That leaves out the bow of the geodesic sides and what the polynomial misses;
:func:`kiribench.reference.fast_overlap.FastOverlap` is tested against the exact route, and is
used for search, Monte Carlo and the estimate that a design prints, never for a score.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.outlines import flat_outlines
from kiribench.conformability.overlap import Overlaps
from kiribench.conformability.result import GradeBy
from kiribench.design.skin import Skin
from kiribench.surface.locate import locate

FloatArray = NDArray[np.float64]

#: A chart covers its cell and so much of the neighbours, in cells, on every side.
REACH = 0.6
#: Samples of a chart along each axis, for the four coefficients of a cubic.
SAMPLES = 7
DEGREE = 3


@dataclass(frozen=True, eq=False)
class FastOverlap:
    """Charts of the skin cells under a patch.

    Attributes:
        centre_q_mm: (R, C, 2) skin coordinates of the cells' centres. pitch_mm: of the grid.
        coefficients: (R, C, 16, 2) of the flat coordinates; NaN where a cell has no chart.
        skin: (R, C, 4, 2) flat corners of the skin cells, mm.
        fit_rms_mm: (R, C) what the polynomials leave of their samples.
    """

    centre_q_mm: FloatArray
    pitch_mm: float
    coefficients: FloatArray
    skin: FloatArray
    fit_rms_mm: FloatArray

    @classmethod
    def of(cls, skin: Skin) -> FastOverlap:
        """Sample and fit the charts of all cells whose four skin nodes were seen."""
        bare = skin.bare
        charts = flat_outlines(bare.mesh, skin.under, skin.under, bare.topology).charts
        if charts is None:
            raise ValueError("outlines on a scan always have charts")
        pitch, target = skin.pitch_mm, skin.target_q_mm
        centre = 0.25 * (target[:-1, :-1] + target[1:, 1:] + target[:-1, 1:] + target[1:, :-1])
        ticks = np.linspace(-0.5 - REACH, 0.5 + REACH, SAMPLES)
        local = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        cells = centre[charts.cells]
        q = (cells[:, None] + pitch * local).reshape(-1, 2)
        found = locate(bare.mesh, skin.places(q))
        owner = np.repeat(np.arange(len(cells), dtype=np.int32), len(local))
        flat = charts.flat(bare.mesh, owner, found.points, bare.topology)
        values = flat.reshape(len(cells), len(local), 2)
        # Beyond the scan's border everything is located on the border: out.
        inside = (found.distance_mm < pitch / 5).reshape(values.shape[:2])
        inside &= np.isfinite(values).all(axis=-1)
        basis = _monomials(local)
        coefficients = np.full((*charts.cells.shape, basis.shape[1], 2), np.nan)
        rms = np.full(charts.cells.shape, np.nan)
        for k, (row, column) in enumerate(np.argwhere(charts.cells)):
            kept = inside[k]
            if kept.sum() < 2 * basis.shape[1]:
                continue
            fit = np.linalg.lstsq(basis[kept], values[k, kept], rcond=None)[0]
            coefficients[row, column] = fit
            left = values[k, kept] - basis[kept] @ fit
            rms[row, column] = np.sqrt((left**2).sum(axis=1).mean())
        blank = cls(centre, pitch, coefficients, np.empty(0), rms)
        # The skin cell by the same polynomial: what it misses at a corner, it misses twice.
        return replace(blank, skin=blank.flat_corners(target))

    def flat_corners(self, corner_q_mm: FloatArray) -> FloatArray:
        """(..., R, C, 4, 2) flat corners of patch cells with corners (..., R+1, C+1, 2)."""
        q = corner_q_mm
        corners = np.stack(
            [q[..., :-1, :-1, :], q[..., :-1, 1:, :], q[..., 1:, 1:, :], q[..., 1:, :-1, :]],
            axis=-2,
        )
        local = (corners - self.centre_q_mm[..., None, :]) / self.pitch_mm
        return np.asarray(
            np.einsum("...rckm,rcmx->...rckx", _monomials(local), self.coefficients, optimize=True)
        )

    def areas(self, corner_q_mm: FloatArray) -> Overlaps:
        """Areas of skin cells, patch cells and intersections, each (..., R, C), mm^2."""
        patch = self.flat_corners(corner_q_mm)
        skin = np.broadcast_to(self.skin, patch.shape)
        found = quad_areas(
            np.ascontiguousarray(skin.reshape(-1, 4, 2)),
            np.ascontiguousarray(patch.reshape(-1, 4, 2)),
        ).reshape(*patch.shape[:-2], 3)
        return Overlaps(found[..., 0], found[..., 1], found[..., 2])

    def overlap(self, corner_q_mm: FloatArray, definition: GradeBy = "paper") -> FloatArray:
        """(..., R, C) overlap by a definition; NaN where there is no chart."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.areas(corner_q_mm).by(definition)


def _monomials(local: FloatArray) -> FloatArray:
    """(..., 16) products of powers 0 to 3 of the two local coordinates (..., 2)."""
    powers = np.arange(DEGREE + 1)
    u = local[..., :1] ** powers
    v = local[..., 1:] ** powers
    return np.asarray((u[..., :, None] * v[..., None, :]).reshape(*local.shape[:-1], -1))
