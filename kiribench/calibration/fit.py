"""Least-squares fits of hyperelastic laws to one tension test, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.calibration.curve import StrainRange, TensileCurve
from kiribench.calibration.discrepancy import Uncertainty, parameter_uncertainty
from kiribench.calibration.laws import (
    Law,
    OgdenSum,
    Stability,
    Yeoh,
    bar_stress,
    initial_shear_modulus,
    ogden_columns,
    ogden_slopes,
    stability_of,
    terms_of,
    yeoh_columns,
)
from kiribench.errors import DataError
from kiribench.fem.material import NeoHookean, Ogden

FloatArray = npt.NDArray[np.float64]

Weighting = Literal["stress", "relative"]
WEIGHTING_WORDS = {
    "stress": "every row's error in nominal stress counts alike",
    "relative": "every row's error relative to the measured stress counts alike",
}

LAW_NAMES = ("neo-hookean", "ogden", "ogden-2", "ogden-3", "yeoh")
TERMS = {"ogden": 1, "ogden-2": 2, "ogden-3": 3}
ALPHA_RANGE = (-10.0, 20.0)
"""Ogden exponents that are searched."""
DISTINCT_ALPHA = 0.05
"""Exponents nearer than this are one term."""
NO_TERM = 1e-6
"""Part of the whole shear modulus below which a term is none."""


@dataclass(frozen=True)
class RangeScore:
    """How a law fits a part of the test.

    Attributes:
        range: engineering strains.
        rows: rows of the test in it; 0 where the test does not reach it.
        rms_mpa: root mean square error of the nominal stress, MPa.
        worst: largest relative error, with its sign: positive where the law is too stiff.
        worst_at: engineering strain of that row.
        fitted: whether the fit used all of this range.
    """

    range: StrainRange
    rows: int
    rms_mpa: float
    worst: float
    worst_at: float
    fitted: bool


@dataclass(frozen=True, eq=False)
class Fit:
    """A law fitted to one tension test; p parameters.

    Attributes:
        name: one of :data:`LAW_NAMES`.
        law: the law.
        range: engineering strains that were used.
        weighting: of the rows.
        rows: number of rows that were used.
        parameters: names of the parameters, with their units.
        values: (p,) their values.
        uncertainty: of the parameters.
        rms_mpa: root mean square error of the nominal stress over the range, MPa.
        noise_mpa: noise of one reading, MPa: what no law could follow.
        stability: Drucker's condition over the range.
        condition: condition number of the scaled Jacobian; above 1e3 the parameters trade off.
        at_bound: parameters that ended at the edge of what is searched.
        vanished: Ogden terms that were asked for and got no shear modulus, or the exponent of
            another term: the law given here does without them.
    """

    name: str
    law: Law
    range: StrainRange
    weighting: Weighting
    rows: int
    parameters: tuple[str, ...]
    values: FloatArray
    uncertainty: Uncertainty
    rms_mpa: float
    noise_mpa: float
    stability: Stability
    condition: float
    at_bound: tuple[str, ...]
    vanished: int = 0

    @property
    def initial_shear_modulus_mpa(self) -> float:
        """Shear modulus at small strain, MPa."""
        return initial_shear_modulus(self.law)

    @property
    def interval(self) -> FloatArray:
        """(p, 2) 95 % intervals of the parameters."""
        half = self.uncertainty.half_width
        return np.stack([self.values - half, self.values + half], axis=1)


def fit_law(
    name: str,
    curve: TensileCurve,
    strain_range: StrainRange,
    *,
    weighting: Weighting = "stress",
) -> Fit:
    """Fit one law by least squares.

    Args:
        name: one of :data:`LAW_NAMES`.
        curve: the test.
        strain_range: engineering strains that are used.
        weighting: of the rows; a machine at constant speed reads evenly in strain.

    Raises:
        DataError: ``tension-test-short``: too few rows in the range.
    """
    used = strain_range.rows(curve.strain)
    stretch, stress = curve.stretch[used], curve.stress_mpa[used]
    needed = 5 if name in ("neo-hookean", "ogden") else 8
    if len(stretch) < needed:
        raise DataError(
            "tension-test-short",
            f"The tension test has too few rows at strains {strain_range}.",
            remedy="Widen the strain range, or give a test with more rows in it.",
            file=curve.file,
            got=len(stretch),
            expected=f"{needed} or more",
        )
    weight = np.ones_like(stress) if weighting == "stress" else 1 / np.maximum(stress, 1e-12)
    law = estimate(name, stretch, stress, weight)
    names, values, jacobian = linearised(law, stretch)
    weighted = jacobian * weight[:, None]
    error = bar_stress(law, stretch) - stress
    scaled = weighted / np.maximum(np.linalg.norm(weighted, axis=0), 1e-300)
    return Fit(
        name=name,
        law=law,
        range=strain_range,
        weighting=weighting,
        rows=len(stretch),
        parameters=names,
        values=values,
        uncertainty=parameter_uncertainty(weighted, error * weight, stretch),
        rms_mpa=float(np.sqrt(np.mean(error**2))),
        noise_mpa=curve.noise_mpa,
        stability=stability_of(law, float(stretch[-1] - 1)),
        condition=float(np.linalg.cond(scaled)),
        at_bound=_at_bound(law),
        vanished=0 if isinstance(law, (Yeoh, NeoHookean)) else TERMS[name] - len(terms_of(law)[0]),
    )


def estimate(name: str, stretch: FloatArray, stress: FloatArray, weight: FloatArray) -> Law:
    """The weighted least-squares law; stretch, nominal stress (MPa) and weight are (n,).

    Shear moduli of Ogden terms are not negative, so every Ogden law found is stable.
    """
    target = weight * stress
    if name == "neo-hookean":
        unit = weight * ogden_columns(stretch, np.array([2.0]))[:, 0]
        return NeoHookean(float(unit @ target / (unit @ unit)))
    if name == "yeoh":
        columns = yeoh_columns(stretch) * weight[:, None]
        scale = np.linalg.norm(columns, axis=0)
        found = np.linalg.lstsq(columns / scale, target, rcond=None)[0] / scale
        return Yeoh(*(float(value) for value in found))
    result: Ogden | OgdenSum = _one_term(stretch, target, weight)
    for count in range(2, TERMS[name] + 1):
        longer = _one_more_term(result, stretch, target, weight, count)
        if isinstance(longer, Ogden) or len(longer.alpha) < count:
            return result
        result = longer
    return result


def _cost_of(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Residual sum of squares (k,) with one shear modulus of its own for each column (n, k)."""
    along = np.maximum(columns.T @ target, 0.0)
    return np.asarray(target @ target - along**2 / np.einsum("nk,nk->k", columns, columns))


def _one_term(stretch: FloatArray, target: FloatArray, weight: FloatArray) -> Ogden:
    """The shear modulus is linear and eliminated; the exponent is scanned, then refined."""
    from scipy.optimize import minimize_scalar

    grid = np.arange(ALPHA_RANGE[0], ALPHA_RANGE[1] + 0.1, 0.2)

    def column(alpha: float) -> FloatArray:
        return ogden_columns(stretch, np.array([alpha])) * weight[:, None]

    costs = _cost_of(ogden_columns(stretch, grid) * weight[:, None], target)
    best = float(grid[costs.argmin()])
    bounds = (max(ALPHA_RANGE[0], best - 0.2), min(ALPHA_RANGE[1], best + 0.2))

    def cost(alpha: float) -> float:
        one = column(alpha)[:, 0]
        modulus = max(float(one @ target / (one @ one)), 0.0)
        error = modulus * one - target
        return float(error @ error)

    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    alpha = float(found.x)
    unit = column(alpha)[:, 0]
    return Ogden(max(float(unit @ target / (unit @ unit)), 0.0), alpha)


def _one_more_term(
    law: Ogden | OgdenSum,
    stretch: FloatArray,
    target: FloatArray,
    weight: FloatArray,
    count: int,
) -> Ogden | OgdenSum:
    """The best of several starts on a grid of exponents, moduli and exponents then refined."""
    from scipy.optimize import least_squares, nnls

    moduli = terms_of(law)[0]

    def columns(alpha: FloatArray) -> FloatArray:
        return ogden_columns(stretch, alpha) * weight[:, None]

    grid = np.arange(ALPHA_RANGE[0] + 0.5, ALPHA_RANGE[1], 1.0 if count == 2 else 2.5)
    starts = []
    for chosen in combinations(grid, count):
        alpha = np.array(chosen)
        mu, misfit = nnls(columns(alpha), target)
        starts.append((misfit, mu, alpha))
    starts.sort(key=lambda one: one[0])
    size = float(max(moduli.sum(), 1e-12))

    def split(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        return x[:count] * size, x[count:]

    def error(x: FloatArray) -> FloatArray:
        mu, alpha = split(x)
        return columns(alpha) @ mu - target

    def slope(x: FloatArray) -> FloatArray:
        mu, alpha = split(x)
        turned = ogden_slopes(stretch, np.where(np.abs(alpha) < 1e-6, 1e-6, alpha))
        return np.hstack([columns(alpha) * size, turned * mu * weight[:, None]])

    low = np.concatenate([np.zeros(count), np.full(count, ALPHA_RANGE[0])])
    high = np.concatenate([np.full(count, 1e6), np.full(count, ALPHA_RANGE[1])])
    trials = []
    for _, mu, alpha in starts[:6]:
        begin = np.clip(np.concatenate([mu / size, alpha]), low + 1e-9, high - 1e-9)
        trials.append(
            least_squares(
                error, begin, jac=slope, bounds=(low, high), xtol=1e-14, ftol=1e-14, gtol=1e-14,
                x_scale=np.concatenate([np.full(count, 0.1), np.full(count, 1.0)]), max_nfev=400,
            )
        )  # fmt: skip
    found = min(trials, key=lambda trial: float(trial.cost))
    mu, alpha = split(found.x)
    kept = np.argsort(alpha)
    kept = kept[mu[kept] > NO_TERM * mu.sum()]
    kept = kept[np.concatenate([[True], np.diff(alpha[kept]) > DISTINCT_ALPHA])]
    if len(kept) == 1:
        return Ogden(float(mu[kept[0]]), float(alpha[kept[0]]))
    return OgdenSum(
        tuple(float(value) for value in mu[kept]), tuple(float(value) for value in alpha[kept])
    )


def linearised(law: Law, stretch: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names and values (p,) of the parameters, derivative (n, p) of the bar's stress by them."""
    if isinstance(law, NeoHookean):
        return ("mu_mpa",), np.array([law.mu_mpa]), ogden_columns(stretch, np.array([2.0]))
    if isinstance(law, Yeoh):
        values = np.array([law.c1_mpa, law.c2_mpa, law.c3_mpa])
        return ("c1_mpa", "c2_mpa", "c3_mpa"), values, yeoh_columns(stretch)
    mu, alpha = terms_of(law)
    jacobian = np.hstack([ogden_columns(stretch, alpha), ogden_slopes(stretch, alpha) * mu])
    if isinstance(law, Ogden):
        return ("mu_mpa", "alpha"), np.concatenate([mu, alpha]), jacobian
    names = [f"mu{k + 1}_mpa" for k in range(len(mu))] + [f"alpha{k + 1}" for k in range(len(mu))]
    return tuple(names), np.concatenate([mu, alpha]), jacobian


def _at_bound(law: Law) -> tuple[str, ...]:
    if isinstance(law, (Yeoh, NeoHookean)):
        return ()
    alpha = terms_of(law)[1]
    edge = np.minimum(alpha - ALPHA_RANGE[0], ALPHA_RANGE[1] - alpha) < 1e-3
    single = len(alpha) == 1
    return tuple("alpha" if single else f"alpha{k + 1}" for k in np.flatnonzero(edge))


def scores(
    law: Law,
    curve: TensileCurve,
    ends: tuple[float, ...] = (0.2, 0.5, 1.0, 1.5, 2.0, 3.0),
    *,
    fitted: StrainRange | None = None,
) -> tuple[RangeScore, ...]:
    """How a law fits the test from 0 to each of some engineering strains."""
    result = []
    for end in ends:
        part = StrainRange(0.0, end)
        used = part.rows(curve.strain)
        reaches = curve.strain[-1] >= end - 1e-9
        if used.sum() < 2 or not reaches:
            result.append(RangeScore(part, 0, np.nan, np.nan, np.nan, False))
            continue
        stress = curve.stress_mpa[used]
        error = bar_stress(law, curve.stretch[used]) - stress
        relative = error / stress
        row = int(np.abs(relative).argmax())
        inside = fitted is not None and fitted.low <= 1e-9 and end <= fitted.high + 1e-9
        result.append(
            RangeScore(
                part,
                int(used.sum()),
                float(np.sqrt(np.mean(error**2))),
                float(relative[row]),
                float(curve.strain[used][row]),
                inside,
            )
        )
    return tuple(result)
