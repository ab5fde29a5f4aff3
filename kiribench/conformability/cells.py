"""Score the cells of a patch that lies on the skin in one frame with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.causes import costs, fit_affine, main_cause
from kiribench.conformability.outlines import PIECES, FlatOutlines
from kiribench.conformability.overlap import Overlaps, overlaps, simple
from kiribench.conformability.result import CAUSES, Alignment, Causes, GradeBy

FloatArray = NDArray[np.float64]
TextArray = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class CellScores:
    """Overlaps and causes of every cell; NaN where there is no score.

    Attributes:
        overlap: (R, C) areas on the skin, after the alignment.
        causes: the split of the mismatch.
        offset_mm: (R, C) distance of the cell centres before the alignment.
        reason: (R, C) why a cell has no score.
        skin, patch: (R, C, n, 2) outlines, the patch after the alignment.
    """

    overlap: Overlaps
    causes: Causes
    offset_mm: FloatArray
    reason: TextArray
    skin: FloatArray
    patch: FloatArray


def score_cells(
    outlines: FlatOutlines, reason: TextArray, definition: GradeBy, alignment: Alignment
) -> CellScores:
    """Intersect every pair of cells and take its mismatch apart.

    Args:
        outlines: flattened pairs.
        reason: (R, C) why cells are already out (missing nodes), else ``""``.
        definition: of the overlap whose cost is split.
        alignment: ``global`` leaves the patch where it lies; ``per-cell`` first moves each
            patch cell's centre onto its skin cell's, so that a shift costs nothing.
    """
    reason = reason.copy()
    reason[(reason == "") & outlines.around_hole] = "path-around-hole"
    fine = reason == ""
    degenerate = fine & (outlines.turned | ~simple(outlines.skin) | ~simple(outlines.patch))
    reason[degenerate] = "cell-degenerate"
    fine &= ~degenerate
    skin_corners, patch_corners = outlines.skin_corners, outlines.patch_corners
    shift = patch_corners.mean(axis=2) - skin_corners.mean(axis=2)
    moved = outlines.patch.copy()
    if alignment == "per-cell":
        moved = moved - shift[:, :, None, :]
    moved[~fine] = np.nan
    skin = np.where(fine[..., None, None], outlines.skin, np.nan)

    def full(values: FloatArray) -> FloatArray:
        out = np.full((*fine.shape, *values.shape[1:]), np.nan)
        out[fine] = values
        return out

    areas = overlaps(skin[fine], moved[fine])
    found = Overlaps(full(areas.skin), full(areas.patch), full(areas.both))
    shift[~fine] = np.nan
    return CellScores(
        overlap=found,
        causes=_causes(skin, moved, shift, fine, definition),
        offset_mm=np.asarray(np.linalg.norm(shift, axis=-1)),
        reason=reason,
        skin=skin,
        patch=moved,
    )


def _causes(
    skin: FloatArray,
    patch: FloatArray,
    shift: FloatArray,
    fine: NDArray[np.bool_],
    definition: GradeBy,
) -> Causes:
    parts = np.full((*fine.shape, 5), np.nan)
    cost = np.full((*fine.shape, len(CAUSES)), np.nan)
    main = np.full(fine.shape, "", dtype="<U24")
    for r, c in zip(*np.nonzero(fine), strict=True):
        fit = fit_affine(skin[r, c, ::PIECES], patch[r, c, ::PIECES])
        parts[r, c] = (
            np.rad2deg(fit.rotation),
            fit.longitudinal,
            fit.lateral,
            fit.shear,
            fit.rest_mm,
        )
        cost[r, c] = costs(fit, skin[r, c], patch[r, c], definition)
        main[r, c] = main_cause(cost[r, c])
    return Causes(
        shift_mm=shift,
        rotation_deg=parts[..., 0],
        longitudinal_stretch=parts[..., 1],
        lateral_stretch=parts[..., 2],
        shear=parts[..., 3],
        rest_mm=parts[..., 4],
        cost=cost,
        main=main,
    )
