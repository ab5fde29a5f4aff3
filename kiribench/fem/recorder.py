"""Collects the states of a load path, converged or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from kiribench.fem.equilibrium import Failed, Solved
from kiribench.fem.loadpath import LoadPath

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """What is read off one equilibrium; the fields are those of ``LoadPath``."""

    displacement_mm: float
    longitudinal_stretch: float
    lateral_stretch: float
    nominal_stress_mpa: float
    energy_mpa: float
    face_overlap_mm: float


class Recorder:
    """Takes the outcomes of the load steps one by one and gives the load path.

    Args:
        steps: how many steps were asked for.
        degrees_of_freedom: unknowns of the model.
    """

    def __init__(self, steps: int, degrees_of_freedom: int) -> None:
        self._columns = {field.name: np.full(steps, np.nan) for field in fields(State)}
        self._iterations = np.zeros(steps, dtype=np.int64)
        self._status = ["not-reached"] * steps
        self._size = degrees_of_freedom
        self._next = 0
        self._reason: str | None = None

    def record(self, outcome: Solved | Failed, read: Callable[[FloatArray], State]) -> bool:
        """Note one outcome; False where the path ends here."""
        at = self._next
        self._next += 1
        self._iterations[at] = outcome.iterations
        if isinstance(outcome, Failed):
            self._status[at] = "not-converged"
            self._reason = outcome.reason
            return False
        self._status[at] = "ok"
        state = read(outcome.x)
        for name, column in self._columns.items():
            column[at] = getattr(state, name)
        return True

    def path(self) -> LoadPath:
        """The load path so far; the mesh error is not known yet."""
        return LoadPath(
            **self._columns,
            newton_iterations=self._iterations,
            status=tuple(self._status),
            mesh_error_poisson=np.full(len(self._status), np.nan),
            reason=self._reason,
            degrees_of_freedom=self._size,
        )


def with_mesh_error(path: LoadPath, coarse: LoadPath | None, cpu_seconds: float) -> LoadPath:
    """The path with its mesh error: the change of nu (log) against a coarser mesh.

    The coarser path is compared at equal longitudinal stretch, by a cubic through its states;
    beyond its last state the error is not known (NaN).
    """
    error = path.mesh_error_poisson
    if coarse is not None:
        both = coarse.converged
        known = path.converged
        at = path.strain()[known]
        other = coarse.strain()[both]
        if both.sum() and np.array_equal(at[: both.sum()], other):
            value = coarse.poisson()[both]
            found = np.full(len(at), np.nan)
            found[: len(value)] = value[: len(at)]
        elif both.sum() >= 4:
            from scipy.interpolate import CubicSpline

            spline = CubicSpline(
                np.append(0.0, other), np.append(0.0, coarse.lateral_strain()[both])
            )
            found = -spline(at) / at
            found[at > other[-1] * 1.02] = np.nan
        else:
            found = np.full(len(at), np.nan)
        error = np.full(len(path.status), np.nan)
        error[known] = np.abs(found - path.poisson()[known])
    return replace(path, mesh_error_poisson=error, cpu_seconds=cpu_seconds)
