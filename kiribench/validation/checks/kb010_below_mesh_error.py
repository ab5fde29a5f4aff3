"""KB010: scores below the simulation's own error."""

from __future__ import annotations

from kiribench.validation.checks.check import Check, Evidence, Found, fired, not_applicable, passed


def look(evidence: Evidence) -> Found:
    """Fires where a model's error under grouped folds is smaller than the table's mesh error."""
    unit = evidence.table.mesh_error_rms
    if unit is None:
        return not_applicable("The table has no mesh error.")
    below = {
        name: one.scores["rmse"].pooled
        for name, one in evidence.summaries.get("grouped", {}).items()
        if one.scores["rmse"].pooled is not None and one.scores["rmse"].pooled < unit
    }
    if not below:
        return passed(f"No model's error is below the mesh error of {unit:.2g} rms.")
    listed = ", ".join(f"{name} ({value / unit:.2f})" for name, value in below.items() if value)
    return fired(
        f"In units of the mesh error ({unit:.2g} rms): {listed}. Among these, differences are "
        "about reproducing the simulation, not about the sheet."
    )


CHECK = Check(
    "KB010",
    "Score below the mesh error",
    "note",
    "Refine the simulation before looking for a better surrogate.",
    look,
)
