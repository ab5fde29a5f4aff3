"""Settings of the design methods, each with its unit and its default."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from kiribench.errors import UsageError

Prefer = Literal["least-cuts", "insensitive"]


@dataclass(frozen=True)
class DesignOptions:
    """How the methods of design work; what a method does not use, it ignores.

    Attributes:
        tolerance: ``exact`` takes the least cuts whose Poisson's ratio is within this of the
            target; a cell beyond it carries a reason.
        penalty: lambda of the paper's objective, Poisson's ratio squared per (fraction of the
            cell edge) squared; ``paper`` uses 1e-3 where None, ``exact`` then has none.
        prefer: among the equivalent designs of ``exact`` the one with the least cuts, or the
            one whose Poisson's ratio changes least with cutting errors.
        cut_error: standard deviation of a cut length, fraction of the cell edge (1 %).
        kerf_error_mm: standard deviation of the kerf, which lengthens all cuts alike, mm.
        force_sd: ``balanced``: log force of cells in series may differ by about this.
        neighbour_sd: ``balanced``: cut lengths of neighbours may differ by about this fraction.
        poisson_sd: ``balanced``: Poisson's ratio may miss its target by about this.
        seed: of CMA-ES.
        population: of CMA-ES; None is the library's 4 + floor(3 ln 2) = 6.
        max_generations: of CMA-ES.
        sigma: first step size of CMA-ES, fraction of the range.
        curves: keep the curve of all equivalent designs of every cell.
    """

    tolerance: float = 0.005
    penalty: float | None = None
    prefer: Prefer = "least-cuts"
    cut_error: float = 0.01
    kerf_error_mm: float = 0.05
    force_sd: float = 0.05
    neighbour_sd: float = 0.5
    poisson_sd: float = 0.01
    seed: int = 0
    population: int | None = None
    max_generations: int = 200
    sigma: float = 0.3
    curves: bool = False

    def __post_init__(self) -> None:
        for name in ("tolerance", "force_sd", "neighbour_sd", "poisson_sd", "sigma"):
            self._check(name, getattr(self, name), least=1e-6)
        for name in ("cut_error", "kerf_error_mm"):
            self._check(name, getattr(self, name), least=0.0)
        if self.penalty is not None:
            self._check("penalty", self.penalty, least=0.0)
        if self.penalty is not None and self.prefer == "insensitive":
            raise UsageError(
                "options-conflict",
                "A penalty on the cut lengths and insensitive designs exclude each other.",
                remedy="Leave --penalty or --prefer insensitive out.",
            )
        if self.max_generations < 1 or (self.population is not None and self.population < 4):
            raise UsageError(
                "option-range",
                "CMA-ES needs at least 1 generation and a population of 4.",
                remedy="Give larger numbers.",
                got=f"{self.max_generations} generations, population {self.population}",
            )

    @staticmethod
    def _check(name: str, value: float, *, least: float) -> None:
        if not (np.isfinite(value) and least <= value <= 10.0):
            raise UsageError(
                "option-range",
                f"The option {name} is out of range.",
                remedy="Give a small positive number; all of them are fractions or mm.",
                got=value,
                expected=f"{least:g} to 10",
            )

    def as_dict(self) -> dict[str, Any]:
        """For a sidecar."""
        return asdict(self)
