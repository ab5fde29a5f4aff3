"""A tension test: stretch and nominal stress, and where they come from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.errors import Fault, UsageError

FloatArray = npt.NDArray[np.float64]

StrainSource = Literal["crosshead", "extensometer", "camera", "unknown"]

STRAIN_SOURCE_WORDS = {
    "crosshead": "crosshead: the machine's travel over the sample's length. It counts slip in the "
    "grips and the stretch of what lies between them, so it is not the strain of the material",
    "extensometer": "extensometer: measured on the sample",
    "camera": "camera: measured on the sample",
    "unknown": "not stated; it is treated as crosshead strain",
}


@dataclass(frozen=True)
class Sample:
    """Undeformed sizes of the sample, mm; None where they are not known.

    Attributes:
        length_mm: gauge length, or the length between the grips.
        width_mm, thickness_mm: of the cross-section.
    """

    length_mm: float | None = None
    width_mm: float | None = None
    thickness_mm: float | None = None

    @property
    def area_mm2(self) -> float | None:
        """Area of the cross-section, mm^2."""
        if self.width_mm is None or self.thickness_mm is None:
            return None
        return self.width_mm * self.thickness_mm


@dataclass(frozen=True, eq=False)
class TensileCurve:
    """One pull of one sample, from small strain on; n rows, strain grows.

    Attributes:
        stretch: (n,) length / undeformed length.
        stress_mpa: (n,) nominal (engineering) stress: force / undeformed area, MPa.
        source: what the strain was measured by.
        sample: sizes of the sample.
        file: where it was read from, None where it was computed.
        columns: the columns of the file that were used.
        header: what the lines before the table say.
        line: (n,) line of the file of each row, from 1.
        notes: what was left out or concluded, as warnings.
    """

    stretch: FloatArray
    stress_mpa: FloatArray
    source: StrainSource = "unknown"
    sample: Sample = Sample()
    file: Path | None = None
    columns: tuple[str, ...] = ()
    header: tuple[tuple[str, str], ...] = ()
    line: tuple[int, ...] = ()
    notes: tuple[Fault, ...] = ()

    @property
    def strain(self) -> FloatArray:
        """(n,) engineering strain."""
        return self.stretch - 1

    @property
    def noise_mpa(self) -> float:
        """Standard deviation of a stress, MPa, from third differences: what is not smooth."""
        if len(self.stretch) < 8:
            return float("nan")
        return float(np.sqrt(np.mean(np.diff(self.stress_mpa, 3) ** 2) / 20))


@dataclass(frozen=True)
class StrainRange:
    """The part of a test that a fit uses: engineering strain, both ends included."""

    low: float = 0.0
    high: float = 1.0

    @classmethod
    def parse(cls, text: str) -> StrainRange:
        """``0:1``, or ``1`` for 0 to 1; percent with the sign, such as ``0:190%``.

        Raises:
            UsageError: not of that form, or not 0 <= low < high.
        """
        percent = text.strip().endswith("%")
        parts = text.strip().rstrip("%").split(":")
        try:
            numbers = [float(part.strip().rstrip("%")) for part in parts]
        except ValueError:
            numbers = []
        if len(numbers) == 1:
            numbers.insert(0, 0.0)
        scale = 100.0 if percent else 1.0
        if len(numbers) != 2 or not 0 <= numbers[0] < numbers[1] < np.inf:
            raise UsageError(
                "strain-range",
                "The strain range cannot be understood.",
                remedy="Give engineering strains low:high, such as 0:1 or 0:190%.",
                got=text,
            )
        return cls(numbers[0] / scale, numbers[1] / scale)

    def rows(self, strain: FloatArray) -> npt.NDArray[np.bool_]:
        """(n,) which of the strains (n,) lie in the range."""
        return (strain >= self.low) & (strain <= self.high)

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"
