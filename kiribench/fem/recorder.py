"""Collects the states of a load path, converged or not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import isfinite

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
        state = read(outcome.x)
        values = {name: float(getattr(state, name)) for name in self._columns}
        odd = [name for name, value in values.items() if not isfinite(value)]
        if odd:
            self._status[at] = "not-converged"
            self._reason = f"the state found has no finite {', '.join(odd)}"
            return False
        self._status[at] = "ok"
        for name, column in self._columns.items():
            column[at] = values[name]
        return True

    def path(self) -> LoadPath:
        """The load path so far; the mesh error is not known yet."""
        columns = self._columns
        return LoadPath(
            displacement_mm=columns["displacement_mm"],
            longitudinal_stretch=columns["longitudinal_stretch"],
            lateral_stretch=columns["lateral_stretch"],
            nominal_stress_mpa=columns["nominal_stress_mpa"],
            energy_mpa=columns["energy_mpa"],
            face_overlap_mm=columns["face_overlap_mm"],
            newton_iterations=self._iterations,
            status=tuple(self._status),
            mesh_error_poisson=np.full(len(self._status), np.nan),
            reason=self._reason,
            degrees_of_freedom=self._size,
        )


def with_mesh_error(
    path: LoadPath, one: LoadPath | None, two: LoadPath | None, cpu_seconds: float
) -> LoadPath:
    """The path with its cost and its mesh error: the change of nu (log) between two paths.

    The two paths have the steps of the converged part of ``path``; where either has no answer,
    the error is not known (NaN).
    """
    error = path.mesh_error_poisson.copy()
    if one is not None and two is not None:
        error[path.converged] = np.abs(one.poisson() - two.poisson())
    return replace(path, mesh_error_poisson=error, cpu_seconds=cpu_seconds)
