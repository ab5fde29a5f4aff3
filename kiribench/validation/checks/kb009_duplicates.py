"""KB009: duplicated designs."""

from __future__ import annotations

import numpy as np

from kiribench.validation.checks.check import Check, Evidence, Found, fired, passed


def look(evidence: Evidence) -> Found:
    """Fires where two designs have the same cuts, or two rows the same inputs."""
    table = evidence.table
    parts = []
    if table.space is not None:
        space = table.space
        cuts = np.zeros((len(space.design_names), 2))
        cuts[space.design] = np.column_stack([space.a_percent, space.b_percent])
        _, which, counts = np.unique(cuts, axis=0, return_inverse=True, return_counts=True)
        twice = np.flatnonzero(counts[which.ravel()] > 1)
        if len(twice):
            some = ", ".join(space.design_names[index] for index in twice[:4])
            parts.append(f"{len(twice)} designs share their cuts with another ({some})")
    _, first, counts = np.unique(table.X, axis=0, return_inverse=True, return_counts=True)
    repeated = counts[first.ravel()] > 1
    if repeated.any():
        group_of = first.ravel()[repeated]
        crossing = any(
            len(np.unique(table.group[repeated][group_of == one])) > 1
            for one in np.unique(group_of)
        )
        parts.append(
            f"{int(repeated.sum())} rows have the same inputs as another"
            + (f", also across {table.group_word}s" if crossing else "")
        )
    if not parts:
        return passed("Every design and every row is there once.")
    return fired(
        "; ".join(parts)
        + (". Designs with equal cuts are one group here, whatever their names."
           if table.space is not None else ".")
    )  # fmt: skip


CHECK = Check(
    "KB009",
    "Duplicated designs",
    "warning",
    "Remove the copies, or give them a common group.",
    look,
)
