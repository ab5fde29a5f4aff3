"""How uncertain a least-squares fit is when the residuals of one curve hang together.

The rows of one pull are no independent measurements: what a law cannot follow, and what the
machine did, is alike in neighbouring rows. The residual is taken as noise of every row plus a
random function of the stretch (Kennedy & O'Hagan, J. R. Stat. Soc. B 63, 2001): smooth (Matern
5/2) or rough (Matern 1/2), of unknown correlation length and size. All of these are weighed by the
restricted likelihood of the residuals, and each gives the least-squares parameters a covariance
(a sandwich, B S B'); the interval is that of the mixture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

MOST_ROWS = 240
"""More rows are averaged in groups first: the cost grows with their cube."""
LENGTHS = (0.02, 0.04, 0.08, 0.15, 0.3)
"""Correlation lengths that are weighed, as parts of the range of the stretch. An error that wanders
more slowly cannot be told from a change of the parameters by the curve itself: it is left to the
comparison of ranges, and of samples."""
RATIOS = (0.0, *(10.0**k for k in np.arange(-1.5, 8.01, 0.5)))
"""Variances of the random function that are weighed, over that of the noise."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Of p parameters.

    Attributes:
        sd: (p,) half of the half-width of the 95 % interval, over 1.96: what a normal error of
            that interval would have.
        half_width: (p,) half-width of the 95 % interval.
        noise_sd: (p,) by the noise of the rows alone.
        misfit_sd: (p,) by what hangs together along the curve: the law's misfit, and whatever
            the machine added smoothly.
        correlation: (p, p) of the parameters.
        correlation_length: in stretch, mean by weight; NaN where there is only noise.
    """

    sd: FloatArray
    half_width: FloatArray
    noise_sd: FloatArray
    misfit_sd: FloatArray
    correlation: FloatArray
    correlation_length: float


def parameter_uncertainty(
    jacobian: FloatArray, residual: FloatArray, stretch: FloatArray
) -> Uncertainty:
    """Uncertainty of least-squares parameters from the residuals of one curve.

    Args:
        jacobian: (n, p) derivative of the weighted model by the parameters.
        residual: (n,) weighted residual at the estimate.
        stretch: (n,) of the rows, growing.
    """
    from scipy.stats import t as student

    jacobian, residual, stretch = _grouped(jacobian, residual, stretch)
    n, p = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    solve = np.linalg.pinv(jacobian / scale)
    freedom = max(n - p, 1)
    reach = float(stretch[-1] - stretch[0])
    away = np.abs(stretch[:, None] - stretch[None, :])
    # Residuals at the level of rounding carry no information; they would only break logarithms.
    floor = float(np.finfo(float).eps * (1 + np.abs(residual).max())) ** 2
    weights, noise, misfit, lengths = [], [], [], []
    for rough in (False, True):
        for part in LENGTHS:
            values, vectors = np.linalg.eigh(_matern(away / (part * reach), rough))
            values = np.maximum(values, 0.0)
            turned, seen = vectors.T @ (jacobian / scale), vectors.T @ residual
            shaken = solve @ vectors
            for ratio in RATIOS:
                variance = ratio * values + 1
                square, log_weight = _restricted(turned, seen, variance, freedom)
                if not np.isfinite(log_weight):
                    continue
                square = max(square, floor)
                weights.append(log_weight)
                noise.append(square * shaken @ shaken.T)
                misfit.append(square * ratio * (shaken * values) @ shaken.T)
                lengths.append(part * reach if ratio else np.nan)
    share = np.exp(np.array(weights) - max(weights))
    share /= share.sum()
    by_noise, by_misfit = np.array(noise), np.array(misfit)
    total = by_noise + by_misfit
    back = 1 / scale
    spread = np.sqrt(np.maximum(np.einsum("kii->ki", total), 0.0)) * back
    half = np.array([_half_width(spread[:, i], share, freedom, student) for i in range(p)])
    mean = np.einsum("k,kij->ij", share, total)
    size = np.sqrt(np.maximum(np.diag(mean), 1e-300))
    known = np.isfinite(lengths)
    return Uncertainty(
        sd=half / 1.959963984540054,
        half_width=half,
        noise_sd=np.sqrt(np.einsum("k,kii->i", share, by_noise)) * back,
        misfit_sd=np.sqrt(np.maximum(np.einsum("k,kii->i", share, by_misfit), 0.0)) * back,
        correlation=mean / np.outer(size, size),
        correlation_length=float(np.average(np.array(lengths)[known], weights=share[known]))
        if share[known].sum() > 0
        else float("nan"),
    )


def _matern(away: FloatArray, rough: bool) -> FloatArray:
    if rough:
        return np.asarray(np.exp(-away))
    x = np.sqrt(5.0) * away
    return np.asarray((1 + x + x * x / 3) * np.exp(-x))


def _restricted(
    jacobian: FloatArray, residual: FloatArray, variance: FloatArray, freedom: int
) -> tuple[float, float]:
    """Scale of the variance and profiled restricted log-likelihood (Patterson & Thompson 1971)."""
    whitened, rest = jacobian / np.sqrt(variance)[:, None], residual / np.sqrt(variance)
    basis, triangle = np.linalg.qr(whitened)
    left = rest - basis @ (basis.T @ rest)
    square = float(left @ left)
    diagonal = np.abs(np.diag(triangle))
    if square <= 0 or diagonal.min() <= 0:
        return 0.0, 0.0
    log_weight = (
        -0.5 * freedom * np.log(square)
        - 0.5 * float(np.log(variance).sum())
        - float(np.log(diagonal).sum())
    )
    return square / freedom, float(log_weight)


def _half_width(spread: FloatArray, share: FloatArray, freedom: int, student: object) -> float:
    """Half-width of the symmetric 95 % interval of a mixture of t distributions."""
    from scipy.optimize import brentq

    used = share > 1e-9
    sizes, weights = np.maximum(spread[used], 1e-300), share[used]

    def outside(width: float) -> float:
        tail = student.sf(width / sizes, freedom)  # type: ignore[attr-defined]
        return float(2 * (weights @ tail) / weights.sum() - 0.05)

    high = float(sizes.max())
    while outside(high) > 0:
        high *= 2
    return float(brentq(outside, 0.0, high, xtol=1e-6 * high))


def _grouped(
    jacobian: FloatArray, residual: FloatArray, stretch: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At most :data:`MOST_ROWS` means of neighbouring rows, scaled so that sums are kept."""
    n = len(stretch)
    groups = -(-n // MOST_ROWS)
    if groups < 2:
        return jacobian, residual, stretch
    start = np.arange(0, n, groups)
    count = np.diff(np.append(start, n))
    root = np.sqrt(count)
    return (
        np.add.reduceat(jacobian, start, axis=0) / root[:, None],
        np.add.reduceat(residual, start) / root,
        np.add.reduceat(stretch, start) / count,
    )
