"""Exact Gaussian processes against a plain numpy Cholesky and scikit-learn's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from tolerances import GP_ALGEBRA, GP_OPTIMUM_LOG_LIKELIHOOD

from kiribench.surrogate.gp import PaperGP
from kiribench.surrogate.gp_kronecker import KroneckerGP
from kiribench.surrogate.hyperparameters import Hyperparameters

FloatArray = np.ndarray
NOISE, SIGNAL = 1e-3, 1.7


def given(d: int, scales: tuple[float, ...], warp: tuple = ()) -> Hyperparameters:
    return Hyperparameters((0.0,) * d, (1.0,) * d, 0.2, 1.3, scales, warp, SIGNAL, NOISE)


def scattered(n: int = 60, d: int = 3) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(5)
    X = rng.random((n, d))
    y = np.sin(3 * X[:, 0]) * np.cos(2 * X[:, -1]) + 0.05 * rng.standard_normal(n)
    return X, y, rng.random((17, d))


def numpy_gp(
    X: FloatArray, y: FloatArray, at: FloatArray, scales: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Rasmussen & Williams 2006, algorithm 2.1, written out for :func:`given`."""

    def k(left: FloatArray, right: FloatArray) -> FloatArray:
        gap = (left[:, None, :] - right[None, :, :]) / scales
        return SIGNAL * np.exp(-0.5 * np.sum(gap**2, axis=2))

    z = (y - 0.2) / 1.3
    root = np.linalg.cholesky(k(X, X) + SIGNAL * NOISE * np.eye(len(X)))
    alpha = np.linalg.solve(root.T, np.linalg.solve(root, z))
    mean = k(at, X) @ alpha * 1.3 + 0.2
    half = np.linalg.solve(root, k(X, at))
    sd = 1.3 * np.sqrt(SIGNAL - np.sum(half**2, axis=0) + SIGNAL * NOISE)
    log_likelihood = (
        -0.5 * z @ alpha
        - np.log(np.diag(root)).sum()
        - 0.5 * len(z) * np.log(2 * np.pi)
        - len(z) * np.log(1.3)
    )
    return mean, sd, float(log_likelihood)


@pytest.mark.parametrize("scales", [(0.4, 0.4, 0.4), (0.3, 0.9, 0.5)])
def test_posterior_and_likelihood_equal_plain_numpy(scales: tuple[float, ...]) -> None:
    X, y, at = scattered()
    model = KroneckerGP(
        design_kernel="gaussian", hyperparameters=given(3, scales), optimise=False
    ).fit(X, y)
    mean, sd = model.predict(at, return_std=True)
    expected_mean, expected_sd, log_likelihood = numpy_gp(X, y, at, np.array(scales))
    assert model.structure_ == "dense"
    np.testing.assert_allclose(mean, expected_mean, rtol=0, atol=GP_ALGEBRA)
    np.testing.assert_allclose(sd, expected_sd, rtol=0, atol=GP_ALGEBRA)
    assert model.log_marginal_likelihood_ == pytest.approx(log_likelihood, abs=1e-6)


CORNER, CURVE, SPREAD = (0.1, 0.3), 0.05, 1.3


def numpy_cornered_gp(
    X: FloatArray, y: FloatArray, at: FloatArray, scales: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Matern 7/2 over x, y and the angle, Gaussian over strain, and an error a curve shares."""

    def coordinates(rows: FloatArray) -> FloatArray:
        angle = np.arctan2(rows[:, 0] + CORNER[0], 1 - rows[:, 1] + CORNER[1]) / (np.pi / 2)
        return np.column_stack([rows[:, :2], angle, rows[:, 2]])

    def k(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
        gap = np.abs(coordinates(left)[:, None] - coordinates(right)[None]) / scales
        r = np.sqrt(7) * gap[..., :3]
        matern = np.prod((1 + r + 2 / 5 * r**2 + r**3 / 15) * np.exp(-r), axis=2)
        by_strain = np.exp(-0.5 * gap[..., 3] ** 2)
        same = (left[:, None, :2] == right[None, :, :2]).all(axis=2)
        return SIGNAL * matern * by_strain, SIGNAL * CURVE * same * by_strain

    smooth, shared = k(X, X)
    covariance = smooth + shared + SIGNAL * NOISE * np.eye(len(X))
    cross = k(at, X)[0]
    mean = cross @ np.linalg.solve(covariance, (y - 0.2) / 1.3) * 1.3 + 0.2
    left = SIGNAL - np.sum(cross * np.linalg.solve(covariance, cross.T).T, axis=1)
    return mean, SPREAD * 1.3 * np.sqrt(left + SIGNAL * (NOISE + CURVE))


@pytest.mark.parametrize("structure", ["grid", "dense"])
def test_corner_and_curve_noise_equal_plain_numpy(
    structure: str, curves: tuple[FloatArray, FloatArray]
) -> None:
    X, y = curves
    X = X / np.array([100.0, 100.0, 1.0])
    scales = (0.35, 0.8, 1.4, 0.5)
    learnt = replace(given(3, scales), corner=CORNER, curve_noise=CURVE, spread=SPREAD)
    rows = {"max_missing": -1, "resampling": "never"} if structure == "dense" else {}
    model = KroneckerGP(hyperparameters=learnt, optimise=False, **rows).fit(X, y)
    # New points and rows of known designs: the prediction is the smooth process at both.
    at = np.vstack([np.random.default_rng(1).random((23, 3)) * 0.8, X[:20]])
    expected_mean, expected_sd = numpy_cornered_gp(X, y, at, np.array(scales))
    mean, sd = model.predict(at, return_std=True)
    assert model.structure_ == structure
    np.testing.assert_allclose(mean, expected_mean, rtol=0, atol=GP_ALGEBRA)
    np.testing.assert_allclose(sd, expected_sd, rtol=0, atol=GP_ALGEBRA)


@pytest.mark.parametrize("solver", ["auto", "dense"])
def test_paper_gp_on_a_grid_equals_plain_numpy(
    solver: str, curves: tuple[FloatArray, FloatArray]
) -> None:
    X, y = curves
    X = X / np.array([100.0, 100.0, 1.0])
    learnt = given(3, (0.35,))
    model = PaperGP(solver=solver, hyperparameters=learnt, optimise=False).fit(X, y)
    at = np.random.default_rng(1).random((23, 3)) * 0.8
    mean, sd = model.predict(at, return_std=True)
    expected_mean, expected_sd, log_likelihood = numpy_gp(X, y, at, np.full(3, 0.35))
    assert model.structure_ == ("grid" if solver == "auto" else "dense")
    np.testing.assert_allclose(mean, expected_mean, rtol=0, atol=GP_ALGEBRA)
    np.testing.assert_allclose(sd, expected_sd, rtol=0, atol=GP_ALGEBRA)
    assert model.log_marginal_likelihood_ == pytest.approx(log_likelihood, abs=1e-6)


def test_paper_gp_equals_scikit_learn_at_the_same_kernel() -> None:
    X, y, at = scattered()
    model = PaperGP(hyperparameters=given(3, (0.45,)), optimise=False).fit(X, y)
    kernel = ConstantKernel(SIGNAL) * RBF(0.45) + WhiteKernel(SIGNAL * NOISE)
    peer = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, (y - 0.2) / 1.3)
    mean, sd = model.predict(at, return_std=True)
    peer_mean, peer_sd = peer.predict(at, return_std=True)
    np.testing.assert_allclose(mean, peer_mean * 1.3 + 0.2, rtol=0, atol=GP_ALGEBRA)
    np.testing.assert_allclose(sd, peer_sd * 1.3, rtol=0, atol=GP_ALGEBRA)
    peer_log_likelihood = peer.log_marginal_likelihood_value_ - len(y) * np.log(1.3)
    assert model.log_marginal_likelihood_ == pytest.approx(peer_log_likelihood, abs=1e-6)


@pytest.mark.parametrize("solver", ["auto", "dense"])
def test_maximum_likelihood_equals_scikit_learns(
    solver: str, curves: tuple[FloatArray, FloatArray]
) -> None:
    X, y = curves
    y = y + 0.02 * np.random.default_rng(3).standard_normal(len(y))
    model = PaperGP(solver=solver).fit(X, y)
    unit = (X - X.min(axis=0)) / np.ptp(X, axis=0)
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(0.5) + WhiteKernel(1e-3, (1e-8, 1e1))
    peer = GaussianProcessRegressor(kernel, alpha=0.0).fit(unit, (y - y.mean()) / y.std())
    peer_log_likelihood = peer.log_marginal_likelihood_value_ - len(y) * np.log(y.std())
    assert model.log_marginal_likelihood_ == pytest.approx(
        peer_log_likelihood, abs=GP_OPTIMUM_LOG_LIKELIHOOD
    )
    assert model.hyperparameters_.length_scales[0] == pytest.approx(
        peer.kernel_.k1.k2.length_scale, rel=0.01
    )
    assert model.hyperparameters_.noise_sd == pytest.approx(0.02, rel=0.15)


def test_shared_sigma_is_a_smoother_with_noise_equal_to_signal(
    curves: tuple[FloatArray, FloatArray],
) -> None:
    X, y = curves
    model = PaperGP(shared_sigma=True).fit(X, y)
    assert model.hyperparameters_.noise_ratio == 1.0
    learnt = model.hyperparameters_
    unit = learnt.scale_inputs(X)
    gap = unit[:, None, :] - unit[None, :, :]
    k = np.exp(-0.5 * np.sum(gap**2, axis=2) / learnt.length_scales[0] ** 2)
    expected = k @ np.linalg.solve(k + np.eye(len(y)), y - y.mean()) + y.mean()
    np.testing.assert_allclose(model.predict(X), expected, rtol=0, atol=GP_ALGEBRA)


def test_gpytorch_likelihood_is_the_exact_one_and_its_slope_a_finite_difference() -> None:
    import torch

    from kiribench.surrogate.gpytorch_exact import gpytorch_model, gpytorch_objective

    X, y, _ = scattered(40)
    z = torch.as_tensor((y - 0.2) / 1.3)
    inputs = torch.as_tensor(X)
    value, slope = gpytorch_objective(gpytorch_model(inputs, z, 0.4, SIGNAL, 2e-3), z)
    steps = np.full(3, 1e-5)
    for index, step in enumerate(steps):
        sides = []
        for sign in (-1, 1):
            at = np.log([0.4, SIGNAL, 2e-3])
            at[index] += sign * step
            length, signal, noise = np.exp(at)
            sides.append(gpytorch_objective(gpytorch_model(inputs, z, length, signal, noise), z)[0])
        assert slope[index] == pytest.approx((sides[1] - sides[0]) / (2 * step), abs=1e-7)
    _, _, log_likelihood = numpy_gp(X, y, X[:2], np.full(3, 0.4))
    value, _ = gpytorch_objective(gpytorch_model(inputs, z, 0.4, SIGNAL, SIGNAL * NOISE), z)
    assert -value * len(z) - len(z) * np.log(1.3) == pytest.approx(log_likelihood, abs=1e-6)


def test_profiled_likelihood_is_the_likelihood_at_its_best_signal_variance() -> None:
    import torch

    from kiribench.surrogate.gpytorch_exact import (
        gpytorch_model,
        gpytorch_objective,
        profiled_objective,
    )

    X, y, _ = scattered(40)
    z, inputs = torch.as_tensor(y - y.mean()), torch.as_tensor(X)
    value, slope, signal = profiled_objective(gpytorch_model(inputs, z, 0.4, 1.0, 2e-3), z)
    full, by = gpytorch_objective(gpytorch_model(inputs, z, 0.4, signal, 2e-3 * signal), z)
    assert value == pytest.approx(full, abs=1e-10)
    assert by[1] + by[2] == pytest.approx(0.0, abs=1e-10)  # no slope along signal x noise
    np.testing.assert_allclose(slope, by[[0, 2]], rtol=0, atol=1e-9)
