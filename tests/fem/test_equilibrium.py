"""The solver where sheets snap: minima of the energy, limits on the work, starting points."""

from __future__ import annotations

import numpy as np
from tolerances import SNAP_POISSON

from kiribench.fem.condensed import CondensedSystem
from kiribench.fem.equilibrium import Failed, LoadStepper, Solved
from kiribench.fem.material import NeoHookean
from kiribench.fem.mesh import MeshSpec
from kiribench.fem.sheet import SheetSpec, quarter_equations, quarter_mesh, simulate_sheet

SMALL = SheetSpec(rows=4, columns=2, cell_mm=10.0, grip_mm=10.0)
COARSE = MeshSpec(0.5, 0.8, 0.4)


def _stepper(most_work: int = 4000) -> tuple[LoadStepper, CondensedSystem]:
    """A sheet with hinges of a quarter of a millimetre, which snap near the grips."""
    mesh = quarter_mesh(0.95, 0.95, SMALL, COARSE)
    equation, pattern, _ = quarter_equations(mesh)
    system = CondensedSystem(mesh, equation, NeoHookean())
    return LoadStepper(system, pattern, most_work=most_work), system


def test_every_state_of_a_snapping_sheet_is_a_minimum() -> None:
    stepper, system = _stepper()
    raised = 0
    for load in np.arange(2.0, 21.0, 2.0):
        found = stepper.advance(float(load))
        assert isinstance(found, Solved)
        raised += found.factorisations > found.iterations
        residual = system.linearise(found.x)
        assert system.negative_modes() == 0
        assert abs(residual @ system.solve(residual)) < 1e-6 * system.energy(found.x)
    # The sheet does snap: the plain tangent was not enough.
    assert raised > 0


def test_the_work_of_a_path_is_limited_and_the_limit_is_the_reason() -> None:
    stepper, _ = _stepper(most_work=12)
    outcomes = []
    for load in (4.0, 8.0, 12.0, 16.0):
        outcomes.append(stepper.advance(load))
        if isinstance(outcomes[-1], Failed):
            break
    assert isinstance(outcomes[-1], Failed)
    assert "work limit of 12 iterations" in outcomes[-1].reason
    assert sum(outcome.iterations for outcome in outcomes) == 12


def test_large_steps_give_what_small_ones_give() -> None:
    """One step folds the extrapolated sheet; the stretched one is relaxed instead."""
    one = simulate_sheet(0.9, 0.9, [30.0], sheet=SMALL, mesh=COARSE, estimate_error=False)
    many = simulate_sheet(
        0.9, 0.9, np.arange(2.0, 31.0, 2.0), sheet=SMALL, mesh=COARSE, estimate_error=False
    )
    assert one.converged.all()
    assert many.converged.all()
    assert abs(one.poisson()[-1] - many.poisson()[-1]) < SNAP_POISSON


def test_stretching_folds_nothing_and_meets_the_load() -> None:
    stepper, system = _stepper()
    assert isinstance(stepper.advance(6.0), Solved)
    guess = stepper.stretch(12.0)
    assert guess is not None
    moved = stepper.pattern[:, 1] != 0
    np.testing.assert_allclose(guess[moved, 1], system.points_mm[moved, 1] + 12.0, rtol=1e-12)
    assert np.isfinite(system.energy(guess))
