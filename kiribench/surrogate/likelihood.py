"""Maximum marginal likelihood for the exact Gaussian processes: gradients and L-BFGS.

The free parameters are logarithms: length scales, optional input warps, noise ratio. The
signal variance is at its closed-form optimum throughout, which takes one dimension and
most of the ill-conditioning out of the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from kiribench.surrogate import dense, kronecker
from kiribench.surrogate.hyperparameters import Parameters
from kiribench.surrogate.kernels import correlation

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]

LENGTH_BOUNDS = (0.01, 100.0)  # of an input's range
MOST_NOISE = 10.0  # noise variance / signal variance
WARP_BOUNDS = (0.01, 100.0)  # extra slope at an end of an input's range
WARP_DEPTH = 0.15  # of the range: how far in the extra slope reaches


@dataclass(frozen=True)
class KernelForm:
    """Which correlation: families, and which length scales and warps are free.

    Attributes:
        design_family, strain_family: keys of :data:`kiribench.surrogate.kernels.FAMILIES`;
            the last input is the strain, the others are the design.
        inputs: d.
        shared_scale: one length scale over all inputs (the paper's eq. 3).
        warped: whether each design input passes through a monotone map that is steeper towards
            the ends of its range, with free extra slopes p and q (input warping, Snoek
            et al. 2014, arXiv 1402.0929, with a map that extrapolates).
        free_noise: whether the noise ratio is free; else it is kept.
        noise_floor: least noise ratio. Simulated tables have next to no noise, and the
            likelihood would run to where rounding and the kernel's faults take over.
    """

    design_family: str
    strain_family: str
    inputs: int
    shared_scale: bool = False
    warped: bool = False
    free_noise: bool = True
    noise_floor: float = 1e-8


def start_parameters(form: KernelForm) -> Parameters:
    """Where the search starts: smooth, one input's range wide, little noise."""
    return Parameters(
        length_scales=np.full(1 if form.shared_scale else form.inputs, 0.5),
        warp=np.full((form.inputs - 1, 2), 0.3),
        noise_ratio=1e-4 if form.free_noise else 1.0,
    )


def design_correlation(
    form: KernelForm, left: Tensor, right: Tensor, at: TorchParameters
) -> Tensor:
    """(p, q) correlations over the design inputs, (p, d - 1) and (q, d - 1)."""
    scales = at.length_scales if form.shared_scale else at.length_scales[:-1]
    if form.warped:
        left, right = _warp(left, at.warp), _warp(right, at.warp)
    return correlation(form.design_family, left, right, scales)


def strain_correlation(
    form: KernelForm, left: Tensor, right: Tensor, at: TorchParameters
) -> Tensor:
    """(m, k) correlations over the last input, (m, 1) and (k, 1)."""
    scales = at.length_scales if form.shared_scale else at.length_scales[-1:]
    return correlation(form.strain_family, left, right, scales)


def full_correlation(form: KernelForm, left: Tensor, right: Tensor, at: TorchParameters) -> Tensor:
    """(n, t) correlations over all inputs, (n, d) and (t, d): the same product, row by row."""
    if form.inputs == 1:
        return strain_correlation(form, left, right, at)
    return design_correlation(form, left[:, :-1], right[:, :-1], at) * strain_correlation(
        form, left[:, -1:], right[:, -1:], at
    )


@dataclass(frozen=True, eq=False)
class TorchParameters:
    """:class:`Parameters` as tensors on the device of the computation."""

    length_scales: Tensor
    warp: Tensor

    @classmethod
    def of(cls, parameters: Parameters, like: Tensor) -> TorchParameters:
        """The parameters on the device of ``like``."""
        return cls(
            torch.as_tensor(parameters.length_scales, dtype=like.dtype, device=like.device),
            torch.as_tensor(parameters.warp, dtype=like.dtype, device=like.device),
        )


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
        k_design = design_correlation(form, designs, designs, leaf)
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
        k = full_correlation(form, inputs, inputs, leaf)
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
) -> Maximum:
    """L-BFGS-B in the logarithms of the free parameters.

    Args:
        form: which parameters are free.
        objective: the negative log likelihood and its gradient by the parameters.
        start: where to begin.
        rows: number of observations; the search ends when a step gains less than
            1e-7 of the log likelihood a row.
        max_evaluations: a limit on the number of likelihoods.
    """

    def unpack(vector: FloatArray) -> Parameters:
        scales = len(start.length_scales)
        warps = start.warp.size if form.warped else 0
        return Parameters(
            length_scales=np.exp(vector[:scales]),
            warp=np.exp(vector[scales : scales + warps]).reshape(start.warp.shape)
            if form.warped
            else start.warp,
            noise_ratio=float(np.exp(vector[-1])) if form.free_noise else start.noise_ratio,
        )

    def value_and_slope(vector: FloatArray) -> tuple[float, FloatArray]:
        at = unpack(vector)
        value, by = objective(at)
        slope = [by.length_scales * at.length_scales]
        if form.warped:
            slope.append((by.warp * at.warp).ravel())
        if form.free_noise:
            slope.append(np.array([by.noise_ratio * at.noise_ratio]))
        return value / rows, np.concatenate(slope) / rows

    first = [np.log(start.length_scales)]
    bounds = [LENGTH_BOUNDS] * len(start.length_scales)
    if form.warped:
        first.append(np.log(start.warp).ravel())
        bounds += [WARP_BOUNDS] * start.warp.size
    if form.free_noise:
        first.append(np.array([np.log(start.noise_ratio)]))
        bounds.append((form.noise_floor, MOST_NOISE))
    limits = [(float(np.log(low)), float(np.log(high))) for low, high in bounds]
    result = minimize(
        value_and_slope,
        np.concatenate(first),
        jac=True,
        method="L-BFGS-B",
        bounds=limits,
        options={"maxfun": max_evaluations, "ftol": 1e-7, "gtol": 1e-6},
    )
    return Maximum(
        parameters=unpack(np.asarray(result.x)),
        negative_log_likelihood=float(result.fun) * rows,
        evaluations=int(result.nfev),
        converged=bool(result.success),
    )


def _leaf(at: Parameters, like: Tensor) -> TorchParameters:
    leaf = TorchParameters.of(at, like)
    leaf.length_scales.requires_grad_(True)
    leaf.warp.requires_grad_(True)
    return leaf


def _gradient(leaf: TorchParameters, by_noise: float) -> Parameters:
    scales, warp = leaf.length_scales, leaf.warp
    return Parameters(
        length_scales=np.zeros(len(scales)) if scales.grad is None else scales.grad.cpu().numpy(),
        warp=np.zeros(tuple(warp.shape)) if warp.grad is None else warp.grad.cpu().numpy(),
        noise_ratio=by_noise,
    )


def _warp(x: Tensor, steepness: Tensor) -> Tensor:
    # Slope 1 inside, 1 + p at x = 0 and 1 + q at x = 1, straight on beyond both ends, so
    # that points outside the data's range are extrapolated and not clamped.
    low, high = steepness[:, 0], steepness[:, 1]
    inside = x.clamp(0.0, 1.0)
    end = math.exp(-1.0 / WARP_DEPTH)
    rise = -torch.expm1(-inside / WARP_DEPTH)
    fall = torch.exp((inside - 1.0) / WARP_DEPTH) - end
    warped = inside + WARP_DEPTH * (low * rise + high * fall)
    below, above = (x - inside).clamp_max(0.0), (x - inside).clamp_min(0.0)
    warped = warped + below * (1.0 + low + high * end) + above * (1.0 + low * end + high)
    return warped / (1.0 + WARP_DEPTH * (low + high) * (1.0 - end))
