"""What a cross-validation is asked to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from kiribench.errors import UsageError

PAPER_FOUR = ("gp", "gradient_boosting", "random_forest", "polynomial")
COMPETITORS = (
    "gp_kronecker",
    "svgp",
    "hist_gradient_boosting",
    "lightgbm",
    "rbf",
    "mlp_ensemble",
)
# Other readings of the paper's words, cheap, and needed for the statement about its table 1.
READINGS = ("gp:shared-sigma", "gradient_boosting:paper", "random_forest:paper")
DEFAULT_MODELS = (*PAPER_FOUR, *COMPETITORS, *READINGS)
DEFAULT_BUDGET_S = 45.0


@dataclass(frozen=True)
class CvSettings:
    """All that the numbers depend on besides the table; what does not change them is not here.

    Attributes:
        models: names of the registry, or ``name:tuned``.
        protocols: names of :mod:`kiribench.validation.protocols`; all that apply if empty.
        folds: of the grouped, shuffled and contiguous protocols.
        repeats: of the grouped protocol, each with another division.
        seed: of divisions and models.
        device: ``cpu`` or ``cuda``.
        budget_s: a model skips a protocol that is expected to cost more CPU seconds than
            that (:mod:`kiribench.validation.cost`); 0 skips nothing.
    """

    models: tuple[str, ...] = DEFAULT_MODELS
    protocols: tuple[str, ...] = ()
    folds: int = 10
    repeats: int = 2
    seed: int = 0
    device: str = "cpu"
    budget_s: float = DEFAULT_BUDGET_S

    def check(self) -> None:
        """Refuse numbers that make no sense.

        Raises:
            UsageError: fewer than two folds, fewer than one repeat, a negative seed or budget.
        """
        for name, value, least in (
            ("folds", self.folds, 2),
            ("repeats", self.repeats, 1),
            ("seed", self.seed, 0),
            ("budget", self.budget_s, 0),
        ):
            if not value >= least:
                raise UsageError(
                    "cv-setting-range",
                    f"--{name} is too small.",
                    remedy=f"Give {least} or more.",
                    got=value,
                    expected=f"at least {least}",
                )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "models": list(self.models), "protocols": list(self.protocols)}
