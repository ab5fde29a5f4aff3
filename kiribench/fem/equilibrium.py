"""Load stepping: prediction, Newton's method with an energy line search, step halving."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_SMALLEST_STEP = 1.0 / 256
"""A requested step is halved at most this far."""
_MOST_ITERATIONS = 40
_STALE_BELOW = 1e-4
"""Below this energy error (of the stored energy) the last factorisation is used again."""
_SHORT = 0.2
"""A line search that cuts a Newton step below this part makes the tangent positive instead."""


class System(Protocol):
    """The discrete equations of one model."""

    points_mm: FloatArray
    equation: IntArray
    size: int

    def energy(self, x: FloatArray) -> float:
        """Elastic energy per thickness at deformed nodes (n, 2); inf where folded."""

    def forces(self, x: FloatArray) -> FloatArray:
        """(n, 2) internal nodal forces."""

    def reduce(self, force: FloatArray) -> FloatArray:
        """(size,) residual of the free equations."""

    def linearise(self, x: FloatArray, *, projected: bool = False) -> FloatArray:
        """Factorise the tangent at x, made positive if ``projected``; the residual (size,)."""

    def solve(self, residual: FloatArray) -> FloatArray:
        """(size,) solution with the last factorised tangent."""


@dataclass(frozen=True, eq=False)
class Solved:
    """Equilibrium at one load: deformed nodes, iterations spent, factorisations among them."""

    x: FloatArray
    iterations: int
    factorisations: int


@dataclass(frozen=True, eq=False)
class Failed:
    """No equilibrium found, and why."""

    reason: str
    iterations: int
    factorisations: int


@dataclass
class _Newton:
    """One attempt after another to reach a load; counts what they cost."""

    system: System
    tolerance: float
    iterations: int = 0
    factorisations: int = 0
    reason: str = ""

    def expand(self, free: FloatArray) -> FloatArray:
        """(n, 2) displacements of the nodes from those of the equations; prescribed ones 0."""
        return np.where(self.system.equation >= 0, free[self.system.equation], 0.0)

    def relax(self, x: FloatArray) -> FloatArray | None:
        """Minimise the energy from x, whose prescribed displacements are those of the load."""
        system = self.system
        energy = system.energy(x)
        if not np.isfinite(energy):
            self.reason = "an element is folded at the start of the step"
            return None
        reuse = projected = False
        error = np.inf
        for _ in range(_MOST_ITERATIONS):
            self.iterations += 1
            if reuse and error < _STALE_BELOW:
                residual = system.reduce(system.forces(x))
            else:
                residual = self._linearise(x, projected)
                projected = False
            free = -system.solve(residual)
            if not np.isfinite(free).all():
                self.reason = "the tangent is singular"
                return None
            move, slope = self.expand(free), float(residual @ free)
            error_before, error = error, abs(slope) / max(energy, 1e-300)
            if error < self.tolerance and slope <= 0:
                return x + move
            length, found = self._search(x, move, energy, slope, error)
            if length < _SHORT:
                # The tangent has a negative direction here; its positive part points downhill,
                # too timidly where the sheet snaps, so that step may also be lengthened.
                self._linearise(x, True)
                free = -system.solve(residual)
                other, slope = self.expand(free), float(residual @ free)
                far, lower = self._search(x, other, energy, slope, error)
                far, lower = self._lengthen(x, other, far, lower)
                if far > 0.0 and (length == 0.0 or lower < found):
                    move, length, found = other, far, lower
                    projected = far > 1.0
                error = max(error, abs(slope) / max(energy, 1e-300))
            if length == 0.0:
                self.reason = "the line search found no lower energy"
                return None
            x, energy = x + length * move, found
            reuse = length == 1.0 and error < 0.01 * error_before
        self.reason = f"no convergence in {_MOST_ITERATIONS} iterations"
        return None

    def _linearise(self, x: FloatArray, projected: bool) -> FloatArray:
        self.factorisations += 1
        return self.system.linearise(x, projected=projected)

    def _search(
        self, x: FloatArray, move: FloatArray, energy: float, slope: float, error: float
    ) -> tuple[float, float]:
        """Part of the step that lowers the energy enough, and that energy; 0 if none does."""
        if not slope <= 0:
            return 0.0, energy
        length = 1.0
        while length > 1e-3:
            found = self.system.energy(x + length * move)
            # Near the answer the decrease drowns in rounding.
            if found <= energy + 1e-4 * length * slope or (error < 1e-9 and np.isfinite(found)):
                return length, found
            length *= 0.5
        return 0.0, energy

    def _lengthen(
        self, x: FloatArray, move: FloatArray, length: float, energy: float
    ) -> tuple[float, float]:
        """The step doubled as long as that lowers the energy, at most to 64 times."""
        while 1.0 <= length < 64.0:
            further = self.system.energy(x + 2 * length * move)
            if not further < energy:
                break
            length, energy = 2 * length, further
        return length, energy


@dataclass
class LoadStepper:
    """Follows the equilibrium of a model while its load grows.

    Attributes:
        system: the equations.
        pattern: (n, 2) prescribed displacement per unit load, mm; zero where free.
        tolerance: energy error of the last Newton step / stored energy. That step is still
            taken, so the error left is far smaller.
    """

    system: System
    pattern: FloatArray
    tolerance: float = 1e-9
    _history: list[tuple[float, FloatArray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._history = [(0.0, self.system.points_mm.copy())]

    def advance(self, load: float) -> Solved | Failed:
        """Go on to ``load``; halves the step where Newton's method fails."""
        newton = _Newton(self.system, self.tolerance)
        start, x = self._history[-1]
        step = load - start
        smallest = abs(step) * _SMALLEST_STEP
        while abs(load - start) > 1e-12 * max(1.0, abs(load)):
            target = load if abs(step) >= abs(load - start) * (1 - 1e-9) else start + step
            found = None
            for guess in self._guesses(target, newton):
                found = newton.relax(guess)
                if found is not None:
                    break
            if found is None:
                step = 0.5 * (target - start)
                if abs(step) < smallest:
                    return Failed(
                        f"{newton.reason} at load {target:.6g} after {newton.iterations} "
                        f"iterations, the step halved to {step:.2g}",
                        newton.iterations,
                        newton.factorisations,
                    )
                continue
            start, x = target, found
            self._history = [*self._history[-3:], (start, x)]
            step = min(abs(2 * step), abs(load - start)) * np.sign(step)
        return Solved(x, newton.iterations, newton.factorisations)

    def _guesses(self, load: float, newton: _Newton) -> Iterator[FloatArray]:
        """Starting points, the best first: extrapolation of the path, then its tangent."""
        if len(self._history) > 1:
            yield self.extrapolate(load)
        yield self.follow_tangent(load, newton)

    def extrapolate(self, load: float) -> FloatArray:
        """(n, 2) the polynomial through the last (at most four) states, at ``load``."""
        loads = [at for at, _ in self._history]
        total = np.zeros_like(self.system.points_mm)
        for i, (at, x) in enumerate(self._history):
            weight = 1.0
            for j, other in enumerate(loads):
                if i != j:
                    weight *= (load - other) / (at - other)
            total += weight * x
        return total

    def follow_tangent(self, load: float, newton: _Newton) -> FloatArray:
        """(n, 2) the linear prediction from the last state."""
        start, x = self._history[-1]
        move = (load - start) * self.pattern
        residual = self.system.linearise(x)
        newton.factorisations += 1
        probe = 1e-6
        pushed = self.system.reduce(self.system.forces(x + probe * move))
        free = -self.system.solve((pushed - residual) / probe)
        return x + move + newton.expand(free)
