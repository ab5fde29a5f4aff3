"""Kronecker algebra on complete and holey grids against the dense covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from tolerances import GP_ALGEBRA, GP_GRADIENT

from kiribench.surrogate import dense, kronecker
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters
from kiribench.surrogate.kernel_form import (
    KernelForm,
    TorchParameters,
    design_correlation,
    full_correlation,
    observed_correlation,
    observed_design_correlation,
    strain_correlation,
)
from kiribench.surrogate.likelihood import dense_objective, grid_objective

FORM = KernelForm("gaussian", "matern52", 3, warped=True, cornered=True, curve_noise=True)
AT = Parameters(
    length_scales=np.array([0.3, 0.6, 1.5, 0.4]),
    warp=np.array([[0.5, 3.0], [0.2, 1.0]]),
    noise_ratio=1e-3,
    corner=np.array([0.05, 0.3]),
    curve_noise=0.02,
)
HOLES = {"complete": [], "holes": [0, 7, 8, 23, 41, 59], "a design": list(range(12, 18))}


def small_grid() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """10 designs x 6 strains: axes, values, and the same as 60 rows."""
    rng = np.random.default_rng(2)
    designs = torch.as_tensor(rng.random((10, 2)))
    strains = torch.as_tensor(np.sort(rng.random(6)))[:, None]
    values = torch.as_tensor(rng.standard_normal((10, 6)))
    rows = torch.cat([designs.repeat_interleave(6, 0), strains.repeat(10, 1)], dim=1)
    return designs, strains, values, rows, values.reshape(-1)


@pytest.mark.parametrize("holes", list(HOLES))
def test_likelihood_and_gradient_equal_dense(holes: str) -> None:
    designs, strains, values, rows, flat = small_grid()
    missing = torch.as_tensor(HOLES[holes], dtype=torch.long)
    kept = np.setdiff1d(np.arange(60), HOLES[holes])
    value, slope = grid_objective(FORM, designs, strains, values, missing)(AT)
    expected, expected_slope = dense_objective(FORM, rows[kept], flat[kept])(AT)
    assert value == pytest.approx(expected, abs=GP_ALGEBRA)
    np.testing.assert_allclose(slope.length_scales, expected_slope.length_scales, rtol=0, atol=1e-7)
    np.testing.assert_allclose(slope.warp, expected_slope.warp, rtol=0, atol=1e-7)
    np.testing.assert_allclose(slope.corner, expected_slope.corner, rtol=0, atol=1e-7)
    assert slope.curve_noise == pytest.approx(expected_slope.curve_noise, rel=1e-8)
    assert slope.noise_ratio == pytest.approx(expected_slope.noise_ratio, rel=1e-8)


@pytest.mark.parametrize("holes", list(HOLES))
def test_gradient_is_a_finite_difference(holes: str) -> None:
    designs, strains, values, _, _ = small_grid()
    missing = torch.as_tensor(HOLES[holes], dtype=torch.long)
    objective = grid_objective(FORM, designs, strains, values, missing)
    _, slope = objective(AT)

    names = ("length_scales", "warp", "corner", "curve_noise", "noise_ratio")
    for name in names:
        centre = np.asarray(getattr(AT, name))
        for index in np.ndindex(centre.shape):
            step = 1e-5 * centre[index]
            sides = []
            for sign in (1, -1):
                moved = centre.copy()
                moved[index] += sign * step
                sides.append(
                    objective(replace(AT, **{name: moved if moved.ndim else float(moved)}))[0]
                )
            expected = (sides[0] - sides[1]) / (2 * step)
            assert np.asarray(getattr(slope, name))[index] == pytest.approx(
                expected, rel=GP_GRADIENT
            ), name


@pytest.mark.parametrize("holes", list(HOLES))
def test_posterior_equals_dense(holes: str) -> None:
    designs, strains, values, rows, flat = small_grid()
    missing = torch.as_tensor(HOLES[holes], dtype=torch.long)
    kept = np.setdiff1d(np.arange(60), HOLES[holes])
    theta = TorchParameters.of(AT, rows)
    points = torch.as_tensor(np.random.default_rng(9).random((14, 3)))
    both = [
        observed_correlation(FORM, rows[kept], theta),
        full_correlation(FORM, points, rows[kept], theta),
    ]
    flat_at = dense.condition(both[0], AT.noise_ratio, flat[kept])
    expected_mean, expected_variance = dense.predict(flat_at, both[1])
    at = kronecker.condition(
        kronecker.factorise(
            observed_design_correlation(FORM, designs, theta),
            strain_correlation(FORM, strains, strains, theta),
            AT.noise_ratio,
        ),
        values,
        missing,
    )
    mean, variance = kronecker.predict(
        at,
        design_correlation(FORM, points[:, :-1], designs, theta),
        strain_correlation(FORM, points[:, -1:], strains, theta),
        torch.arange(14),
    )
    np.testing.assert_allclose(mean, expected_mean, rtol=0, atol=GP_ALGEBRA)
    np.testing.assert_allclose(variance, expected_variance, rtol=0, atol=GP_ALGEBRA)
    assert at.signal == pytest.approx(flat_at.signal, rel=1e-10)


def test_values_at_missing_entries_do_not_matter() -> None:
    designs, strains, values, _, _ = small_grid()
    missing = torch.as_tensor(HOLES["holes"])
    other = values.clone()
    other.view(-1)[missing] = 1e6
    first, _ = grid_objective(FORM, designs, strains, values, missing)(AT)
    second, _ = grid_objective(FORM, designs, strains, other, missing)(AT)
    assert first == second


def test_estimator_on_a_grid_equals_the_same_rows_taken_as_scattered(
    curves: tuple[np.ndarray, np.ndarray],
) -> None:
    X, y = curves
    drop = np.random.default_rng(4).permutation(len(X))[:20]
    X, y = np.delete(X, drop, axis=0), np.delete(y, drop)
    order = np.random.default_rng(5).permutation(len(X))
    X, y = X[order], y[order]
    grid = KroneckerGP().fit(X, y)
    learnt = grid.hyperparameters_
    rows = KroneckerGP(
        hyperparameters=learnt, optimise=False, max_missing=-1, resampling="never"
    ).fit(X, y)
    assert (grid.structure_, rows.structure_) == ("grid", "dense")
    points = X[:40] + np.array([1.3, -0.7, 0.01])
    for one, other in zip(
        grid.predict(points, return_std=True), rows.predict(points, return_std=True), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=GP_ALGEBRA)
    assert grid.log_marginal_likelihood_ == pytest.approx(rows.log_marginal_likelihood_, abs=1e-5)


def test_hyperparameters_survive_json() -> None:
    learnt = Hyperparameters(
        (0.0, 1.0),
        (2.0, 3.0),
        0.1,
        0.2,
        (0.3, 0.4),
        ((1.0, 2.0),),
        0.5,
        1e-6,
        corner=(0.1, 0.2),
        curve_noise=1e-4,
        spread=1.2,
    )
    assert Hyperparameters.from_dict(learnt.as_dict()) == learnt
