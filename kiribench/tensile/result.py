"""What a tensile test gives: stretches of followed cells, frame by frame, and their curves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault
from kiribench.strain.measures import strain_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
StringArray = NDArray[np.str_]

MEASURED = ("ok", "updated")
"""States of a cell that carry numbers; every other state has NaN and is the reason."""

STATES = {
    "ok": "followed against the first frame",
    "updated": "followed over a later reference frame: its error adds up from there",
    "lost": "no longer found",
    "outside": "left the picture",
    "hidden": "the marker is not to be seen, or not alone",
    "doubtful": "found, but contradicted by its neighbours or by the way back",
}


@dataclass(frozen=True, eq=False)
class TensileTest:
    """A stretched sample as seen by a camera; n frames, k cells.

    Attributes:
        frame: (n,) names of the frames, the first is the reference.
        time_s, displacement_mm, force_n: (n,) of the frames; NaN where there is no load data.
        cell: (k,) names, such as ``r0c2``.
        row, col: (k,) place in the block of followed cells; rows along the pull.
        longitudinal_stretch, lateral_stretch: (n, k) along and across the pull, deformed over
            reference; NaN where the cell was not measured in that frame.
        status: (n, k) one of :data:`STATES`.
        stretch_sd: (n, k, 2) standard deviation of the two stretches by the noise of the
            pictures; NaN as above.
        block_stretch: (n, 2) along and across, of one affine map fitted to everything that was
            followed; the reference is the whole block, not a cell.
        corner_px: (n, R + 1, C + 1, 2) where the corners of the cells are in the pictures; NaN
            where not known.
        strain_sd: the noise floor: median standard deviation of a cell's strain.
        scale_mm_per_px: at the middle of the block in the first frame, or None.
        marker: ``speckle``, ``dots``, ``grid`` or ``slits``.
        notes: what was corrected, and by how much. warnings: what to doubt.
        record: settings and sizes of the corrections, for the JSON.
        files: every file that was read.
    """

    frame: tuple[str, ...]
    time_s: FloatArray
    displacement_mm: FloatArray
    force_n: FloatArray
    cell: tuple[str, ...]
    row: IntArray
    col: IntArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    status: StringArray
    stretch_sd: FloatArray
    block_stretch: FloatArray
    corner_px: FloatArray
    strain_sd: float
    scale_mm_per_px: float | None
    marker: str
    notes: tuple[str, ...]
    warnings: tuple[Fault, ...]
    record: dict[str, Any]
    files: tuple[Path, ...] = ()

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n, k) where a cell was measured."""
        return np.isfinite(self.longitudinal_stretch) & np.isfinite(self.lateral_stretch)

    def strain(self, measure: str = "log") -> FloatArray:
        """(n, k) longitudinal strain of the cells, a fraction in the named measure."""
        return strain_of(self.longitudinal_stretch, measure)

    def lateral_strain(self, measure: str = "log") -> FloatArray:
        """(n, k) lateral strain of the cells, a fraction in the named measure."""
        return strain_of(self.lateral_stretch, measure)

    def poisson(self, measure: str = "log", min_strain: float = 0.01) -> FloatArray:
        """(n, k) Poisson's ratio of the cells; NaN where |longitudinal strain| < min_strain."""
        along, across = self.strain(measure), self.lateral_strain(measure)
        ratio = np.full(along.shape, np.nan)
        size = np.abs(np.nan_to_num(along))
        usable = self.measured & (size >= min_strain) & (size > 0)
        ratio[usable] = -across[usable] / along[usable]
        return ratio

    def curve(self, measure: str = "log", min_strain: float = 0.01) -> Curve:
        """Mean and standard deviation over the measured cells of every frame."""
        along = over_cells(self.strain(measure))
        across = over_cells(self.lateral_strain(measure))
        ratio = over_cells(self.poisson(measure, min_strain))
        return Curve(
            measure,
            along[:, 0],
            along[:, 1],
            across[:, 0],
            across[:, 1],
            ratio[:, 0],
            ratio[:, 1],
            self.measured.sum(axis=1).astype(np.int64),
        )


@dataclass(frozen=True, eq=False)
class Curve:
    """Means and standard deviations over cells, (n,) each; sd is NaN for fewer than two cells.

    Attributes:
        measure: of every strain and ratio here.
        longitudinal_strain, longitudinal_sd: fraction.
        lateral_strain, lateral_sd: fraction.
        poisson_ratio, poisson_sd: of the cells' own ratios; NaN below the smallest strain.
        cells: number of measured cells.
    """

    measure: str
    longitudinal_strain: FloatArray
    longitudinal_sd: FloatArray
    lateral_strain: FloatArray
    lateral_sd: FloatArray
    poisson_ratio: FloatArray
    poisson_sd: FloatArray
    cells: IntArray


def over_cells(values: FloatArray) -> FloatArray:
    """(n, 2) mean and standard deviation (n - 1) of the numbers in each row of (n, k)."""
    found = np.full((len(values), 2), np.nan)
    for index, row in enumerate(values):
        known = row[np.isfinite(row)]
        if len(known):
            found[index, 0] = known.mean()
        if len(known) > 1:
            found[index, 1] = known.std(ddof=1)
    return found
