"""Comparing laws on one test: left-out parts, errors of the set-up, a modulus from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from kiribench.calibration.curve import TensileCurve
from kiribench.calibration.fit import Fit, estimate, linearised
from kiribench.calibration.laws import bar_stress, initial_shear_modulus
from kiribench.fem.material import NeoHookean

FloatArray = npt.NDArray[np.float64]

BLOCKS = 5
"""Parts of the strain range, of which each is left out once."""
CLEAR = 4
"""Blocks of five in which a law must predict better to be called better."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors of a law in parts of the range that its fit did not see.

    Attributes:
        rms_mpa: (BLOCKS,) of the nominal stress in each part, MPa; the first and the last part
            are extrapolated, the others are bridged.
        jackknife_sd: (p,) of the parameters: by how much they hang on which part was tested; NaN
            where leaving a part out changes the number of terms.
    """

    rms_mpa: FloatArray
    jackknife_sd: FloatArray

    @property
    def bridged_mpa(self) -> float:
        """Root mean square over the inner parts, MPa."""
        return float(np.sqrt(np.mean(self.rms_mpa[1:-1] ** 2)))

    @property
    def beyond_mpa(self) -> float:
        """Error of the last part, predicted from all below it, MPa."""
        return float(self.rms_mpa[-1])


def left_out(fit: Fit, curve: TensileCurve) -> LeftOut:
    """Leave out each of :data:`BLOCKS` neighbouring parts of the range and predict it."""
    used = fit.range.rows(curve.strain)
    stretch, stress = curve.stretch[used], curve.stress_mpa[used]
    weight = np.ones_like(stress) if fit.weighting == "stress" else 1 / stress
    edges = np.linspace(0, len(stretch), BLOCKS + 1).astype(int)
    errors, values = [], []
    for low, high in pairwise(edges):
        kept = np.ones(len(stretch), dtype=bool)
        kept[low:high] = False
        law = estimate(fit.name, stretch[kept], stress[kept], weight[kept])
        away = bar_stress(law, stretch[low:high]) - stress[low:high]
        errors.append(float(np.sqrt(np.mean(away**2))))
        values.append(linearised(law, stretch)[1])
    if len({len(one) for one in values} | {len(fit.values)}) > 1:
        spread = np.full(len(fit.values), np.nan)
    else:
        table = np.array(values)
        spread = np.sqrt((BLOCKS - 1) / BLOCKS * ((table - table.mean(axis=0)) ** 2).sum(axis=0))
    return LeftOut(np.array(errors), spread)


def verdict(names: Sequence[str], left: Sequence[LeftOut]) -> str:
    """Which law predicts parts of the test that it did not see best, in one sentence."""
    order = np.argsort([one.bridged_mpa for one in left])
    best = int(order[0])
    if len(order) < 2:
        return f"Only {names[best]} was fitted."
    tied = [
        names[k] for k in order[1:] if (left[best].rms_mpa < left[int(k)].rms_mpa).sum() < CLEAR
    ]
    words = f"{names[best]} bridges left-out parts best ({left[best].bridged_mpa:.2g} MPa)"
    if tied:
        words += f"; not clearly worse: {', '.join(tied)}"
    nearest = int(np.argmin([one.beyond_mpa for one in left]))
    return (
        words + f"; beyond its range {names[nearest]} errs least "
        f"({left[nearest].beyond_mpa:.2g} MPa on the last fifth)."
    )


@dataclass(frozen=True)
class Change:
    """What an error of the test's set-up would do to a fit.

    Attributes:
        what: the error, in words.
        modulus_percent: change of the initial shear modulus, percent.
        values: change of each parameter.
    """

    what: str
    modulus_percent: float
    values: tuple[float, ...]


def set_up_errors(fit: Fit, curve: TensileCurve) -> tuple[Change, ...]:
    """What +1 % of length or cross-section and one reading of slack would change.

    One pull cannot tell these from the material.
    """
    used = fit.range.rows(curve.strain)
    stretch, stress = curve.stretch[used], curve.stress_mpa[used]
    step = float(np.median(np.diff(stretch)))
    cases = (
        ("undeformed length 1 % longer", 1 + (stretch - 1) / 1.01, stress),
        ("cross-section 1 % larger", stretch, stress / 1.01),
        (f"slack of one reading (strain {step:.4f} less)", stretch - step, stress),
    )
    found = []
    for what, along, pull in cases:
        right = along > 1
        weight = np.ones_like(pull) if fit.weighting == "stress" else 1 / pull
        law = estimate(fit.name, along[right], pull[right], weight[right])
        values = linearised(law, along[right])[1]
        change = initial_shear_modulus(law) / fit.initial_shear_modulus_mpa - 1
        same = len(values) == len(fit.values)
        found.append(
            Change(
                what,
                100 * float(change),
                tuple(float(x) for x in values - fit.values) if same else (),
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class GivenModulus:
    """A neo-Hookean shear modulus from elsewhere, beside the test.

    Attributes:
        mu_mpa: the modulus, MPa.
        equal_up_to: largest strain of the range, from the test's first row on, in which the
            least-squares neo-Hookean law has this modulus; None where no range has it.
        modulus_by_range: largest strain -> least-squares modulus, MPa.
        stress_error: strain -> relative error of its stress there; positive is too stiff.
        exact_at: strain at which its stress is the measured one, or None.
    """

    mu_mpa: float
    equal_up_to: float | None
    modulus_by_range: dict[float, float]
    stress_error: dict[float, float]
    exact_at: float | None


def given_modulus(
    curve: TensileCurve,
    mu_mpa: float,
    *,
    ends: Sequence[float] = (0.2, 0.5, 1.0, 1.5, 1.9, 2.0, 2.5, 3.0),
    strains: Sequence[float] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0),
) -> GivenModulus:
    """Where a neo-Hookean modulus from elsewhere holds for this test, and by how much it errs."""
    unit = bar_stress(NeoHookean(1.0), curve.stretch)
    running = np.cumsum(unit * curve.stress_mpa) / np.cumsum(unit * unit)
    strain = curve.strain

    inside = [x for x in strains if strain[0] <= x <= strain[-1]]
    measured = np.interp(inside, strain, curve.stress_mpa)
    predicted = bar_stress(NeoHookean(mu_mpa), 1 + np.array(inside))
    return GivenModulus(
        mu_mpa,
        _crossing(running[4:], strain[4:], mu_mpa),
        {
            end: float(running[np.searchsorted(strain, end, side="right") - 1])
            for end in ends
            if end <= strain[-1] and (strain <= end).sum() >= 5
        },
        {x: float(error) for x, error in zip(inside, predicted / measured - 1, strict=True)},
        _crossing(curve.stress_mpa / unit, strain, mu_mpa),
    )


def _crossing(values: FloatArray, strain: FloatArray, level: float) -> float | None:
    """The largest strain at which values (n,) pass a level, between two rows; or None."""
    side = np.sign(values - level)
    change = np.flatnonzero(side[:-1] * side[1:] <= 0)
    if not len(change):
        return None
    k = int(change[-1])
    rise = values[k + 1] - values[k]
    part = (level - values[k]) / rise if rise else 0.0
    return float(strain[k] + part * (strain[k + 1] - strain[k]))
