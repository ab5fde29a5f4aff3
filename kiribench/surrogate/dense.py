"""Exact Gaussian process algebra on scattered rows: one Cholesky factor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

Tensor = torch.Tensor


@dataclass(frozen=True, eq=False)
class DenseConditioned:
    """A process conditioned on scattered rows, covariance ``s2 (K + g I)``.

    Attributes:
        root: (n, n) lower Cholesky factor of ``K + g I``.
        alpha: (n,) its inverse times the values.
        values: (n,).
        signal: s2, given or its maximum-likelihood value.
        noise_ratio: g.
    """

    root: Tensor
    alpha: Tensor
    values: Tensor
    signal: float
    noise_ratio: float

    @property
    def negative_log_likelihood(self) -> float:
        """Minus the log marginal likelihood of the values (Rasmussen & Williams eq. 2.30)."""
        n = len(self.values)
        return 0.5 * (
            n * math.log(2.0 * math.pi * self.signal)
            + 2.0 * float(self.root.diagonal().log().sum())
            + float(self.values @ self.alpha) / self.signal
        )


def condition(
    k: Tensor, noise_ratio: float, values: Tensor, signal: float | None = None
) -> DenseConditioned:
    """Condition on ``values`` (n,), their correlations ``k`` (n, n).

    ``signal`` ``None`` takes the maximum-likelihood variance.
    """
    covariance = k.clone()
    covariance.diagonal().add_(noise_ratio)
    root = torch.linalg.cholesky(covariance)
    alpha = torch.cholesky_solve(values[:, None], root)[:, 0]
    if signal is None:
        signal = max(float(values @ alpha) / len(values), 1e-300)
    return DenseConditioned(root, alpha, values, signal, noise_ratio)


def likelihood_gradient(at: DenseConditioned) -> tuple[Tensor, float]:
    """Derivatives of the negative log likelihood by the entries of K, (n, n), and by g."""
    inverse = torch.cholesky_inverse(at.root)
    by_k = 0.5 * (inverse - torch.outer(at.alpha, at.alpha) / at.signal)
    return by_k, float(by_k.diagonal().sum())


def predict(at: DenseConditioned, cross: Tensor) -> tuple[Tensor, Tensor]:
    """(t,) means and noise-free variances at points of correlations ``cross`` (t, n)."""
    mean = cross @ at.alpha
    half = torch.linalg.solve_triangular(at.root, cross.T, upper=False)
    return mean, at.signal * (1.0 - half.square().sum(0)).clamp_min(0.0)


def leave_rows_out(
    at: DenseConditioned, inverse: Tensor, fold: Tensor, cross: Tensor
) -> tuple[Tensor, Tensor]:
    """Predict rows from all others, hyperparameters fixed (Dubrule 1983, doi:10.1007/BF01033030).

    Args:
        at: the process conditioned on all rows.
        inverse: (n, n) of ``K + g I``.
        fold: (q,) rows to leave out.
        cross: (t, n) correlations of the process at t points with all rows, without any noise.

    Returns:
        (t,) means and (t,) noise-free variances.
    """
    block = torch.linalg.cholesky(inverse[fold][:, fold])
    residual = torch.cholesky_solve(at.alpha[fold][:, None], block)
    # The others' weights; those of the fold vanish, and with them what it shares with itself.
    alpha = at.alpha - (inverse[:, fold] @ residual)[:, 0]
    weighted = cross @ inverse
    lost = torch.linalg.solve_triangular(block, weighted[:, fold].T, upper=False)
    explained = (weighted * cross).sum(1) - lost.square().sum(0)
    return cross @ alpha, at.signal * (1.0 - explained).clamp_min(0.0)
