"""The exact Gaussian process in GPyTorch: zero mean, one scaled Gaussian kernel, Cholesky."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from kiribench.surrogate.gpytorch_import import gpytorch
from kiribench.surrogate.likelihood import LENGTH_BOUNDS, MOST_NOISE

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]


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
    model.covar_module.base_kernel.lengthscale = length
    model.covar_module.outputscale = signal
    likelihood.noise = noise
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
    for parameter in free:
        parameter.grad = None
    with exact_settings():
        loss = -objective(model(*model.train_inputs), values)
    loss.backward()
    slope = np.array([0.0 if x.grad is None else float(x.grad) for x in free])
    return float(loss.detach()), slope


def maximise_in_gpytorch(
    inputs: Tensor, values: Tensor, start: tuple[float, float, float], limit: int
) -> tuple[tuple[float, float, float], int]:
    """Length scale, signal and noise variance of maximum likelihood, and the evaluations.

    Args:
        inputs: (n, d) scaled.
        values: (n,) scaled.
        start: length scale, signal variance, noise ratio.
        limit: most evaluations.
    """
    model = gpytorch_model(inputs, values, start[0], start[1], start[1] * start[2])
    free = _raw(model)

    def evaluate(vector: FloatArray) -> tuple[float, FloatArray]:
        with torch.no_grad():
            for parameter, number in zip(free, vector, strict=True):
                parameter.fill_(float(number))
        return gpytorch_objective(model, values)

    reach = max(1.0, start[0])
    bounds = [
        (LENGTH_BOUNDS[0] * reach, LENGTH_BOUNDS[1] * reach),
        (1e-4, 1e6),
        (1e-8, MOST_NOISE),
    ]
    result = minimize(
        evaluate,
        np.log([start[0], start[1], start[1] * start[2]]),
        jac=True,
        method="L-BFGS-B",
        bounds=[(float(np.log(low)), float(np.log(high))) for low, high in bounds],
        options={"maxfun": limit, "ftol": 1e-7, "gtol": 1e-6},
    )
    length, signal, noise = np.exp(np.asarray(result.x)).tolist()
    return (length, signal, noise), int(result.nfev)


def _positive() -> Any:
    # exp, not softplus: the raw parameters are logarithms and the search is scale free.
    return gpytorch.constraints.Positive(transform=torch.exp, inv_transform=torch.log)


def _raw(model: GPyTorchModel) -> tuple[Tensor, Tensor, Tensor]:
    return (
        model.covar_module.base_kernel.raw_lengthscale,
        model.covar_module.raw_outputscale,
        model.likelihood.noise_covar.raw_noise,
    )
