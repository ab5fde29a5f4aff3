"""KB007: wanted targets that no simulated design reaches."""

from __future__ import annotations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed

SLACK = 0.02  # of Poisson's ratio: between two simulated designs there are others


def look(evidence: Evidence) -> Found:
    """Fires where a wanted (strain, Poisson's ratio) lies outside the table's own reach."""
    table, wanted = evidence.table, evidence.wanted
    if wanted is None or not table.is_design_space:
        return not_applicable("No wanted targets were given (--targets).")
    strain = table.X[:, 2]
    beyond = (wanted.longitudinal_strain < strain.min()) | (
        wanted.longitudinal_strain > strain.max()
    )
    low, high = reach(table.group, strain, table.y, wanted.longitudinal_strain)
    outside = ~beyond & ~(
        (wanted.poisson_ratio >= low - SLACK) & (wanted.poisson_ratio <= high + SLACK)
    )
    count = len(wanted.poisson_ratio)
    if not beyond.any() and not outside.any():
        return passed(f"All {count} wanted targets lie within the simulated range.")
    parts = []
    if beyond.any():
        parts.append(
            f"{int(beyond.sum())} of {count} wanted strains lie outside "
            f"{strain.min():.3g} to {strain.max():.3g}"
        )
    if outside.any():
        gap = np.maximum(low - wanted.poisson_ratio, wanted.poisson_ratio - high)[outside]
        parts.append(
            f"{int(outside.sum())} of {count} wanted Poisson's ratios are out of every design's "
            f"reach at their strain, by up to {float(np.nanmax(gap)):.2f}"
        )
    return fired("; ".join(parts) + ".")


def reach(
    group: np.ndarray, strain: np.ndarray, poisson: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest Poisson's ratio of all designs at each strain of ``at`` (k,).

    Each design's curve is interpolated linearly and never extrapolated; NaN where no design
    reaches the strain.
    """
    low, high = np.full(len(at), np.nan), np.full(len(at), np.nan)
    order = np.lexsort((strain, group))
    for rows in np.split(order, np.cumsum(np.bincount(group))[:-1]):
        values = np.interp(at, strain[rows], poisson[rows], left=np.nan, right=np.nan)
        low, high = np.fmin(low, values), np.fmax(high, values)
    return low, high


CHECK = Check(
    "KB007",
    "Wanted targets beyond the data",
    "warning",
    "Simulate larger strains or other cuts, or accept the nearest reachable target.",
    look,
)
