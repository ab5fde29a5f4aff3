"""The surrogates that a design rests on, in one strain measure with its targets."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kiribench.design.problem import DesignProblem
from kiribench.errors import UsageError
from kiribench.surrogate.keep import load
from kiribench.surrogate.kept_model import KeptModel


@dataclass(frozen=True, eq=False)
class Surrogates:
    """Kept models of the same table.

    Attributes:
        poisson: of Poisson's ratio; its ``stress`` is the model of the secant modulus, or None.
        file: where it was read from, or None.
    """

    poisson: KeptModel
    file: Path | None = None

    @property
    def measure(self) -> str:
        """The strain measure of inputs and outputs."""
        return self.poisson.measure

    @classmethod
    def of(cls, path: Path) -> Surrogates:
        """Read a file of ``kiribench fit``.

        Raises:
            TableError, DataError: the file is missing, damaged or no model.
        """
        return cls(load(path), path)

    def as_dict(self) -> dict[str, Any]:
        """For a sidecar."""
        return {
            "File": None if self.file is None else self.file.name,
            "Model": self.poisson.name,
            "StrainMeasure": self.measure,
            "Strains": [float(self.poisson.low[2]), float(self.poisson.high[2])],
            "Rows": self.poisson.summary["rows"],
        }

    def check_measure(self, problem: DesignProblem) -> None:
        """Refuse targets in another strain measure.

        Raises:
            UsageError: ``strain-measure-mixed``.
        """
        if problem.strain_measure != self.measure:
            raise UsageError(
                "strain-measure-mixed",
                "The targets are in another strain measure than the surrogate. Poisson's ratio "
                "is a ratio of strains: the cell (90, 90) at stretch 2 has -0.34 in log and -0.27 "
                "in engineering strain, so the cuts would be wrong without any other sign of it.",
                remedy=f"Measure again with --strain-measure {self.measure}, fit the surrogate "
                f"with --strain-measure {problem.strain_measure}, or give --convert-measure to "
                "recompute the targets from their stretches.",
                got=f"targets in {problem.strain_measure} strain",
                expected=f"{self.measure} strain",
            )
