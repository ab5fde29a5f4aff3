"""Load stepping: prediction, Newton's method with an energy line search, step halving.

Sheets whose hinges are a tenth of a millimetre wide snap locally, hinge by hinge, and at a snap
the tangent has negative eigenvalues: Newton's method then goes uphill or towards a saddle. What
is wanted is the next minimum of the energy. So where a full step fails, the eigenvalues of the
tangent are counted; if some are negative, the negative ones of the material tangent are taken
away in part, no more than it needs for the whole to be positive definite.
"""

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
_MOST_ITERATIONS = 100
"""For one attempt to reach a load."""
MOST_WORK = 1500
"""Iterations for a whole path: it ends there, not converged. Smooth paths of 25 steps need 50."""
_STALE_BELOW = 1e-4
"""Below this energy error (of the stored energy) the last factorisation is used again."""
_SHORT = 0.2
"""A line search that cuts a Newton step below this part tries the raised tangent too."""
_FIRST_PART = 0.25
"""Part of the negative eigenvalues of the material tangent taken away first; doubled up to 1."""
_SNAPPING = 20
"""After so many iterations at one load, ``_SNAPPING_TOLERANCE`` will do."""
_SNAPPING_TOLERANCE = 1e-6
"""Energy error / stored energy. A snap of a single hinge releases 1e-6 to 1e-4 of the energy."""


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

    def linearise(self, x: FloatArray, *, projected: float = 0.0) -> FloatArray:
        """Factorise the tangent at x; the residual (size,).

        ``projected`` is the part, 0 to 1, of the negative eigenvalues of the material tangent
        that is taken away; at 1 the tangent is positive semidefinite.
        """

    def solve(self, residual: FloatArray) -> FloatArray:
        """(size,) solution with the last factorised tangent."""

    def negative_modes(self) -> int:
        """Negative eigenvalues of the last factorised tangent."""


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


@dataclass(frozen=True, eq=False)
class _Step:
    """A step from the last factorised tangent: nodes (n, 2), slope and energy error."""

    move: FloatArray
    slope: float
    error: float


@dataclass
class _Newton:
    """One attempt after another to reach a load; counts what they cost."""

    system: System
    tolerance: float
    most_work: int
    work_before: int
    iterations: int = 0
    factorisations: int = 0
    reason: str = ""

    @property
    def spent(self) -> bool:
        """No iteration of the path is left."""
        return self.work_before + self.iterations >= self.most_work

    def expand(self, free: FloatArray) -> FloatArray:
        """(n, 2) displacements of the nodes from those of the equations; prescribed ones 0."""
        return np.where(self.system.equation >= 0, free[self.system.equation], 0.0)

    def relax(self, x: FloatArray) -> FloatArray | None:
        """Minimise the energy from x, whose prescribed displacements are those of the load."""
        energy = self.system.energy(x)
        if not np.isfinite(energy):
            self.reason = "an element is folded at the start of the step"
            return None
        reuse = careful = False
        raised, error = 0.0, np.inf
        for count in range(_MOST_ITERATIONS):
            if self.spent:
                self.reason = f"the work limit of {self.most_work} iterations a path was reached"
                return None
            self.iterations += 1
            if reuse and error < _STALE_BELOW:
                residual = self.system.reduce(self.system.forces(x))
            else:
                residual, raised = self._linearise(x, raised, careful)
            step = self._step(residual, energy)
            if step is None:
                self.reason = "the tangent is singular"
                return None
            error_before, error = error, step.error
            near = error < self.tolerance and raised == 0.0
            snapping = count >= _SNAPPING and error < _SNAPPING_TOLERANCE
            if (
                (near or snapping)
                and step.slope <= 0
                and np.isfinite(self.system.energy(x + step.move))
            ):
                return x + step.move
            length, found = self._search(x, step, energy)
            if raised > 0.0:
                length, found = self._lengthen(x, step.move, length, found)
            elif length < 1.0:
                negative = 0 if careful else self.system.negative_modes()
                careful = True
                if negative or length < _SHORT:
                    residual, part = self._linearise(x, _FIRST_PART if negative else 1.0, True)
                    other = self._step(residual, energy)
                    if other is not None:
                        far, lower = self._search(x, other, energy)
                        far, lower = self._lengthen(x, other.move, far, lower)
                        if far > 0.0 and (negative or length == 0.0 or lower < found):
                            step, length, found, raised = other, far, lower, part
                        error = max(error, other.error)
            if length == 0.0:
                self.reason = "the line search found no lower energy"
                return None
            x, energy = x + length * step.move, found
            reuse = length == 1.0 and error < 0.01 * error_before and raised == 0.0
            if length >= 1.0:
                raised = 0.5 * raised if raised > _FIRST_PART else 0.0
        self.reason = f"no convergence in {_MOST_ITERATIONS} iterations"
        return None

    def _linearise(self, x: FloatArray, raised: float, careful: bool) -> tuple[FloatArray, float]:
        """Residual and raised part; if ``careful``, raised until no eigenvalue is negative."""
        while True:
            self.factorisations += 1
            residual = self.system.linearise(x, projected=raised)
            if not careful or raised >= 1.0 or self.system.negative_modes() == 0:
                return residual, raised
            raised = min(1.0, max(_FIRST_PART, 2.0 * raised))

    def _step(self, residual: FloatArray, energy: float) -> _Step | None:
        """The step of the last factorised tangent; None where it is singular."""
        free = -self.system.solve(residual)
        if not np.isfinite(free).all():
            return None
        slope = float(residual @ free)
        return _Step(self.expand(free), slope, abs(slope) / max(energy, 1e-300))

    def _search(self, x: FloatArray, step: _Step, energy: float) -> tuple[float, float]:
        """Part of the step that lowers the energy enough, and that energy; 0 if none does."""
        if not step.slope <= 0:
            return 0.0, energy
        length = 1.0
        while length > 1e-3:
            found = self.system.energy(x + length * step.move)
            # Near the answer the decrease drowns in rounding.
            if found <= energy + 1e-4 * length * step.slope or (
                step.error < 1e-9 and np.isfinite(found)
            ):
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
        most_work: Newton iterations for the whole path; it fails where they are spent.
    """

    system: System
    pattern: FloatArray
    tolerance: float = 1e-9
    most_work: int = MOST_WORK
    _history: list[tuple[float, FloatArray]] = field(default_factory=list)
    _work: int = 0

    def __post_init__(self) -> None:
        self._history = [(0.0, self.system.points_mm.copy())]

    def advance(self, load: float) -> Solved | Failed:
        """Go on to ``load``; halves the step where Newton's method fails."""
        newton = _Newton(self.system, self.tolerance, self.most_work, self._work)
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
                if abs(step) < smallest or newton.spent:
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
        self._work += newton.iterations
        return Solved(x, newton.iterations, newton.factorisations)

    def _guesses(self, load: float, newton: _Newton) -> Iterator[FloatArray]:
        """Starting points, the best first: extrapolation, and what cannot fold."""
        if len(self._history) > 1:
            yield self.extrapolate(load)
        stretched = self.stretch(load)
        if len(self._history) == 1 or stretched is None:
            yield self.follow_tangent(load, newton)
        if stretched is not None:
            yield stretched

    def stretch(self, load: float) -> FloatArray | None:
        """(n, 2) the last state stretched along y, which folds nothing; None if it does not fit.

        It fits where the load moves a line y = const along y and holds the rest at y = 0.
        """
        start, x = self._history[-1]
        moved = self.pattern[:, 1] != 0.0
        top = x[moved, 1]
        held = (self.system.equation[:, 1] < 0) & ~moved
        if not moved.any() or self.pattern[:, 0].any() or x[held, 1].any() or np.ptp(top) > 1e-9:
            return None
        ratio = 1.0 + (load - start) * float(self.pattern[moved, 1][0]) / float(top[0])
        return x * np.array([1.0, ratio]) if ratio > 0.0 else None

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
