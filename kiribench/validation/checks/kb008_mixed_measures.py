"""KB008: strain measures mixed."""

from __future__ import annotations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

UNCUT_PERCENT = 10.0
FAR_STRAIN = 0.2
CLEARLY = 4.0  # how many times better another measure must fit
LEAST_RMS = 0.01


def uncut_poisson(strain: np.ndarray, measure: str) -> np.ndarray:
    """Poisson's ratio of an uncut incompressible sheet under uniaxial stress, any strain array.

    The lateral stretch is ``1 / sqrt(longitudinal stretch)``; both strains in ``measure``.
    """
    if measure == "log":
        return np.full_like(strain, 0.5)
    if measure == "engineering":
        return np.asarray(-((1.0 + strain) ** -0.5 - 1.0) / strain)
    stretch = np.sqrt(1.0 + 2.0 * strain)
    # (stretch_lateral^2 - 1) / 2 with stretch_lateral^2 = 1 / stretch.
    return np.asarray(-0.5 * (1.0 / stretch - 1.0) / strain)


def look(evidence: Evidence) -> Found:
    """Fires where wanted targets have another measure, or the table belies its own.

    An uncut sheet of rubber is incompressible, so its curve betrays the measure: .5 at every
    strain in log strains, falling in the others.
    """
    table, wanted = evidence.table, evidence.wanted
    if not table.is_design_space or table.measure is None:
        return not_applicable("The table is no design space: it has no strain measure.")
    if wanted is not None and wanted.measure not in (None, table.measure):
        return fired(
            f"The table is in {table.measure} strain, the wanted targets ({wanted.source}) in "
            f"{wanted.measure} strain.",
        )
    a, b, strain = table.X.T
    rows = (np.maximum(a, b) <= UNCUT_PERCENT) & (strain >= FAR_STRAIN)
    if not rows.any():
        return not_applicable(
            f"No design with cuts of at most {UNCUT_PERCENT:g} % reaches a strain of "
            f"{FAR_STRAIN:g}: the numbers cannot be tested."
        )
    least = np.maximum(a, b) == np.maximum(a, b)[rows].min()
    rows &= least
    misfit = {
        measure: float(
            np.sqrt(np.mean((table.y[rows] - uncut_poisson(strain[rows], measure)) ** 2))
        )
        for measure in ("log", "engineering", "green")
    }
    best = min(misfit, key=lambda measure: misfit[measure])
    own = misfit[table.measure]
    shown = ", ".join(f"{name} {value:.3f}" for name, value in misfit.items())
    if best != table.measure and own > LEAST_RMS and own > CLEARLY * misfit[best]:
        return fired(
            f"The table says {table.measure}, but its least cut design behaves as an uncut sheet "
            f"in {best} strain (rms misfit: {shown})."
        )
    return passed(f"Declared {table.measure}; rms misfit of the least cut design: {shown}.")


CHECK = Check(
    "KB008",
    "Strain measures mixed",
    "error",
    "Use one measure on both sides: declare the right one, or compute both from stretches.",
    look,
)
