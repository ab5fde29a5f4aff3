"""The observations of a pull, and what each cause would change in them, by the simulator itself."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from kiribench.reference.tensile_causes import Cause, Explanation, Observed
from kiribench.reference.tensile_simulation import (
    Amounts,
    Measured,
    Predicted,
    Simulator,
    Specimen,
)
from kiribench.tensile.result import TensileTest

FloatArray = npt.NDArray[np.float64]

FORCE_FLOOR = 0.003
"""Part of the largest force: what a load cell is trusted to."""


def residual_cells(measured: Measured, predicted: Predicted) -> FloatArray:
    """(T, k) log strain across, measured less simulated at the cell's own strain along."""
    away = measured.along - predicted.along
    return np.asarray(measured.across - predicted.across - predicted.slope * away)


def vector(measured: Measured, predicted: Predicted) -> tuple[FloatArray, FloatArray]:
    """Observations cell by cell (k, c), and the single ones (m - c,)."""
    parts = [residual_cells(measured, predicted)]
    if predicted.along_by_travel is not None:
        parts.append(measured.along - predicted.along_by_travel)
    single = np.empty(0)
    if measured.force_n is not None:
        single = (measured.force_n - predicted.force_n) / np.abs(measured.force_n).max()
    return np.concatenate(parts).T, single


def difference(measured: Measured, predicted: Predicted) -> FloatArray:
    """(m,) measured less predicted: means over cells, then the single observations."""
    cells, single = vector(measured, predicted)
    return np.concatenate([np.nanmean(cells, axis=0), single])


def observed_of(
    measured: Measured,
    best: Predicted,
    mesh: FloatArray,
    test: TensileTest,
    moved: FloatArray,
) -> Observed:
    """The observations, all of them more by ``moved`` (m,)."""
    cells, single = vector(measured, best)
    frames, inner = len(measured.frame), cells.shape[1]
    noise = FORCE_FLOOR
    if len(single) >= 6:
        noise = max(noise, float(np.sqrt(np.mean(np.diff(single, 3) ** 2) / 20)))
    return Observed(
        cells + moved[:inner],
        (frames,) * (inner // frames),
        single + moved[inner:],
        noise,
        mesh,
        test.strain_sd,
    )


@dataclass(frozen=True)
class Kind:
    """A cause before it is simulated: its field of Amounts, step and scale of the shown unit."""

    name: str
    family: str
    words: str
    unit: str
    plausible: float
    field: str
    step: float
    scale: float = 1.0


def kinds_of(specimen: Specimen, measured: Measured) -> list[Kind]:
    """Every cause that the test can see."""
    ends = "ends free to narrow instead of held" if specimen.ends == "held" else (
        "ends held instead of free to narrow"
    )  # fmt: skip
    found = [
        Kind("exponent", "material", "Ogden exponent of the law larger by", "", 1.0,
              "exponent", 0.6),
        Kind("ends", "boundary", f"{ends} (1 is wholly)", "", 0.5, "ends", 1.0),
        Kind("cut-a", "cut length", "cuts across the pull longer by", "% of the cell", 3.0,
              "longer_a", 0.01, 100.0),
        Kind("cut-b", "cut length", "cuts along the pull longer by", "% of the cell", 3.0,
              "longer_b", 0.01, 100.0),
    ]  # fmt: skip
    if measured.force_n is not None:
        found.insert(0, Kind(
            "stiffness", "material",
            "shear modulus (or thickness, or load cell: the same curve) larger by", "%", 30.0,
            "stiffness", 0.01, 100.0,
        ))  # fmt: skip
    if measured.displacement_mm is not None:
        found += [
            Kind("slip", "boundary", "displacement lost in the grips, in proportion", "%", 5.0,
                  "slip", 0.01, 100.0),
            Kind("slack", "boundary", "displacement before the sample is taut", "mm", 1.0,
                  "slack_mm", 0.2),
        ]  # fmt: skip
    return found


def causes_of(
    simulator: Simulator,
    specimen: Specimen,
    measured: Measured,
    at: Amounts,
    families: tuple[str, ...] | None = None,
) -> tuple[Cause, ...]:
    """The causes of some families (None is all) with their effects by finite differences."""
    base = difference(measured, simulator.predict(measured, at))
    found = []
    for kind in kinds_of(specimen, measured):
        if families is not None and kind.family not in families:
            continue
        now = float(getattr(at, kind.field))
        # A mixture of ends is between 0 and 1.
        step = -kind.step if kind.field == "ends" and now > 0.5 else kind.step
        if kind.field == "ends":
            step = 1.0 - now if step > 0 else -now
        changed = replace(at, **{kind.field: now + step})
        other = difference(measured, simulator.predict(measured, changed))
        found.append(
            Cause(
                kind.name, kind.family, kind.words, kind.unit, kind.plausible,
                (base - other) / (step * kind.scale),
            )
        )  # fmt: skip
    return tuple(found)


def amounts_of(found: Explanation, kinds: list[Kind]) -> Amounts:
    """The amounts of an explanation as the simulator takes them."""
    known = {kind.name: kind for kind in kinds}
    values = {}
    for one in found.amounts:
        kind = known[one.name]
        values[kind.field] = one.value / kind.scale
    if "ends" in values:
        values["ends"] = float(np.clip(values["ends"], 0.0, 1.0))
    if "stiffness" in values:
        values["stiffness"] = max(values["stiffness"], -0.95)
    return Amounts(**values)
