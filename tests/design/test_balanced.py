"""`balanced`: its sum, its minimum against other optimisers, and patches of every shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_toys import drawn_problem, modulus, problem, surrogates
from scipy.optimize import least_squares
from tolerances import BALANCED_FORCE, BALANCED_NU, BALANCED_SUM, STRAIN_TABLE

from kiribench.design.balance_search import descend, look_around
from kiribench.design.balance_terms import Terms
from kiribench.design.balanced import balance, tabulated, terms_of
from kiribench.design.cells import Cells, cells_of
from kiribench.design.limits import Limits
from kiribench.design.methods import design_patch
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.design.reachable import Reachable, reachable
from kiribench.design.response import KernelResponse
from kiribench.design.strain_table import StrainTable
from kiribench.design.summary import force_difference
from kiribench.design.surrogates import Surrogates
from kiribench.errors import UsageError

WIDE = Limits(0.1, 0.0, 95.0)


def series_problem(seed: int, rows: int = 6, columns: int = 4) -> DesignProblem:
    """Targets that cuts of equal force in each column have, by the stand-in's own modulus."""
    rng = np.random.default_rng(seed)
    a, b = 0.3 + 0.25 * rng.random((2, rows, columns))
    force = np.linspace(0.03, 0.045, columns)
    # ln(force / strain) = ln modulus(a, b): strain follows from the cuts.
    strain = force / modulus(a, b)
    kept = surrogates().poisson
    nu = kept.predict(100 * a.ravel(), 100 * b.ravel(), strain.ravel()).mean.reshape(a.shape)
    return problem(strain, nu)


def opened(
    asked: DesignProblem, options: DesignOptions | None = None
) -> tuple[Cells, Reachable, Terms]:
    cells = cells_of(asked, surrogates(), WIDE, options or DesignOptions())
    span = reachable(cells.poisson, cells.high)
    return cells, span, terms_of(cells, span)


class Documented:
    """The sum of the docs as residuals, by the surrogate's own predictions.

    Targets within reach only; a NaN target or strain drops its residuals.
    """

    def __init__(self, asked: DesignProblem, options: DesignOptions) -> None:
        self.asked, self.options, self.kept = asked, options, surrogates().poisson
        self.strain, self.target = asked.longitudinal_strain.ravel(), asked.poisson_ratio.ravel()

    def predicted(self, x: np.ndarray) -> np.ndarray:
        """(2, N) Poisson's ratio and ln stress."""
        at = (100 * x[:, 0], 100 * x[:, 1], np.where(np.isfinite(self.strain), self.strain, 0.1))
        return np.stack([self.kept.predict(*at).mean, np.log(self.kept.predict_stress(*at).mean)])

    def linear(self, nu: np.ndarray, logs: np.ndarray, x: np.ndarray) -> np.ndarray:
        """What the residuals are of predictions and cuts, but for the targets."""
        rows, columns = self.asked.shape
        parts = [nu[np.isfinite(self.target)] / self.options.poisson_sd]
        for column in range(columns):
            inside = np.arange(logs.size) % columns == column
            here = logs[inside & np.isfinite(self.strain)]
            parts.append((here - here.mean()) / self.options.force_sd if here.size else here)
        field = x.reshape(rows, columns, 2)
        apart = [np.diff(field, axis=axis).ravel() for axis in (0, 1)]
        return np.concatenate(
            [*parts, *(d / self.options.neighbour_sd for d in apart), x.ravel() / 10]
        )

    def __call__(self, x: np.ndarray) -> np.ndarray:
        cuts = x.reshape(-1, 2)
        nu, logs = self.predicted(cuts)
        return self.linear(nu - self.target, logs, cuts)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """By differences of the predictions."""
        cuts, step = x.reshape(-1, 2), 1e-6
        rates = [
            (self.predicted(cuts + step * unit) - self.predicted(cuts - step * unit)) / (2 * step)
            for unit in np.eye(2)
        ]
        columns = []
        for cell, side in np.ndindex(cuts.shape):
            one, shift = np.arange(len(cuts)) == cell, np.zeros(cuts.shape)
            shift[cell, side] = 1.0
            columns.append(self.linear(*(one * rates[side]), shift))
        return np.column_stack(columns)

    def sum(self, x: np.ndarray) -> float:
        return float((self(x) ** 2).sum())


def test_targets_and_forces_are_met_where_both_can_be() -> None:
    asked = series_problem(1)
    result = design_patch("balanced", asked, surrogates(), WIDE)
    assert np.abs(result.error).max() < 5 * BALANCED_NU
    assert np.sqrt(np.mean(result.error**2)) < BALANCED_NU
    uneven = force_difference(result.nominal_stress_mpa)
    exact = design_patch("exact", asked, surrogates(), WIDE)
    assert uneven is not None and uneven < BALANCED_FORCE
    assert force_difference(exact.nominal_stress_mpa) > 5 * uneven
    # The stress is that of the closed form at the chosen cuts.
    design = result.design
    expected = asked.longitudinal_strain * modulus(design.a, design.b)
    np.testing.assert_allclose(result.nominal_stress_mpa, expected, rtol=0.01)
    mean = np.exp(np.log(result.nominal_stress_mpa).mean(axis=0))
    told = design.settings["MethodSettings"]
    np.testing.assert_allclose(told["ColumnStressMpa"], mean, rtol=1e-9)
    assert told["Converged"] is True


def test_the_sum_its_slope_and_its_matrix_are_those_of_the_docs() -> None:
    asked, options = series_problem(2, 3, 3), DesignOptions()
    terms = opened(asked)[2]
    x = np.random.default_rng(3).uniform(0.2, 0.8, (9, 2))
    at, of = terms.at(x), Documented(asked, options)
    assert at.value == pytest.approx(of.sum(x), rel=1e-8)
    steps = 1e-5 * np.eye(18).reshape(-1, 9, 2)
    slope = [(of.sum(x + s) - of.sum(x - s)) / 2e-5 for s in steps]
    np.testing.assert_allclose(at.slope, slope, rtol=1e-4, atol=1e-4 * np.abs(slope).max())
    matrix = at.matrix.toarray()
    ours = matrix[:18, :18] - matrix[:18, 18:] @ np.linalg.solve(matrix[18:, 18:], matrix[18:, :18])
    curvature = [(terms.at(x + s).slope - terms.at(x - s).slope) / 2e-5 for s in steps]
    np.testing.assert_allclose(ours, curvature, atol=1e-5 * np.abs(ours).max())


@pytest.mark.parametrize("kind", ["series", "drawn", "out of reach", "holes"])
def test_no_other_optimiser_finds_a_smaller_sum(kind: str) -> None:
    """scipy's trust-region least squares with bounds, from our answer and from drawn starts."""
    rng = np.random.default_rng(7)
    asked = series_problem(5, 3, 3) if kind == "series" else drawn_problem(4, 3, 3)[0]
    if kind == "out of reach":
        nu = asked.poisson_ratio.copy()
        nu[0, 0], nu[2, 1] = -1.5, 0.8
        asked = replace(asked, poisson_ratio=nu)
    if kind == "holes":
        nu, strain = asked.poisson_ratio.copy(), asked.longitudinal_strain.copy()
        nu[1, 1] = nu[0, 2] = strain[0, 2] = np.nan
        asked = replace(asked, poisson_ratio=nu, longitudinal_strain=strain)
    cells, span, _ = opened(asked)
    ours = balance(cells, span)
    assert ours.converged and ours.steps > 3
    within = asked.poisson_ratio.copy()
    within.ravel()[cells.place] = span.nearest(cells.target)
    of = Documented(replace(asked, poisson_ratio=within), DesignOptions())
    assert ours.objective == pytest.approx(of.sum(ours.cuts), rel=1e-6)
    starts = [ours.cuts.ravel(), *rng.uniform(0.05, 0.9, (4, 18))]
    found = [
        least_squares(
            of, np.clip(x, 1e-6, 0.95 - 1e-6), of.jacobian, bounds=(0.0, 0.95), max_nfev=60
        )
        for x in starts
    ]
    values = np.array([2 * f.cost for f in found])
    assert (values > ours.objective * (1 - BALANCED_SUM)).all()
    # And it can find ours: from our answer it does not leave.
    assert values[0] == pytest.approx(ours.objective, rel=BALANCED_SUM)


def test_no_start_ends_lower_than_half_cuts_everywhere() -> None:
    # Cuts drawn cell by cell: as rough as targets can be, so that other minima are there to end in.
    cells, span, terms = opened(drawn_problem(3, 4, 4)[0])
    ours = balance(cells, span)
    rough = tabulated(terms, cells)
    values = []
    for start in np.random.default_rng(1).uniform(0.0, 0.95, (8, 16, 2)):
        x, moved = start, 1
        while moved:
            x, moved = look_around(rough, descend(rough, x).at.x)
        values.append(descend(terms, x).at.value)
    assert min(values) == pytest.approx(ours.objective, rel=BALANCED_SUM)
    assert max(values) > 1.5 * ours.objective  # there were others


def test_no_cell_would_be_better_off_anywhere_on_a_fine_grid() -> None:
    cells, span, terms = opened(drawn_problem(8, 3, 3)[0])
    ours = balance(cells, span)
    ticks = np.linspace(0.0, 0.95, 96)
    for cell in range(9):
        best = np.inf
        for a in ticks[::2]:
            trial = np.repeat(ours.cuts[None], len(ticks), axis=0)
            trial[:, cell, 0], trial[:, cell, 1] = a, ticks
            own = terms.own(trial[:, cell], np.full(len(ticks), cell), ours.log_force).value
            bowl = np.einsum("kis,ij,kjs->k", trial, terms.smooth.toarray(), trial)
            best = min(best, float((own + bowl).min()))
        others = np.arange(9) != cell
        rest = terms.own(ours.cuts[others], np.flatnonzero(others), ours.log_force).value.sum()
        assert best + rest >= ours.objective * (1 - BALANCED_SUM)


def test_a_cell_in_the_wrong_branch_moves() -> None:
    cells, span, terms = opened(series_problem(3, 4, 3))
    ours = balance(cells, span)
    rough = tabulated(terms, cells)
    wrong = ours.cuts.copy()
    wrong[5] = 0.0, 0.9
    x, moved = look_around(rough, wrong)
    assert moved >= 1
    assert rough.at(x).value < rough.at(wrong).value
    np.testing.assert_allclose(x[5], ours.cuts[5], atol=0.1)
    assert look_around(rough, ours.cuts)[1] == 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (1, 2)])
def test_patches_of_one_row_one_column_one_cell(shape: tuple[int, int]) -> None:
    asked = drawn_problem(2, *shape)[0]
    result = design_patch("balanced", asked, surrogates(), WIDE)
    told = result.design.settings["MethodSettings"]
    x = np.stack([result.design.a, result.design.b], axis=-1)
    assert told["Objective"] == pytest.approx(Documented(asked, DesignOptions()).sum(x), rel=1e-6)
    if shape[0] == 1:  # a cell alone in its column has nothing to be equal to
        assert force_difference(result.nominal_stress_mpa) == pytest.approx(0.0, abs=1e-12)
        assert np.abs(result.error).max() < BALANCED_NU


def test_missing_targets_and_whole_missing_columns() -> None:
    asked = series_problem(4, 5, 4)
    nu, strain = asked.poisson_ratio.copy(), asked.longitudinal_strain.copy()
    nu[2, 1] = np.nan  # pulled, but free in its Poisson's ratio
    nu[0, 0] = strain[0, 0] = np.nan
    nu[:, 3] = strain[:, 3] = np.nan
    reason = np.where(np.isfinite(nu), "", "node-missing")
    asked = replace(asked, poisson_ratio=nu, longitudinal_strain=strain, reason=reason)
    result = design_patch("balanced", asked, surrogates(), WIDE)
    design, told = result.design, result.design.settings["MethodSettings"]
    assert np.isfinite(design.a).all() and np.isfinite(design.b).all()
    assert (design.reason[:, 3] == "node-missing").all()
    assert told["ColumnStressMpa"][3] is None and None not in told["ColumnStressMpa"][:3]
    stress = result.nominal_stress_mpa
    assert np.isfinite(stress[2, 1]) and np.isnan(stress[:, 3]).all()
    assert force_difference(stress) < BALANCED_FORCE
    # Cells that nothing asks for lie among their neighbours.
    assert np.ptp(design.a[:, 3]) < np.ptp(design.a[:, 2])


def test_what_cannot_be_met_is_a_compromise_with_its_reason() -> None:
    # One column, one Poisson's ratio; strains from .06 to .55, so that no cuts pull alike.
    strain = np.linspace(0.06, 0.55, 8)[:, None]
    asked = problem(strain, np.full((8, 1), 0.1))
    result = design_patch("balanced", asked, surrogates(), WIDE)
    even = DesignOptions(force_sd=1e-3)
    strict = design_patch("balanced", asked, surrogates(), WIDE, even)
    assert force_difference(strict.nominal_stress_mpa) < force_difference(result.nominal_stress_mpa)
    missed = np.abs(strict.error) > 0.005 + 1e-9
    assert missed.any()
    assert (strict.design.reason[missed] == "method-compromise").all()


def test_the_table_is_the_surrogate_to_what_it_says() -> None:
    kept = surrogates().poisson
    rng = np.random.default_rng(4)
    strain = rng.uniform(kept.low[2], kept.high[2], 300)
    points = rng.uniform(0.0, 0.95, (300, 2))
    for model in (kept, kept.stress):
        assert model is not None
        table, own = StrainTable.of(model, strain, 0.95), KernelResponse.of(model, strain)
        ours, true = table.jet(points), own.jet(points)
        scale = np.ptp(true.value)
        assert np.abs(ours.value - true.value).max() < STRAIN_TABLE * scale
        np.testing.assert_allclose(ours.slope, true.slope, atol=30 * STRAIN_TABLE * scale)
        some, ticks = np.array([3, 17]), np.linspace(0.0, 0.95, 7)
        grid = table.on_grid(ticks, ticks[:4], some)
        assert grid.shape == (2, 7, 4)
        at = np.array([[ticks[5], ticks[2]]] * 2)
        np.testing.assert_allclose(grid[:, 5, 2], table.jet(at, some).value, atol=1e-12)
    assert table.count == 300


def test_a_surrogate_without_stress_is_explained() -> None:
    without = Surrogates(replace(surrogates().poisson, stress=None))
    with pytest.raises(UsageError) as caught:
        design_patch("balanced", drawn_problem(1)[0], without)
    assert caught.value.code == "surrogate-without-stress"
