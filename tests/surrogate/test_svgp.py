"""The sparse variational GP: its bound against GPyTorch's, its limit against the exact GP."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tolerances import SVGP_BOUND

from kiribench.surrogate import sparse_bound, svgp
from kiribench.surrogate.gpytorch_import import gpytorch
from kiribench.surrogate.hyperparameters import Hyperparameters

FloatArray = np.ndarray
SCALES, SIGNAL, RATIO = (0.5, 0.8, 0.6), 1.4, 2e-3


def learnt() -> Hyperparameters:
    return Hyperparameters((0.0,) * 3, (1.0,) * 3, 0.0, 1.0, SCALES, (), SIGNAL, RATIO)


def table(n: int = 90) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(8)
    X = rng.random((n, 3))
    return X, np.sin(4 * X[:, 0]) + X[:, 1] * X[:, 2] + 0.05 * rng.standard_normal(n)


def gpytorch_elbo(points: torch.Tensor, X: torch.Tensor, y: torch.Tensor) -> float:
    """GPyTorch's own variational bound, its q(u) set to the closed-form optimum."""

    class Model(gpytorch.models.ApproximateGP):
        def __init__(self) -> None:
            q = gpytorch.variational.CholeskyVariationalDistribution(len(points))
            super().__init__(
                gpytorch.variational.UnwhitenedVariationalStrategy(
                    self, points, q, learn_inducing_locations=False
                )
            )
            self.mean_module = gpytorch.means.ZeroMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(
                gpytorch.kernels.MaternKernel(nu=2.5, ard_num_dims=3)
            )

        def forward(self, x: torch.Tensor) -> gpytorch.distributions.MultivariateNormal:
            return gpytorch.distributions.MultivariateNormal(
                self.mean_module(x), self.covar_module(x)
            )

    model = Model().double()
    model.covar_module.outputscale = torch.tensor(SIGNAL, dtype=torch.float64)
    model.covar_module.base_kernel.lengthscale = torch.tensor(SCALES, dtype=torch.float64)
    likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
    noise = SIGNAL * RATIO
    likelihood.noise = torch.tensor(noise, dtype=torch.float64)
    with torch.no_grad():
        jitter = sparse_bound.JITTER * SIGNAL * torch.eye(len(points), dtype=torch.float64)
        k_uu = model.covar_module(points).to_dense() + jitter
        k_uf = model.covar_module(points, X).to_dense()
        # Titsias 2009, eq. 10: mean and covariance of the optimal q(u).
        inner = torch.linalg.inv(k_uu + k_uf @ k_uf.T / noise)
        mean = k_uu @ inner @ k_uf @ y / noise
        covariance = k_uu @ inner @ k_uu
        q = model.variational_strategy._variational_distribution
        q.variational_mean.copy_(mean)
        q.chol_variational_covar.copy_(torch.linalg.cholesky(covariance))
        model.variational_strategy.variational_params_initialized.fill_(1)
    objective = gpytorch.mlls.VariationalELBO(likelihood, model, num_data=len(X))
    with (
        torch.no_grad(),
        gpytorch.settings.variational_cholesky_jitter(double_value=sparse_bound.JITTER * SIGNAL),
        gpytorch.settings.cholesky_jitter(double_value=sparse_bound.JITTER * SIGNAL),
        gpytorch.settings.fast_computations(False, False, False),
    ):
        return float(objective(model(X), y))


def test_bound_equals_gpytorchs_variational_elbo() -> None:
    X, y = (torch.as_tensor(x) for x in table())
    points = X[::6].clone()
    ours = sparse_bound.bound(
        torch.tensor(SCALES, dtype=torch.float64),
        torch.tensor(SIGNAL, dtype=torch.float64),
        torch.tensor(SIGNAL * RATIO, dtype=torch.float64),
        points,
        X,
        y,
    )
    assert float(ours) / len(y) == pytest.approx(gpytorch_elbo(points, X, y), abs=SVGP_BOUND)


def test_all_rows_inducing_is_the_exact_gp() -> None:
    X, y = table()
    model = svgp.SparseVariationalGP(
        hyperparameters=learnt(), optimise=False, inducing_points=X
    ).fit(X, y)
    at = np.random.default_rng(1).random((20, 3))

    def k(left: FloatArray, right: FloatArray) -> FloatArray:
        r = np.sqrt(5 * np.sum(((left[:, None] - right[None]) / np.array(SCALES)) ** 2, axis=2))
        return SIGNAL * (1 + r + r**2 / 3) * np.exp(-r)

    covariance = k(X, X) + SIGNAL * RATIO * np.eye(len(X))
    mean, sd = model.predict(at, return_std=True)
    np.testing.assert_allclose(mean, k(at, X) @ np.linalg.solve(covariance, y), atol=1e-5)
    exact = SIGNAL * (1 + RATIO) - np.sum(k(at, X).T * np.linalg.solve(covariance, k(X, at)), 0)
    np.testing.assert_allclose(sd, np.sqrt(exact), atol=1e-5)


def test_bound_rises_to_the_exact_likelihood_with_more_points() -> None:
    X, y = (torch.as_tensor(x) for x in table())
    parameters = [torch.tensor(x, dtype=torch.float64) for x in (SCALES, SIGNAL, SIGNAL * RATIO)]
    bounds = [
        float(sparse_bound.bound(*parameters, sparse_bound.greedy_points(learnt(), X, count), X, y))
        for count in (5, 20, 45, 90)
    ]
    covariance = SIGNAL * sparse_bound._matern(X, X, parameters[0]) + SIGNAL * RATIO * torch.eye(90)
    exact = torch.distributions.MultivariateNormal(torch.zeros(90).double(), covariance)
    assert bounds == sorted(bounds)
    assert float(exact.log_prob(y)) == pytest.approx(bounds[-1], abs=1e-2)
    assert bounds[-1] <= float(exact.log_prob(y))


def test_greedy_points_beat_the_first_rows() -> None:
    X, y = (torch.as_tensor(x) for x in table())
    parameters = [torch.tensor(x, dtype=torch.float64) for x in (SCALES, SIGNAL, SIGNAL * RATIO)]
    greedy = sparse_bound.bound(*parameters, sparse_bound.greedy_points(learnt(), X, 20), X, y)
    assert float(greedy) > float(sparse_bound.bound(*parameters, X[:20], X, y))


def test_the_kernels_slope_is_that_of_autograd() -> None:
    """Among the rows an equal pair, where the root of the distance has no slope."""
    left, right = (torch.rand((n, 3), dtype=torch.float64) for n in (5, 4))
    right[1] = left[2]
    scales = torch.tensor([0.3, 0.7, 1.9], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda s: sparse_bound._matern(left, right, s), (scales,))
