"""The table of the models: name, what it is, whether it knows its own uncertainty.

A name is ``model`` (sensible settings) or ``model:variant`` (``:paper`` is the source
paper's settings where it states them, and a guess, said to be one, where it does not).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiribench.errors import UsageError


class Regressor(Protocol):
    """What every model can do: a scikit-learn regressor."""

    def fit(self, X: ArrayLike, y: ArrayLike) -> Regressor:
        """Learn from (n, d) rows and (n,) targets."""
        ...

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """The (n,) means; models with uncertainty also take ``return_std=True``."""
        ...

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The settings, as scikit-learn has it."""
        ...


@dataclass(frozen=True, slots=True)
class ModelSpec:
    """One row of the table of models.

    Attributes:
        name: ``model`` or ``model:variant``, as a person types it.
        title: a short name for tables and figures.
        description: one sentence, with the settings that matter.
        has_uncertainty: whether ``predict(X, return_std=True)`` exists; the standard
            deviation is that of a new observation, noise included.
        is_gp: whether :func:`kiribench.surrogate.leave_out.leave_folds_out` applies.
        in_paper: whether the model is one of the paper's four (table 1).
        guessed: which of the settings are our guess of the paper's, empty if none is.
        extra: the optional dependency that the model needs, ``None`` if none.
        factory: builds the estimator from ``seed``, ``device`` and further settings.
    """

    name: str
    title: str
    description: str
    has_uncertainty: bool
    is_gp: bool
    in_paper: bool
    factory: Callable[..., Regressor]
    guessed: str = ""
    extra: str | None = None

    @property
    def available(self) -> bool:
        """Whether the model's optional dependency is installed."""
        return self.extra is None or find_spec(self.extra) is not None


def model_names(*, available_only: bool = True) -> tuple[str, ...]:
    """The names of all models, in the table's order."""
    return tuple(name for name, entry in _MODELS.items() if entry.available or not available_only)


def spec(name: str) -> ModelSpec:
    """The table's row for ``name``.

    Raises:
        UsageError: no model has this name; the message lists the names.
    """
    if name not in _MODELS:
        raise UsageError(
            "model-unknown",
            "There is no such model.",
            remedy="Choose one of the expected names.",
            got=name,
            expected=", ".join(_MODELS),
        )
    return _MODELS[name]


def make(name: str, *, seed: int = 0, device: str = "cpu", **settings: Any) -> Regressor:
    """An unfitted estimator; the same name, seed and settings give the same predictions.

    ``device`` is ``"cpu"`` or ``"cuda"``; models without torch run on the CPU whatever
    it says. ``settings`` override the estimator's own parameters.

    Raises:
        UsageError: the name is unknown, or its optional dependency is not installed.
    """
    entry = spec(name)
    if not entry.available:
        raise UsageError(
            "model-not-installed",
            f"The model needs the package {entry.extra}, which is not installed.",
            remedy='Install it with: pip install "kiribench[boosting]", or leave the model out.',
            got=name,
        )
    return entry.factory(seed=seed, device=device, **settings)


def _gp(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.gp import PaperGP

    return PaperGP(random_state=seed, device=device, **settings)


def _gp_paper(*, seed: int, device: str, **settings: Any) -> Regressor:
    raw = {"input_scaling": "none", "centre_targets": False}
    return _gp(seed=seed, device=device, **(raw | settings))


def _gp_shared(*, seed: int, device: str, **settings: Any) -> Regressor:
    return _gp(seed=seed, device=device, **({"shared_sigma": True} | settings))


def _gp_kronecker(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.gp_kronecker import KroneckerGP

    return KroneckerGP(random_state=seed, device=device, **settings)


def _svgp(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.svgp import SparseVariationalGP

    return SparseVariationalGP(random_state=seed, device=device, **settings)


def _gradient_boosting(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.gradient_boosting import GradientBoosting

    return GradientBoosting(random_state=seed, **settings)


def _gradient_boosting_paper(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.gradient_boosting import PAPER_GUESS

    return _gradient_boosting(seed=seed, device=device, **(PAPER_GUESS | settings))


def _random_forest(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.random_forest import RandomForest

    return RandomForest(random_state=seed, **settings)


def _random_forest_paper(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.random_forest import PAPER_GUESS

    return _random_forest(seed=seed, device=device, **(PAPER_GUESS | settings))


def _polynomial(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.polynomial import Polynomial

    return Polynomial(**settings)


def _hist_gradient_boosting(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.hist_gradient_boosting import HistGradientBoosting

    return HistGradientBoosting(random_state=seed, **settings)


def _light_gbm(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.light_gbm import LightGBM

    return LightGBM(random_state=seed, **settings)


def _rbf(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.rbf import RadialBasis

    return RadialBasis(**settings)


def _mlp_ensemble(*, seed: int, device: str, **settings: Any) -> Regressor:
    from kiribench.surrogate.mlp_ensemble import MLPEnsemble

    return MLPEnsemble(random_state=seed, device=device, **settings)


_ROWS = (
    ModelSpec(
        name="gp",
        title="GP (paper's kernel)",
        description="Exact GP, one Gaussian kernel with a single length scale over inputs "
        "scaled to their range; maximum likelihood, float64, Cholesky.",
        has_uncertainty=True,
        is_gp=True,
        in_paper=True,
        factory=_gp,
        guessed="input scaling, maximum likelihood",
    ),
    ModelSpec(
        name="gp:paper",
        title="GP (equations to the letter)",
        description="The same kernel on the columns as the table has them, zero mean; the "
        "likelier of two optima.",
        has_uncertainty=True,
        is_gp=True,
        in_paper=True,
        factory=_gp_paper,
        guessed="inputs unscaled (percent, percent, fraction), maximum likelihood",
    ),
    ModelSpec(
        name="gp:shared-sigma",
        title="GP (one sigma for eqs 2 and 3)",
        description="Equations 2 and 3 read with one sigma_n: noise variance equal to signal "
        "variance.",
        has_uncertainty=True,
        is_gp=True,
        in_paper=True,
        factory=_gp_shared,
        guessed="that sigma_n in the two equations is one number",
    ),
    ModelSpec(
        name="gp_kronecker",
        title="GP (Kronecker, ARD)",
        description="Exact GP with a product kernel over designs and strains: Matern 7/2 over a, b "
        "and the angle about the corner (0, 100) %, Gaussian over strain; an error that a "
        "curve's rows share; warp and spread chosen by left-out designs.",
        has_uncertainty=True,
        is_gp=True,
        in_paper=False,
        factory=_gp_kronecker,
    ),
    ModelSpec(
        name="svgp",
        title="Sparse variational GP",
        description="Sparse variational GP with inducing points, for scattered rows.",
        has_uncertainty=True,
        is_gp=True,
        in_paper=False,
        factory=_svgp,
    ),
    ModelSpec(
        name="gradient_boosting",
        title="Gradient boosting",
        description="scikit-learn's gradient boosting, deep enough to fit.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=True,
        factory=_gradient_boosting,
    ),
    ModelSpec(
        name="gradient_boosting:paper",
        title="Gradient boosting (guess)",
        description="scikit-learn's gradient boosting with few shallow trees: lower, though "
        "not as low as table 1.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=True,
        factory=_gradient_boosting_paper,
        guessed="all settings",
    ),
    ModelSpec(
        name="random_forest",
        title="Random forest",
        description="scikit-learn's random forest, fully grown trees.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=True,
        factory=_random_forest,
    ),
    ModelSpec(
        name="random_forest:paper",
        title="Random forest (guess)",
        description="scikit-learn's random forest with trees of two levels: lower, though not "
        "as low as table 1.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=True,
        factory=_random_forest_paper,
        guessed="all settings",
    ),
    ModelSpec(
        name="polynomial",
        title="Cubic polynomial",
        description="Least squares on all monomials up to degree 3, as the paper says.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=True,
        factory=_polynomial,
    ),
    ModelSpec(
        name="hist_gradient_boosting",
        title="Histogram boosting",
        description="scikit-learn's histogram gradient boosting.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=False,
        factory=_hist_gradient_boosting,
    ),
    ModelSpec(
        name="lightgbm",
        title="LightGBM",
        description="LightGBM's regressor, deterministic mode.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=False,
        factory=_light_gbm,
        extra="lightgbm",
    ),
    ModelSpec(
        name="rbf",
        title="Radial basis functions",
        description="scipy's RBFInterpolator on inputs scaled to their range.",
        has_uncertainty=False,
        is_gp=False,
        in_paper=False,
        factory=_rbf,
    ),
    ModelSpec(
        name="mlp_ensemble",
        title="MLP ensemble",
        description="An ensemble of small torch networks; the spread is its uncertainty.",
        has_uncertainty=True,
        is_gp=False,
        in_paper=False,
        factory=_mlp_ensemble,
    ),
)

_MODELS = {row.name: row for row in _ROWS}
