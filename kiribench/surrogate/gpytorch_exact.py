"""The exact Gaussian process in GPyTorch: zero mean, one scaled Gaussian kernel, Cholesky."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from kiribench.surrogate.gpytorch_import import gpytorch
from kiribench.surrogate.likelihood import LENGTH_BOUNDS, MOST_NOISE

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class GPyTorchMaximum:
    """The end of a search, in scaled units."""

    length_scale: float
    signal_variance: float
    noise_ratio: float
    negative_log_likelihood: float
    evaluations: int


class GPyTorchModel(gpytorch.models.ExactGP):  # type: ignore[misc]
    """GPyTorch's exact GP with zero mean and a scaled Gaussian kernel."""

    def __init__(self, inputs: Tensor, values: Tensor, likelihood: Any) -> None:
        super().__init__(inputs, values, likelihood)
        self.mean_module = gpytorch.means.ZeroMean()
        self.covar_module = gpytorch.kernels.ScaleKernel(
            gpytorch.kernels.RBFKernel(lengthscale_constraint=_positive()),
            outputscale_constraint=_positive(),
        )

    def forward(self, x: Tensor) -> Any:
        """The prior at (n, d) points."""
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


def gpytorch_model(
    inputs: Tensor, values: Tensor, length: float, signal: float, noise: float
) -> GPyTorchModel:
    """The model at given length scale, signal variance and noise variance, in float64."""
    likelihood = gpytorch.likelihoods.GaussianLikelihood(noise_constraint=_positive())
    model = GPyTorchModel(inputs, values, likelihood)
    model.to(dtype=torch.float64, device=inputs.device)
    # GPyTorch's setters make float32 of a plain float: eight digits lost.
    length_, signal_, noise_ = torch.tensor([length, signal, noise], dtype=torch.float64)
    model.covar_module.base_kernel.lengthscale = length_
    model.covar_module.outputscale = signal_
    likelihood.noise = noise_
    return model


def exact_settings() -> gpytorch.settings.fast_computations:
    """GPyTorch by Cholesky: its default conjugate gradients misstate the likelihood."""
    return gpytorch.settings.fast_computations(
        covar_root_decomposition=False, log_prob=False, solves=False
    )


def gpytorch_objective(model: GPyTorchModel, values: Tensor) -> tuple[float, FloatArray]:
    """Negative log likelihood a row, and its slope by log length scale, signal and noise."""
    model.train()
    objective = gpytorch.mlls.ExactMarginalLogLikelihood(model.likelihood, model)
    free = _raw(model)
    with exact_settings():
        loss = -objective(model(*model.train_inputs), values)
    slope = torch.autograd.grad(loss, free)
    return float(loss.detach()), np.array([float(x) for x in slope])


def profiled_objective(model: GPyTorchModel, values: Tensor) -> tuple[float, FloatArray, float]:
    """The same with the signal variance at its best, the model's own being 1.

    Returns:
        Negative log likelihood a row, its slope by log length scale and log noise ratio, and
        the best signal variance.
    """
    model.train()
    n = len(values)
    with exact_settings():
        covariance = model.likelihood(model(*model.train_inputs)).lazy_covariance_matrix
        quadratic, log_det = covariance.inv_quad_logdet(values[:, None], logdet=True)
    loss = 0.5 * (math.log(2.0 * math.pi) + 1.0 + (quadratic / n).log() + log_det / n)
    length, _, noise = _raw(model)
    slope = torch.autograd.grad(loss, (length, noise))
    return float(loss.detach()), np.array([float(x) for x in slope]), float(quadratic.detach()) / n


def maximise_in_gpytorch(
    inputs: Tensor, values: Tensor, start: tuple[float, float], limit: int
) -> GPyTorchMaximum:
    """Length scale, signal variance and noise ratio of maximum likelihood.

    Args:
        inputs: (n, d) scaled.
        values: (n,) scaled.
        start: length scale and noise ratio.
        limit: most evaluations.
    """
    model = gpytorch_model(inputs, values, start[0], 1.0, start[1])
    length, _, noise = _raw(model)

    def evaluate(vector: FloatArray) -> tuple[float, FloatArray]:
        with torch.no_grad():
            length.fill_(float(vector[0]))
            noise.fill_(float(vector[1]))
        return profiled_objective(model, values)[:2]

    reach = max(1.0, start[0])
    bounds = [(LENGTH_BOUNDS[0] * reach, LENGTH_BOUNDS[1] * reach), (1e-8, MOST_NOISE)]
    result = minimize(
        evaluate,
        np.log(start),
        jac=True,
        method="L-BFGS-B",
        bounds=[(float(np.log(low)), float(np.log(high))) for low, high in bounds],
        options={"maxfun": limit, "ftol": 1e-7, "gtol": 1e-6},
    )
    best = np.asarray(result.x)
    evaluate(best)
    return GPyTorchMaximum(
        length_scale=float(np.exp(best[0])),
        signal_variance=profiled_objective(model, values)[2],
        noise_ratio=float(np.exp(best[1])),
        negative_log_likelihood=float(result.fun) * len(values),
        evaluations=int(result.nfev),
    )


def _positive() -> Any:
    # exp, not softplus: the raw parameters are logarithms and the search is scale free.
    return gpytorch.constraints.Positive(transform=torch.exp, inv_transform=torch.log)


def _raw(model: GPyTorchModel) -> tuple[Tensor, Tensor, Tensor]:
    return (
        model.covar_module.base_kernel.raw_lengthscale,
        model.covar_module.raw_outputscale,
        model.likelihood.noise_covar.raw_noise,
    )
