"""The algebra of the sparse variational Gaussian process: bound, posterior, inducing points.

Titsias 2009 (PMLR 5:567-574): with Gaussian noise the best variational distribution of
the inducing values is known in closed form, and the bound with it put in is what is
maximised. Inducing points are rows, chosen greedily by conditional variance (Burt et al.
2020, arXiv 2008.00323).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import torch

from kiribench.surrogate.gpytorch_import import gpytorch
from kiribench.surrogate.hyperparameters import Hyperparameters

Tensor = torch.Tensor
JITTER = 1e-8  # times the signal variance, on the inducing points' covariance


@dataclass(frozen=True, eq=False)
class SparseState:
    """The variational posterior, ready to predict.

    Attributes:
        inducing: (m, d) scaled inputs.
        root: (m, m) Cholesky factor of the inducing covariance, unit signal variance.
        precision: (m, m) ``I + A A'``, A the whitened cross covariance over the noise sd.
        weighted: (m,) ``A y`` over the noise sd.
        signal, noise: variances of the scaled process.
    """

    inducing: Tensor
    root: Tensor
    precision: Tensor
    weighted: Tensor
    signal: float
    noise: float


def kernel_of(length_scales: Any, like: Tensor) -> Any:
    """GPyTorch's Matern 5/2 correlation with one length scale an input."""
    kernel = gpytorch.kernels.MaternKernel(nu=2.5, ard_num_dims=like.shape[1])
    kernel = kernel.to(dtype=torch.float64, device=like.device)
    kernel.lengthscale = torch.as_tensor(length_scales, dtype=torch.float64)
    return kernel


def bound(
    length_scales: Tensor,
    signal: Tensor,
    noise: Tensor,
    points: Tensor,
    inputs: Tensor,
    values: Tensor,
) -> Tensor:
    """Titsias' lower bound of the log marginal likelihood, q(u) at its optimum (eq. 9).

    Args:
        length_scales: (d,).
        signal, noise: variances, scalars.
        points: (m, d) inducing points.
        inputs: (n, d) scaled rows.
        values: (n,) scaled targets.
    """
    n, m = len(inputs), len(points)
    k_uu = signal * _matern(points, points, length_scales)
    k_uu = k_uu + JITTER * signal * torch.eye(m, dtype=values.dtype, device=values.device)
    k_uf = signal * _matern(points, inputs, length_scales)
    a = torch.linalg.solve_triangular(torch.linalg.cholesky(k_uu), k_uf, upper=False) / noise.sqrt()
    precision = a @ a.T + torch.eye(m, dtype=values.dtype, device=values.device)
    root = torch.linalg.cholesky(precision)
    c = torch.linalg.solve_triangular(root, (a @ values)[:, None], upper=False)[:, 0]
    c = c / noise.sqrt()
    fit = (
        -0.5 * n * math.log(2.0 * math.pi)
        - root.diagonal().log().sum()
        - 0.5 * n * noise.log()
        - 0.5 * values.square().sum() / noise
        + 0.5 * c.square().sum()
    )
    trace: Tensor = 0.5 * (n * signal / noise - a.square().sum())
    return torch.sub(fit, trace)


def posterior(
    learnt: Hyperparameters, points: Tensor, inputs: Tensor, values: Tensor
) -> SparseState:
    """The optimal distribution of the inducing values given (n, d) rows."""
    root, a, noise = whitened(learnt, points, inputs)
    precision = torch.eye(len(points), dtype=a.dtype, device=a.device) + a @ a.T
    weighted = a @ values / math.sqrt(noise)
    return SparseState(points, root, precision, weighted, learnt.signal_variance, noise)


def predict_scaled(
    learnt: Hyperparameters, state: SparseState, points: Tensor
) -> tuple[Tensor, Tensor]:
    """(t,) means and noise-free variances of the scaled process."""
    with torch.no_grad():
        cross = kernel_of(learnt.length_scales, points)(state.inducing, points).to_dense()
        half = torch.linalg.solve_triangular(state.root, cross, upper=False)
        half = half * math.sqrt(state.signal)
        precision_root = torch.linalg.cholesky(state.precision)
        mean = half.T @ torch.cholesky_solve(state.weighted[:, None], precision_root)[:, 0]
        gained = torch.linalg.solve_triangular(precision_root, half, upper=False)
        variance = state.signal - half.square().sum(0) + gained.square().sum(0)
    return mean, variance.clamp_min(0.0)


def leave_rows_out(
    learnt: Hyperparameters, state: SparseState, inputs: Tensor, values: Tensor
) -> tuple[Tensor, Tensor]:
    """Predict (q, d) training rows from all others, kernel and inducing points fixed.

    Taking rows out of ``I + A A'`` is subtracting their part: what Dubrule's formula says
    of the sparse model's covariance, at the cost of one m x m factor a fold.
    """
    _, a, noise = whitened(learnt, state.inducing, inputs)
    without = SparseState(
        state.inducing,
        state.root,
        state.precision - a @ a.T,
        state.weighted - a @ values / math.sqrt(noise),
        state.signal,
        state.noise,
    )
    return predict_scaled(learnt, without, inputs)


def greedy_points(learnt: Hyperparameters, inputs: Tensor, count: int) -> Tensor:
    """Rows that, one after the other, have the largest variance given those before.

    A partial pivoted Cholesky factorisation of the rows' correlations; ends early where
    nothing is left to explain.
    """
    scales = torch.as_tensor(learnt.length_scales, dtype=inputs.dtype, device=inputs.device)
    scaled = inputs / scales
    left = torch.ones(len(inputs), dtype=inputs.dtype, device=inputs.device)
    factor = torch.zeros((min(count, len(inputs)), len(inputs)), dtype=inputs.dtype)
    factor = factor.to(inputs.device)
    chosen: list[int] = []
    for step in range(len(factor)):
        pivot = int(left.argmax())
        if float(left[pivot]) < 1e-10:
            break
        squared = (scaled - scaled[pivot]).square_().sum(1).mul_(5.0)
        distance = squared.sqrt()
        row = squared.div_(3.0).add_(distance).add_(1.0).mul_(distance.neg_().exp_())
        row -= factor[:step, pivot] @ factor[:step]
        factor[step] = row / left[pivot].sqrt()
        left = left.addcmul_(factor[step], factor[step], value=-1.0).clamp_min_(0.0)
        chosen.append(pivot)
    return inputs[torch.as_tensor(chosen, device=inputs.device)]


def whitened(
    learnt: Hyperparameters, points: Tensor, inputs: Tensor
) -> tuple[Tensor, Tensor, float]:
    """Root of the inducing covariance, whitened cross covariance over the noise sd, the noise.

    Args:
        learnt: the kernel.
        points: (m, d) inducing points.
        inputs: (n, d) scaled rows.

    Returns:
        (m, m), (m, n) and the noise variance.
    """
    noise = learnt.signal_variance * learnt.noise_ratio
    with torch.no_grad():
        kernel = kernel_of(learnt.length_scales, points)
        k_uu = kernel(points).to_dense()
        k_uu = k_uu + JITTER * torch.eye(len(points), dtype=k_uu.dtype, device=k_uu.device)
        root = torch.linalg.cholesky(k_uu)
        k_uf = kernel(points, inputs).to_dense()
        half = torch.linalg.solve_triangular(root, k_uf, upper=False)
    return root, half * math.sqrt(learnt.signal_variance / noise), noise


def _matern(left: Tensor, right: Tensor, scales: Tensor) -> Tensor:
    # GPyTorch's kernel with the length scales as a differentiable argument.
    return cast("Tensor", _Matern.apply(left, right, scales))  # type: ignore[no-untyped-call]


class _Matern(torch.autograd.Function):
    """Matern 5/2 correlations, (m, n); the slope by the length scales is written out.

    With s the squared distance in length scales, ``d k / d log l_c`` is
    ``5/3 (1 + sqrt(5 s)) exp(-sqrt(5 s))`` times the part of s that column c has: no root of
    nought, and a third of the time of autograd through the single steps.
    """

    @staticmethod
    def forward(ctx: Any, left: Tensor, right: Tensor, scales: Tensor) -> Tensor:
        gaps = [(left[:, None, c] - right[None, :, c]).square_() for c in range(left.shape[1])]
        squared = gaps[0] / scales[0].square()
        for gap, scale in zip(gaps[1:], scales[1:], strict=True):
            squared.add_(gap / scale.square())
        distance = squared.mul(5.0).sqrt_()
        decay = distance.neg().exp_()
        if any(ctx.needs_input_grad):
            ctx.save_for_backward(scales, distance, decay, *gaps)
        return squared.mul_(5.0 / 3.0).add_(distance).add_(1.0).mul_(decay)

    @staticmethod
    def backward(ctx: Any, *by: Tensor) -> tuple[None, None, Tensor]:
        scales, distance, decay, *gaps = ctx.saved_tensors
        weighted = (distance + 1.0).mul_(decay).mul_(by[0]).flatten()
        each = torch.stack([weighted @ gap.flatten() for gap in gaps])
        return None, None, each * (5.0 / 3.0) / scales**3
