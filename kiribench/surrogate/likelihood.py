"""Maximum marginal likelihood for the exact Gaussian processes: gradients and L-BFGS.

The free parameters are logarithms: length scales, optional warps and corner, noise. The
signal variance is at its closed-form optimum throughout, which takes one dimension and
most of the ill-conditioning out of the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from kiribench.surrogate import dense, kronecker
from kiribench.surrogate.hyperparameters import Parameters
from kiribench.surrogate.kernel_form import (
    KernelForm,
    TorchParameters,
    observed_correlation,
    observed_design_correlation,
    strain_correlation,
)

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]

LENGTH_BOUNDS = (0.01, 100.0)  # of an input's range
MOST_NOISE = 10.0  # noise variance / signal variance
WARP_BOUNDS = (0.01, 100.0)  # extra slope at an end of an input's range
CORNER_BOUNDS = (1e-3, 10.0)  # of an input's range, outside it
CURVE_NOISE_BOUNDS = (1e-9, 1.0)  # of the signal variance
GAIN = 3e-6  # a search ends when a step gains less than that share of the log likelihood


def grid_objective(
    form: KernelForm, designs: Tensor, strains: Tensor, values: Tensor, missing: Tensor
) -> Callable[[Parameters], tuple[float, Parameters]]:
    """Negative log likelihood and its gradient on a grid.

    Args:
        form: the kernel.
        designs: (p, d - 1) scaled.
        strains: (m, 1) scaled.
        values: (p, m) scaled.
        missing: (k,) flat indices.
    """

    def evaluate(at: Parameters) -> tuple[float, Parameters]:
        leaf = _leaf(at, values)
        k_design = observed_design_correlation(form, designs, leaf)
        k_strain = strain_correlation(form, strains, strains, leaf)
        with torch.no_grad():
            factors = kronecker.factorise(k_design, k_strain, at.noise_ratio)
            conditioned = kronecker.condition(factors, values, missing)
            by = kronecker.likelihood_gradient(conditioned)
        torch.autograd.backward((k_design, k_strain), (by.k_design, by.k_strain))
        return conditioned.negative_log_likelihood, _gradient(leaf, by.noise_ratio)

    return evaluate


def dense_objective(
    form: KernelForm, inputs: Tensor, values: Tensor
) -> Callable[[Parameters], tuple[float, Parameters]]:
    """Negative log likelihood and its gradient on scattered rows, (n, d) and (n,)."""

    def evaluate(at: Parameters) -> tuple[float, Parameters]:
        leaf = _leaf(at, values)
        k = observed_correlation(form, inputs, leaf)
        with torch.no_grad():
            conditioned = dense.condition(k, at.noise_ratio, values)
            by_k, by_noise = dense.likelihood_gradient(conditioned)
        torch.autograd.backward((k,), (by_k,))
        return conditioned.negative_log_likelihood, _gradient(leaf, by_noise)

    return evaluate


@dataclass(frozen=True)
class Maximum:
    """The end of a search, and whether it converged."""

    parameters: Parameters
    negative_log_likelihood: float
    evaluations: int
    converged: bool


def maximise(
    form: KernelForm,
    objective: Callable[[Parameters], tuple[float, Parameters]],
    start: Parameters,
    *,
    rows: int,
    max_evaluations: int = 200,
    gain: float = GAIN,
) -> Maximum:
    """L-BFGS-B in the logarithms of the free parameters.

    Args:
        form: which parameters are free.
        objective: the negative log likelihood and its gradient by the parameters.
        start: where to begin.
        rows: number of observations.
        max_evaluations: a limit on the number of likelihoods.
        gain: the search ends when a step gains less than this share of the log likelihood a row
            (or, where that is less than one, less than this number a row).
    """
    bounds = _free(form)

    def unpack(vector: FloatArray) -> Parameters:
        values: dict[str, Any] = {}
        used = 0
        for name in bounds:
            old = np.asarray(getattr(start, name), dtype=np.float64)
            new = np.exp(vector[used : used + old.size])
            values[name] = new.reshape(old.shape) if old.ndim else float(new[0])
            used += old.size
        return replace(start, **values)

    def value_and_slope(vector: FloatArray) -> tuple[float, FloatArray]:
        at = unpack(vector)
        value, by = objective(at)
        slope = [np.ravel(getattr(by, name) * getattr(at, name)) for name in bounds]
        return value / rows, np.concatenate(slope) / rows

    first = [np.log(np.ravel(getattr(start, name))) for name in bounds]
    limits = [
        (math.log(low), math.log(high))
        for values, (low, high) in zip(first, bounds.values(), strict=True)
        for _ in values
    ]
    low, high = np.array(limits).T
    result = minimize(
        value_and_slope,
        np.clip(np.concatenate(first), low, high),
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxfun": max_evaluations, "ftol": gain, "gtol": 1e-6},
    )
    return Maximum(
        parameters=unpack(np.asarray(result.x)),
        negative_log_likelihood=float(result.fun) * rows,
        evaluations=int(result.nfev),
        converged=bool(result.success),
    )


def likeliest(
    objective: Callable[[Parameters], tuple[float, Parameters]], starts: Sequence[Parameters]
) -> Parameters:
    """The start from which to search: a poor one ends where everything is noise."""
    return min(starts, key=lambda start: objective(start)[0])


def _free(form: KernelForm) -> dict[str, tuple[float, float]]:
    """Bounds of the free parameters, by their names in :class:`Parameters`."""
    bounds = {"length_scales": LENGTH_BOUNDS}
    if form.warped:
        bounds["warp"] = WARP_BOUNDS
    if form.cornered:
        bounds["corner"] = CORNER_BOUNDS
    if form.curve_noise:
        bounds["curve_noise"] = CURVE_NOISE_BOUNDS
    if form.free_noise:
        bounds["noise_ratio"] = (form.noise_floor, MOST_NOISE)
    return bounds


def _leaf(at: Parameters, like: Tensor) -> TorchParameters:
    leaf = TorchParameters.of(at, like)
    for tensor in leaf.tensors():
        tensor.requires_grad_(True)
    return leaf


def _gradient(leaf: TorchParameters, by_noise: float) -> Parameters:
    scales, warp, corner, curve_noise = (
        np.zeros(tuple(tensor.shape)) if tensor.grad is None else tensor.grad.cpu().numpy()
        for tensor in leaf.tensors()
    )
    return Parameters(scales, warp, by_noise, corner, float(curve_noise))
