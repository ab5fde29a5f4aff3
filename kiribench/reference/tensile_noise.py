"""How far a measured curve and a simulated one lie apart, and how much of it is scatter.

The cells are repeats of one measurement: their deviations from their own mean say how the mean of
all of them errs, frame by frame and from frame to frame. What all cells share (a lens, a sample
that moves towards the camera) is not seen by this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

FACTORS = 2
"""Patterns over frames by which cells may differ for good (a longer cut, a thinner spot)."""


@dataclass(frozen=True, eq=False)
class Scatter:
    """Of k cells in m observations.

    Attributes:
        pattern: (m, q) of one standard deviation of a cell each: what cells differ by for good.
        white: (m,) variance of a cell's reading beyond that.
        cells: number of cells.
    """

    pattern: FloatArray
    white: FloatArray
    cells: int

    @property
    def of_mean(self) -> FloatArray:
        """(m, m) covariance of the mean over cells."""
        return np.asarray((self.pattern @ self.pattern.T + np.diag(self.white)) / self.cells)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the variances."""
        return max(self.cells - 1, 2)


def scatter_of(cells: FloatArray, blocks: tuple[int, ...], floor_sd: float) -> Scatter:
    """What the cells' deviations from their mean say.

    Args:
        cells: (k, m) observations of each cell; NaN where it was not measured.
        blocks: numbers of observations of each kind, which sum to m; the white part of each
            kind has one variance.
        floor_sd: standard deviation of a reading by the pictures' noise; the white part is not
            taken for smaller. NaN where not known.
    """
    count, size = cells.shape
    mean = np.nanmean(cells, axis=0)
    away = np.where(np.isfinite(cells), cells, mean) - mean
    floor = floor_sd**2 if np.isfinite(floor_sd) else 0.0
    factors = min(FACTORS, count - 2) if count >= 4 else 0
    pattern = np.zeros((size, 0))
    rest = away
    if factors:
        left, sizes, right = np.linalg.svd(away, full_matrices=False)
        rest = away - (left[:, :factors] * sizes[:factors]) @ right[:factors]
    freedom = max(count - 1 - factors, 1)
    white = np.empty(size)
    start = 0
    for block in blocks:
        part = rest[:, start : start + block]
        level = float((part**2).sum() / (freedom * max(block - factors / len(blocks), 1)))
        if count < 4 and block >= 6:
            level = float(np.mean(np.diff(mean[start : start + block], 3) ** 2) / 20) * count
        white[start : start + block] = max(level, floor, 1e-14)
        start += block
    if factors:
        excess = np.maximum(sizes[:factors] ** 2 / (count - 1) - white.mean(), 0.0)
        pattern = (right[:factors] * np.sqrt(excess)[:, None]).T
    return Scatter(pattern, white, count)


@dataclass(frozen=True)
class Distance:
    """How far two curves lie apart over a range of strain, as one number.

    Attributes:
        rms: root mean square difference as measured; scatter makes it larger.
        scatter_rms: what scatter alone would give.
        value: the rest: what is left of the squares without the scatter's, its root.
        low, high: 95 % interval of ``value``.
    """

    rms: float
    scatter_rms: float
    value: float
    low: float
    high: float


def distance_of(
    difference: FloatArray, covariance: FloatArray, strain: FloatArray, freedom: int
) -> Distance:
    """Root mean square of a difference (m,) over strain (m,), growing, given its covariance.

    The square is a quadratic form of a normal vector: mean d'Ad + tr(AS), variance
    2 tr(ASAS) + 4 d'ASAd. The interval takes the t quantile of the covariance's ``freedom``.
    """
    from scipy.stats import t as student

    weight = np.gradient(strain) if len(strain) > 1 else np.ones(1)
    weight = np.maximum(weight, 0) + 1e-12
    weight = weight / weight.sum()
    scaled = weight[:, None] * covariance
    raw = float(weight @ difference**2)
    by_scatter = float(np.trace(scaled))
    square = raw - by_scatter
    pulled = weight * difference
    true_part = max(square, 0.0) / raw if raw > 0 else 0.0
    variance = 2 * float(np.trace(scaled @ scaled)) + 4 * true_part * float(
        pulled @ covariance @ pulled
    )
    reach = float(student.ppf(0.975, freedom)) * np.sqrt(variance)

    def root(value: float) -> float:
        return float(np.sqrt(max(value, 0.0)))

    return Distance(
        root(raw), root(by_scatter), root(square), root(square - reach), root(square + reach)
    )
