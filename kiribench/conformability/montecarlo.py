"""What the uncertainty of nodes and registration does to overlaps and grades.

Every grid node moves as one (neighbouring cells share it), isotropically with its
``sd_mm`` per direction; the patch moves rigidly as well where it was registered. A cell
is re-scored in its flat frame with straight sides; the difference that curved sides make
is taken from the nominal score.

Noise is not symmetric for an overlap: it can only hurt a perfect fit. The spread of
re-scored cells is therefore not an interval for the true overlap (for a perfect fit it
would contain the truth in 3 % of the cases). Two bias corrections of the bootstrap are
used together: reflection about the reading (``2 f - f*``, the basic bootstrap) and a
shift by twice the bias. The interval is the hull of both, and probabilities are means
over both (Efron & Tibshirani 1993, ch. 10 and 13, doi 10.1201/9780429246593). The tests
measure the coverage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.grades import ROUNDING
from kiribench.conformability.overlap import Overlaps
from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, Alignment, GradeBy

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FlatCells:
    """Straight-sided cells in their flat frames, ready to be moved.

    Attributes:
        skin, patch: (R, C, 4, 2) corners, mm; NaN where the cell is not scored.
        axes: (R, C, 2, 3) unit directions of the flat frame's axes in space.
    """

    skin: FloatArray
    patch: FloatArray
    axes: FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Interval and grade probabilities of every cell.

    Attributes:
        low, high: (R, C) 95 % interval.
        probability: (R, C, 3) of good, fair, poor.
        perfect_fit_reading: (R, C) mean reading of a perfect fit under the same noise.
        draws: (2 n, R, C) bias-corrected overlaps; NaN where not scored.
    """

    low: FloatArray
    high: FloatArray
    probability: FloatArray
    perfect_fit_reading: FloatArray
    draws: FloatArray


def cell_corners(nodes: FloatArray) -> FloatArray:
    """Values at nodes gathered at the corners of the cells.

    Args:
        nodes: (..., R+1, C+1, q).

    Returns:
        (..., R, C, 4, q) in the order (r, c), (r, c+1), (r+1, c+1), (r+1, c).
    """
    return np.stack(
        [
            nodes[..., :-1, :-1, :],
            nodes[..., :-1, 1:, :],
            nodes[..., 1:, 1:, :],
            nodes[..., 1:, :-1, :],
        ],
        axis=-2,
    )


def score_quads(
    skin: FloatArray, patch: FloatArray, definition: GradeBy, alignment: Alignment
) -> FloatArray:
    """Overlap of straight-sided cells.

    Args:
        skin, patch: (..., 4, 2) corners, mm.

    Returns:
        (...) overlap; NaN where a corner is not finite.
    """
    shape = np.broadcast_shapes(skin.shape, patch.shape)
    s = np.broadcast_to(skin, shape)
    k = np.broadcast_to(patch, shape)
    if alignment == "per-cell":
        k = k - k.mean(axis=-2, keepdims=True) + s.mean(axis=-2, keepdims=True)
    areas = quad_areas(
        np.ascontiguousarray(s.reshape(-1, 4, 2)), np.ascontiguousarray(k.reshape(-1, 4, 2))
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        overlap = Overlaps(areas[:, 0], areas[:, 1], areas[:, 2]).by(definition)
    return np.asarray(overlap.reshape(shape[:-2]))


def displacements(cells: FlatCells, node_shift: FloatArray) -> FloatArray:
    """Node displacements in the flat frames of the cells that they belong to.

    Args:
        cells: gives the axes.
        node_shift: (n, R+1, C+1, 3) displacements in space, mm.

    Returns:
        (n, R, C, 4, 2).
    """
    return np.asarray(
        np.einsum("rcax,nrckx->nrcka", cells.axes, cell_corners(node_shift), optimize=True)
    )


def vary(
    cells: FlatCells,
    nominal: FloatArray,
    sd_skin: FloatArray,
    sd_patch: FloatArray,
    rigid: FloatArray | None,
    *,
    definition: GradeBy,
    alignment: Alignment,
    samples: int,
    rng: np.random.Generator,
) -> Uncertainty:
    """Re-score every cell under moved nodes.

    Args:
        cells: the nominal cells.
        nominal: (R, C) overlap with geodesic sides; NaN where not scored.
        sd_skin, sd_patch: (R+1, C+1) node sd per direction, mm.
        rigid: (n, R+1, C+1, 3) displacements of the patch by the registration's
            uncertainty, mm, or None where the frame is given.
        definition, alignment: of the graded overlap.
        samples: n.
        rng: source of randomness.
    """
    grid = sd_skin.shape
    move_skin = rng.normal(size=(samples, *grid, 3)) * sd_skin[..., None]
    move_patch = rng.normal(size=(samples, *grid, 3)) * sd_patch[..., None]
    if rigid is not None:
        move_patch = move_patch + rigid
    skin = cells.skin + displacements(cells, move_skin)
    shift = displacements(cells, move_patch)
    straight = score_quads(cells.skin, cells.patch, definition, alignment)
    raw = score_quads(skin, cells.patch + shift, definition, alignment) + (nominal - straight)
    perfect = score_quads(skin, cells.skin + shift, definition, alignment)
    scored = np.isfinite(nominal)
    bias = np.where(scored, raw.mean(axis=0) - nominal, np.nan)
    reflected = np.clip(2.0 * nominal - raw, 0.0, 1.0)
    shifted = np.clip(raw - 2.0 * bias, 0.0, 1.0)
    low = np.full(nominal.shape, np.nan)
    high = np.full(nominal.shape, np.nan)
    ends = [np.quantile(draw[:, scored], [0.025, 0.975], axis=0) for draw in (reflected, shifted)]
    low[scored] = np.minimum(np.minimum(ends[0][0], ends[1][0]), nominal[scored])
    high[scored] = np.maximum(np.maximum(ends[0][1], ends[1][1]), nominal[scored])
    draws = np.concatenate([reflected, shifted])
    with np.errstate(invalid="ignore"):
        good = (draws >= GOOD_FROM - ROUNDING).mean(axis=0)
        fair = (draws >= FAIR_FROM - ROUNDING).mean(axis=0) - good
    probability = np.stack([good, fair, 1.0 - good - fair], axis=-1)
    probability[~scored] = np.nan
    return Uncertainty(
        low=low,
        high=high,
        probability=probability,
        perfect_fit_reading=np.where(scored, perfect.mean(axis=0), np.nan),
        draws=draws,
    )


def changed_grades(
    cells: FlatCells,
    nominal: FloatArray,
    rigid: FloatArray,
    *,
    definition: GradeBy,
    alignment: Alignment,
) -> FloatArray:
    """Fraction of draws in which the registration alone changes a cell's grade.

    Args:
        cells, nominal, definition, alignment: as in :func:`vary`.
        rigid: (n, R+1, C+1, 3) displacements of the patch, mm.

    Returns:
        (R, C), 0 where not scored.
    """
    shift = displacements(cells, rigid)
    straight = score_quads(cells.skin, cells.patch, definition, alignment)
    raw = score_quads(cells.skin, cells.patch + shift, definition, alignment) + nominal - straight
    limits = np.array([FAIR_FROM, GOOD_FROM]) - ROUNDING
    level = (raw[..., None] >= limits).sum(axis=-1)
    usual = (nominal[..., None] >= limits).sum(axis=-1)
    return np.where(np.isfinite(nominal), (level != usual).mean(axis=0), 0.0)
