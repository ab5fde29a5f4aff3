"""What the uncertainty of nodes and registration does to overlaps and grades.

Every grid node moves as one (neighbouring cells share it), isotropically with its
``sd_mm`` per direction; the patch moves rigidly as well where it was registered. A cell
is re-scored in its flat frame with straight sides; the difference that curved sides make
is taken from the nominal score.

Noise is not symmetric for an overlap: it can only hurt a perfect fit, so the spread of
re-scored cells is no interval for the true overlap (plain percentiles cover a perfect fit in
3 % of the cases). Instead the reading is tested against true mismatches (test inversion,
Carpenter 1999, doi 10.1002/(SICI)1097-0258(19990615)18:11<1387::AID-SIM127>3.0.CO;2-X): the
observed mismatch of the corners, scaled by factors from 0 (a perfect fit) upwards, is taken
for true, and the distribution of its readings under the node noise is simulated. True
overlaps that would read less, or more, than what was read in at least 2.5 % of the cases are
in the interval. What was read by luck above a perfect fit's usual reading excludes too much
below; so the interval starts at the reading minus 1.96 sd at the latest. The tests measure
the coverage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from kiribench.conformability.clip import quad_areas
from kiribench.conformability.grades import ROUNDING
from kiribench.conformability.overlap import Overlaps
from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, Alignment, GradeBy

FloatArray = NDArray[np.float64]

#: Multiples of the observed mismatch that are tried as the true one.
SCALES = (0.0, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.15, 1.3, 1.5, 1.8)
#: Draws for each of them: a share of .025 is known to .008.
FAMILY_DRAWS = 400
NORMAL_97_5 = 1.959964


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
        draws: (n, R, C) true overlaps that are compatible with the reading, correlated
            between cells as the noise is; NaN where not scored.
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
    return compatible(
        cells,
        nominal,
        displacements(cells, move_skin),
        displacements(cells, move_patch),
        definition=definition,
        alignment=alignment,
    )


def compatible(
    cells: FlatCells,
    nominal: FloatArray,
    move_skin: FloatArray,
    move_patch: FloatArray,
    *,
    definition: GradeBy,
    alignment: Alignment,
) -> Uncertainty:
    """True overlaps that are compatible with the readings.

    Args:
        cells, nominal, definition, alignment: as in :func:`vary`.
        move_skin, move_patch: (n, R, C, 4, 2) drawn displacements of the corners in the
            cells' flat frames, mm.
    """
    count = len(move_skin)
    scored = np.isfinite(nominal)
    skin, offset = cells.skin, cells.patch - cells.skin
    moved = skin + move_skin
    # Straight sides leave a difference that is none for a perfect fit.
    curved = nominal - score_quads(skin, cells.patch, definition, alignment)
    raw = score_quads(moved, cells.patch + move_patch, definition, alignment) + curved
    few = slice(0, min(count, FAMILY_DRAWS))
    true = np.empty((len(SCALES), *nominal.shape))
    share = np.empty_like(true)
    perfect = score_quads(moved, skin + move_patch, definition, alignment).mean(axis=0)
    perfect = np.where(scored, perfect, np.nan)
    for k, scale in enumerate(SCALES):
        patch = skin + scale * offset
        true[k] = score_quads(skin, patch, definition, alignment) + scale * curved
        read = score_quads(moved[few], patch + move_patch[few], definition, alignment)
        share[k] = (read + scale * curved <= nominal + ROUNDING).mean(axis=0)
    low = np.full(nominal.shape, np.nan)
    high = np.full(nominal.shape, np.nan)
    draws = np.full(raw.shape, np.nan)
    for at in zip(*np.nonzero(scored), strict=True):
        readings = raw[(slice(None), *at)]
        quantile = np.empty(count)
        quantile[np.argsort(readings, kind="stable")] = (np.arange(count) + 0.5) / count
        ends = np.array([0.025, 0.975])
        of_family = _true_overlap(true[(slice(None), *at)], share[(slice(None), *at)])
        spread = float(readings.std())
        high[at], low[at] = of_family(ends, spread, float(nominal[at]))
        low[at] = min(low[at], nominal[at] - NORMAL_97_5 * spread)
        high[at] = max(high[at], nominal[at])
        draws[(slice(None), *at)] = of_family(quantile, spread, float(nominal[at]))
    low, draws = np.maximum(low, 0.0), np.clip(draws, 0.0, 1.0)
    with np.errstate(invalid="ignore"):
        good = (draws >= GOOD_FROM - ROUNDING).mean(axis=0)
        fair = (draws >= FAIR_FROM - ROUNDING).mean(axis=0) - good
    probability = np.stack([good, fair, 1.0 - good - fair], axis=-1)
    probability[~scored] = np.nan
    return Uncertainty(low, high, probability, perfect, draws)


def _true_overlap(
    true: FloatArray, share: FloatArray
) -> Callable[[FloatArray, float, float], FloatArray]:
    """The confidence distribution of one cell's true overlap, by its quantiles from above.

    Args:
        true: (T,) overlaps of the scaled mismatches. share: (T,) of their readings that do
            not exceed the one that was read.

    Returns:
        A function of (q, sd, reading): the overlap whose readings lie below the one that was
        read with probability q; beyond the largest mismatch tried, the reading minus normal
        noise.
    """
    rising = np.maximum.accumulate(share)

    def of(quantile: FloatArray, spread: float, reading: float) -> FloatArray:
        inside = np.interp(quantile, rising, true)
        beyond = np.minimum(true[-1], reading - spread * ndtri(quantile))
        return np.where(quantile > rising[-1], beyond, inside)

    return of


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
