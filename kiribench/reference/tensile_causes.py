"""Which cause explains the difference between a simulated and a measured pull, and which cannot.

Each cause is a small change of the simulation with a plausible size; its sensitivities are finite
differences of the simulator. The difference is compared with what each family of causes, and
scatter alone, would make it (marginal likelihood of a linear model, a multivariate t because the
scatter is estimated from few cells). Families that do nearly equally well are not told apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from kiribench.reference.tensile_noise import Scatter, scatter_of

FloatArray = npt.NDArray[np.float64]

TELL = float(np.log(10.0))
"""Log of the odds above which one family is told from another."""
BEYOND_NOISE = float(np.log(20.0))
"""Log of the odds that a family needs against scatter alone."""
IMPLAUSIBLE = 0.01
"""Probability of a larger misfit below which a family is said not to explain the difference."""
DRAWS = 400


@dataclass(frozen=True, eq=False)
class Cause:
    """One thing that may be other than simulated.

    Attributes:
        name: short, such as ``cut-a``.
        family: ``material``, ``boundary`` or ``cut length``.
        words: what it means, with its unit.
        unit: of the amount: its value for one unit of the words.
        plausible: standard deviation of the amount before the test is seen.
        effect: (m,) change of the observations by one unit.
    """

    name: str
    family: str
    words: str
    unit: str
    plausible: float
    effect: FloatArray


@dataclass(frozen=True)
class Amount:
    """How much of a cause the test asks for.

    Attributes:
        name, words, unit: of the cause.
        value, sd: amount and its standard deviation.
        told: whether the test says much more than was assumed before it.
    """

    name: str
    words: str
    unit: str
    value: float
    sd: float
    told: bool


@dataclass(frozen=True, eq=False)
class Explanation:
    """What one family of causes, or scatter alone, makes of the difference.

    Attributes:
        families: names; empty for scatter alone.
        log_evidence: log marginal likelihood of the difference.
        misfit: squared difference that is left, in units of its covariance.
        probability: of a misfit at least as large, if this were the explanation.
        amounts: of its causes.
        left: (m,) difference that is left.
    """

    families: tuple[str, ...]
    log_evidence: float
    misfit: float
    probability: float
    amounts: tuple[Amount, ...]
    left: FloatArray

    @property
    def name(self) -> str:
        """The families in words."""
        return " and ".join(self.families) if self.families else "noise"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Which explanation holds.

    Attributes:
        kind: ``noise``, ``one``, ``cannot-tell``, ``together`` or ``none``.
        best: the explanation that is named, or the best of those that are not told apart.
        tied: the families that are not told apart, the best one first; one where it is told.
        all: every explanation that was tried: scatter, then each family.
        alike: pairs of causes with the cosine of their effects, above .9.
    """

    kind: str
    best: Explanation
    tied: tuple[Explanation, ...]
    all: tuple[Explanation, ...]
    alike: tuple[tuple[str, str, float], ...]


@dataclass(frozen=True, eq=False)
class Observed:
    """The difference measured minus simulated, and what is known of its errors; m numbers.

    Attributes:
        cells: (k, c) the first c observations cell by cell; NaN where not measured.
        blocks: how many of them are of each kind.
        single: (m - c,) observations that exist once (force).
        single_sd: their standard deviation.
        mesh: (m,) change by the mesh: an error of one standard deviation, alike everywhere.
        floor_sd: noise floor of a cell's reading.
    """

    cells: FloatArray
    blocks: tuple[int, ...]
    single: FloatArray
    single_sd: float
    mesh: FloatArray
    floor_sd: float

    @property
    def difference(self) -> FloatArray:
        """(m,) the means over cells, then the single ones."""
        return np.concatenate([np.nanmean(self.cells, axis=0), self.single])

    def covariance(self, scatter: Scatter) -> FloatArray:
        """(m, m) of the difference by scatter, force noise and mesh."""
        size, inner = len(self.mesh), self.cells.shape[1]
        result = np.outer(self.mesh, self.mesh)
        result[:inner, :inner] += scatter.of_mean
        result[range(inner, size), range(inner, size)] += self.single_sd**2
        return result


Again = Callable[[Explanation], tuple[Observed, tuple[Cause, ...]]]
"""Linearises anew: the observations and a family's effects about the amounts of an explanation,
such that the observations are again those of amounts counted from 0."""
ROUNDS = 3


def diagnose(
    observed: Observed, causes: tuple[Cause, ...], *, seed: int = 0, again: Again | None = None
) -> Diagnosis:
    """Name the family of causes that explains a difference, or say that it cannot be told.

    Args:
        observed: the difference and its errors.
        causes: with their effects on the same observations.
        seed: of the draws that calibrate the misfits for the estimated scatter.
        again: the family that comes nearest gets its effects anew at the amounts found, once
            and, while it does not explain the difference, up to ``ROUNDS`` times: large amounts
            are not linear.
    """
    scatter = scatter_of(observed.cells, observed.blocks, observed.floor_sd)
    covariance = observed.covariance(scatter)
    reference = _misfits_by_chance(observed, scatter, seed)
    families = tuple(dict.fromkeys(cause.family for cause in causes))

    def explain(*names: str) -> Explanation:
        chosen = [cause for cause in causes if cause.family in names]
        return _explain(observed.difference, covariance, names, chosen, reference, scatter.freedom)

    noise = explain()
    single = [explain(name) for name in families]
    best = max(single, key=lambda one: one.log_evidence, default=noise)
    for turn in range(ROUNDS):
        needless = best.log_evidence - noise.log_evidence < BEYOND_NOISE
        enough = needless and noise.probability >= IMPLAUSIBLE
        done = turn > 0 and best.probability >= IMPLAUSIBLE
        if again is None or not best.families or enough or done:
            break
        moved, anew = again(best)
        better = _explain(
            moved.difference, covariance, best.families, list(anew), reference, scatter.freedom
        )
        single[single.index(best)] = better
        best = better
    tried = (noise, *single)
    best = max(single, key=lambda one: one.log_evidence, default=noise)
    alike = _alike(causes, covariance)
    needless = best.log_evidence - noise.log_evidence < BEYOND_NOISE
    if needless and noise.probability >= IMPLAUSIBLE:
        return Diagnosis("noise", noise, (noise,), tried, alike)
    tied = sorted(
        (one for one in single if best.log_evidence - one.log_evidence < TELL),
        key=lambda one: -one.log_evidence,
    )
    if best.probability < IMPLAUSIBLE:
        pairs = [explain(*pair) for pair in combinations(families, 2)]
        both = max(pairs, key=lambda one: one.log_evidence, default=best)
        tried = (*tried, *pairs)
        if both.probability >= IMPLAUSIBLE:
            return Diagnosis("together", both, (both,), tried, alike)
        return Diagnosis("none", best, tuple(tied), tried, alike)
    kind = "one" if len(tied) == 1 else "cannot-tell"
    return Diagnosis(kind, best, tuple(tied), tried, alike)


def _explain(
    difference: FloatArray,
    covariance: FloatArray,
    families: tuple[str, ...],
    causes: list[Cause],
    reference: FloatArray,
    freedom: int,
) -> Explanation:
    size = len(difference)
    effects = np.array([cause.effect for cause in causes]).reshape(len(causes), size).T
    prior = np.array([cause.plausible**2 for cause in causes])
    total = covariance + (effects * prior) @ effects.T
    factor = np.linalg.cholesky(total)
    white = np.linalg.solve(factor, difference)
    misfit = float(white @ white)
    log_evidence = -float(np.log(np.diag(factor)).sum()) - 0.5 * (freedom + size) * float(
        np.log1p(misfit / freedom)
    )
    gain = (prior[:, None] * effects.T) @ np.linalg.inv(total)
    value = gain @ difference
    spread = np.sqrt(np.maximum(prior - np.einsum("im,mi,i->i", gain, effects, prior), 0.0))
    amounts = tuple(
        Amount(
            cause.name,
            cause.words,
            cause.unit,
            float(value[i]),
            float(spread[i]),
            bool(spread[i] < 0.5 * cause.plausible),
        )
        for i, cause in enumerate(causes)
    )
    return Explanation(
        families,
        log_evidence,
        misfit,
        float((1 + (reference >= misfit).sum()) / (1 + len(reference))),
        amounts,
        difference - effects @ value,
    )


def _misfits_by_chance(observed: Observed, scatter: Scatter, seed: int) -> FloatArray:
    """(DRAWS,) misfits of scatter alone, its size estimated anew from every draw's cells."""
    rng = np.random.default_rng(seed)
    count, inner = observed.cells.shape
    size = len(observed.mesh)
    missing = ~np.isfinite(observed.cells)
    found = np.empty(DRAWS)
    for k in range(DRAWS):
        cells = rng.normal(size=(count, scatter.pattern.shape[1])) @ scatter.pattern.T
        cells = cells + np.sqrt(scatter.white) * rng.normal(size=(count, inner))
        common = rng.normal() * observed.mesh
        draw = Observed(
            np.where(missing, np.nan, cells + common[:inner]),
            observed.blocks,
            observed.single_sd * rng.normal(size=size - inner) + common[inner:],
            observed.single_sd,
            observed.mesh,
            observed.floor_sd,
        )
        total = draw.covariance(scatter_of(draw.cells, draw.blocks, draw.floor_sd))
        difference = draw.difference
        found[k] = float(difference @ np.linalg.solve(total, difference))
    return found


def _alike(causes: tuple[Cause, ...], covariance: FloatArray) -> tuple[tuple[str, str, float], ...]:
    """Pairs of causes whose effects are nearly proportional where it matters."""
    factor = np.linalg.cholesky(covariance)
    white = [np.linalg.solve(factor, cause.effect) for cause in causes]
    found = []
    for i, j in combinations(range(len(causes)), 2):
        size = float(np.linalg.norm(white[i]) * np.linalg.norm(white[j]))
        cosine = float(white[i] @ white[j]) / size if size > 0 else 0.0
        if abs(cosine) > 0.9:
            found.append((causes[i].name, causes[j].name, cosine))
    return tuple(found)
