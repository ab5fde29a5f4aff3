"""What a laser and a thin sheet can hold: bounds on the cut lengths, in every method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from kiribench.errors import UsageError
from kiribench.lattice import longest_cut


@dataclass(frozen=True)
class Limits:
    """Manufacturing limits of a patch.

    All half-cuts are means of the cut lengths of the cells that they touch, so a bound on every
    cell's a and b is a bound on every half-cut: nothing else is needed for the ligaments.

    Attributes:
        ligament_mm: least width of the sheet that must stay between two cuts, mm.
        kerf_mm: width that the laser burns away, mm.
        longest_percent: longest cut, percent of the cell edge (90 in the paper).
    """

    ligament_mm: float = 0.5
    kerf_mm: float = 0.2
    longest_percent: float = 90.0

    def __post_init__(self) -> None:
        for name, value, high in (
            ("ligament_mm", self.ligament_mm, np.inf),
            ("kerf_mm", self.kerf_mm, np.inf),
            ("longest_percent", self.longest_percent, 100.0),
        ):
            if not (np.isfinite(value) and 0.0 <= value < high):
                raise UsageError(
                    "limit-range",
                    f"The limit {name} is out of range.",
                    remedy="Give millimetres, and percent of the cell edge below 100.",
                    got=value,
                    expected=f"0 <= {name}" + ("" if high == np.inf else f" < {high:g}"),
                )

        # A share where percent are asked for: nobody cuts slits of less than 1 % of a cell.
        if 0 < self.longest_percent <= 1:
            raise UsageError(
                "limit-percent",
                f"The longest cut is given in percent: {self.longest_percent:g} means "
                f"{self.longest_percent:g} % of the cell edge.",
                remedy=f"Did you mean {100 * self.longest_percent:g}?"
                if self.longest_percent < 1
                else "Give percent, such as 90.",
                got=self.longest_percent,
                expected="more than 1, less than 100 (percent)",
            )

    def longest(self, cell_mm: float) -> float:
        """Longest allowed cut / cell edge.

        The smaller of ``longest_percent`` and 1 - (2 ligament + kerf) / cell
        (:func:`kiribench.lattice.longest_cut`).

        Raises:
            UsageError: no cut at all is allowed.
        """
        longest = min(
            self.longest_percent / 100, longest_cut(cell_mm, self.ligament_mm, self.kerf_mm)
        )
        if longest <= 0:
            raise UsageError(
                "limits-leave-nothing",
                "With these limits no cut is allowed.",
                remedy="Use a smaller ligament or kerf, larger cells, or a longer longest cut.",
                got=f"ligament {self.ligament_mm:g} mm, kerf {self.kerf_mm:g} mm, cell "
                f"{cell_mm:g} mm, longest {self.longest_percent:g} %",
            )
        return longest

    def as_dict(self, cell_mm: float) -> dict[str, Any]:
        """The limits for a sidecar, with the bound that they come to."""
        return {
            "LigamentMm": self.ligament_mm,
            "KerfMm": self.kerf_mm,
            "LongestPercent": self.longest_percent,
            "BoundPercent": 100 * self.longest(cell_mm),
        }
