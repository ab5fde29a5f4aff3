"""A load path: what a simulated specimen does from rest to its last load step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.errors import NotConvergedError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

StrainMeasure = Literal["log", "engineering", "green"]

OVERLAP_FLAG_MM = 0.1
"""Crack faces that pass through each other by more than this are flagged."""


def strain_of(stretch: FloatArray, measure: StrainMeasure) -> FloatArray:
    """Strain (a fraction, any shape) of a stretch (length ratio, same shape) in a named measure."""
    if measure == "log":
        return np.log(stretch)
    if measure == "engineering":
        return np.asarray(stretch - 1.0)
    if measure == "green":
        return np.asarray(0.5 * (stretch * stretch - 1.0))
    raise ValueError(f"unknown strain measure {measure!r}; use 'log', 'engineering' or 'green'")


def poisson_ratio(
    longitudinal_stretch: FloatArray, lateral_stretch: FloatArray, measure: StrainMeasure = "log"
) -> FloatArray:
    """Poisson's ratio (same shape as the stretches), both strains in one named measure."""
    return np.asarray(
        -strain_of(lateral_stretch, measure) / strain_of(longitudinal_stretch, measure)
    )


@dataclass(frozen=True, eq=False)
class LoadPath:
    """What one specimen does at each requested load step; n steps, in the order requested.

    A step that was not reached has status ``"not-converged"`` (the step that failed) or
    ``"not-reached"`` (every later one) and NaN in the float columns; ``reason`` then says why.

    Attributes:
        displacement_mm: (n,) displacement of the pulled end against the fixed one, mm. For a
            periodic cell: of one cell, ``(longitudinal_stretch - 1) * cell_mm``.
        longitudinal_stretch: (n,) along the pull, length ratio of the gauge cells.
        lateral_stretch: (n,) across the pull, length ratio of the gauge cells.
        nominal_stress_mpa: (n,) pulling force / undeformed width and thickness, MPa.
        energy_mpa: (n,) stored elastic energy / undeformed volume of the model, MPa (mJ/mm^3).
        face_overlap_mm: (n,) largest depth to which two crack faces interpenetrate, mm.
        newton_iterations: (n,) Newton iterations spent on the step, its substeps included.
        status: n strings, ``"ok"``, ``"not-converged"`` or ``"not-reached"``.
        mesh_error_poisson: (n,) estimate of the mesh error of Poisson's ratio (log measure).
            Cell: the change of nu against a mesh twice as coarse, at equal stretch. Sheet: the
            change of nu of the periodic cell between the sheet's facet mesh and one 2.5 times
            as fine, at the gauge's longitudinal stretch. NaN when no estimate was asked for, or
            where the other mesh has no answer.
        reason: why the path ended early; None where every step converged.
        degrees_of_freedom: unknowns of the (fine) mesh.
        cpu_seconds: processor time of the whole call.
    """

    displacement_mm: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    nominal_stress_mpa: FloatArray
    energy_mpa: FloatArray
    face_overlap_mm: FloatArray
    newton_iterations: IntArray
    status: tuple[str, ...]
    mesh_error_poisson: FloatArray
    reason: str | None = None
    degrees_of_freedom: int = 0
    cpu_seconds: float = 0.0

    @property
    def converged(self) -> npt.NDArray[np.bool_]:
        """(n,) True where the step has an answer."""
        return np.array([status == "ok" for status in self.status])

    @property
    def faces_overlap(self) -> npt.NDArray[np.bool_]:
        """(n,) True where crack faces interpenetrate by more than ``OVERLAP_FLAG_MM``."""
        return self.converged & (np.nan_to_num(self.face_overlap_mm) > OVERLAP_FLAG_MM)

    def strain(self, measure: StrainMeasure = "log") -> FloatArray:
        """(n,) longitudinal strain, a fraction in the named measure."""
        return strain_of(self.longitudinal_stretch, measure)

    def lateral_strain(self, measure: StrainMeasure = "log") -> FloatArray:
        """(n,) lateral strain, a fraction in the named measure."""
        return strain_of(self.lateral_stretch, measure)

    def poisson(self, measure: StrainMeasure = "log") -> FloatArray:
        """(n,) Poisson's ratio, both strains in the named measure."""
        return poisson_ratio(self.longitudinal_stretch, self.lateral_stretch, measure)

    def require_converged(self) -> LoadPath:
        """This load path, if every step converged.

        Raises:
            NotConvergedError: some step did not; use more, smaller steps or a coarser mesh.
        """
        if self.reason is not None:
            failed = self.status.index("not-converged")
            raise NotConvergedError(
                "fem-not-converged",
                f"The load path ended at step {failed + 1} of {len(self.status)}: {self.reason}",
                remedy="Ask for smaller steps, or for a coarser mesh; the steps before this one "
                "are valid.",
            )
        return self
