"""Exact Gaussian process algebra on a designs x strains grid, complete or partly observed.

The covariance is ``s2 (K_d (x) K_s + g I)``: correlations over p designs and m strains,
signal variance s2, noise ratio g. With ``K_d = U diag(l) U'`` and ``K_s = V diag(u) V'``
every solve costs p^3 + m^3 instead of (p m)^3.

Entries M that are not observed are filled with their conditional mean, which makes
``Q y`` vanish there (Q the inverse covariance of the full grid): then ``(Q y)`` is the
inverse covariance of the *observed* rows times their values, exactly. The same identity
leaves folds out in closed form (Dubrule 1983, doi:10.1007/BF01033030):
``y_I - mu_I = Q_II^-1 (Q y)_I``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

Tensor = torch.Tensor


@dataclass(frozen=True, eq=False)
class Factors:
    """Eigen-factors of a grid's covariance.

    Attributes:
        u, v: (p, p) and (m, m) eigenvectors, in columns.
        lam, mu: (p,) and (m,) eigenvalues, not negative.
        weights: (p, m), ``1 / (lam mu + g)``.
        noise_ratio: g.
    """

    u: Tensor
    v: Tensor
    lam: Tensor
    mu: Tensor
    weights: Tensor
    noise_ratio: float


def factorise(k_design: Tensor, k_strain: Tensor, noise_ratio: float) -> Factors:
    """The eigen-factors of ``k_design (x) k_strain + noise_ratio I``."""
    lam, u = torch.linalg.eigh(k_design)
    mu, v = torch.linalg.eigh(k_strain)
    lam, mu = lam.clamp_min(0.0), mu.clamp_min(0.0)  # rounding makes some -1e-14
    weights = 1.0 / (lam[:, None] * mu[None, :] + noise_ratio)
    return Factors(u, v, lam, mu, weights, noise_ratio)


@dataclass(frozen=True, eq=False)
class Conditioned:
    """A grid's process conditioned on its observed entries.

    Attributes:
        factors: of the full grid.
        alpha: (p, m) in the eigenbasis: the inverse covariance times the filled values.
        filled: (p, m) values, the missing ones by their conditional mean.
        missing: (k,) flat indices of the missing entries.
        root: (k, k) Cholesky factor of Q_MM.
        signal: s2, given or its maximum-likelihood value.
        count: number of observed entries.
        log_det: of the observed entries' ``K + g I`` (without s2).
    """

    factors: Factors
    alpha: Tensor
    filled: Tensor
    missing: Tensor
    root: Tensor
    signal: float
    count: int
    log_det: float

    @property
    def negative_log_likelihood(self) -> float:
        """Minus the log marginal likelihood of the observed values."""
        quadratic = float((self.factors.u.T @ self.filled @ self.factors.v * self.alpha).sum())
        return 0.5 * (
            self.count * math.log(2.0 * math.pi * self.signal)
            + self.log_det
            + quadratic / self.signal
        )


def condition(
    factors: Factors, values: Tensor, missing: Tensor, signal: float | None = None
) -> Conditioned:
    """Condition on the entries of ``values`` that are not ``missing``.

    Args:
        factors: of the grid's covariance.
        values: (p, m); what stands at missing entries does not matter.
        missing: (k,) flat indices, int64.
        signal: s2; ``None`` takes the maximum-likelihood value.
    """
    log_det = -float(factors.weights.log().sum())
    count = values.numel() - len(missing)
    filled = values.clone()
    filled.view(-1)[missing] = 0.0
    alpha = factors.weights * (factors.u.T @ filled @ factors.v)
    root = torch.linalg.cholesky(inverse_block(factors, missing))
    if len(missing):
        q_y = (factors.u @ alpha @ factors.v.T).reshape(-1)[missing]
        filled.view(-1)[missing] = -torch.cholesky_solve(q_y[:, None], root)[:, 0]
        alpha = factors.weights * (factors.u.T @ filled @ factors.v)
        log_det += 2.0 * float(root.diagonal().log().sum())
    if signal is None:
        # The missing entries add nothing: alpha vanishes there.
        quadratic = float((factors.u.T @ filled @ factors.v * alpha).sum())
        signal = max(quadratic / count, 1e-300)
    return Conditioned(factors, alpha, filled, missing, root, signal, count, log_det)


@dataclass(frozen=True, eq=False)
class LikelihoodGradient:
    """Derivatives of the negative log likelihood, s2 at its maximum-likelihood value.

    Attributes:
        k_design, k_strain: (p, p) and (m, m), by the entries of the two correlations.
        noise_ratio: by g.
    """

    k_design: Tensor
    k_strain: Tensor
    noise_ratio: float


def likelihood_gradient(at: Conditioned) -> LikelihoodGradient:
    """The gradient at a conditioned grid (its ``signal`` the maximum-likelihood one)."""
    f = at.factors
    trace_design = (f.weights * f.mu[None, :]).sum(1)
    trace_strain = (f.weights * f.lam[:, None]).sum(0)
    by_design = torch.diag(trace_design) - (at.alpha * f.mu[None, :]) @ at.alpha.T / at.signal
    by_strain = torch.diag(trace_strain) - (at.alpha.T * f.lam[None, :]) @ at.alpha / at.signal
    by_noise = float(f.weights.sum()) - float(at.alpha.square().sum()) / at.signal
    if len(at.missing):
        k, p, m = len(at.missing), len(f.lam), len(f.mu)
        rows = f.u[at.missing // m][:, :, None] * f.v[at.missing % m][:, None, :]
        weighted = (rows * f.weights).reshape(k, p * m)
        w = torch.linalg.solve_triangular(at.root, weighted, upper=False).reshape(k, p, m)
        left = w.permute(1, 0, 2).reshape(p, k * m)
        by_design = by_design - (left * f.mu.repeat(k)[None, :]) @ left.T
        right = w.permute(2, 0, 1).reshape(m, k * p)
        by_strain = by_strain - (right * f.lam.repeat(k)[None, :]) @ right.T
        by_noise -= float(w.square().sum())
    return LikelihoodGradient(
        0.5 * f.u @ by_design @ f.u.T, 0.5 * f.v @ by_strain @ f.v.T, 0.5 * by_noise
    )


def predict(
    at: Conditioned, cross_design: Tensor, cross_strain: Tensor, row_design: Tensor
) -> tuple[Tensor, Tensor]:
    """Mean and variance of the noise-free process at new points.

    Args:
        at: the conditioned grid.
        cross_design: (q, p) correlations of the points' q designs with the grid's designs.
        cross_strain: (t, m) correlations of the points with the grid's strains.
        row_design: (t,) which of the q designs each point has.

    Returns:
        (t,) means and (t,) variances, both in the values' unit (squared).
    """
    f = at.factors
    pd, ps = cross_design @ f.u, cross_strain @ f.v
    mean = ((pd @ at.alpha)[row_design] * ps).sum(1)
    explained = ((pd.square() @ f.weights)[row_design] * ps.square()).sum(1)
    if len(at.missing):
        crossed = _crossed(f, at.missing, pd, ps, row_design)
        half = torch.linalg.solve_triangular(at.root, crossed, upper=False)
        explained = explained - half.square().sum(0)
    variance = at.signal * (1.0 - explained).clamp_min(0.0)
    return mean, variance


def leave_designs_out(
    at: Conditioned, fold: Tensor, row_design: Tensor, cross_design: Tensor, cross_strain: Tensor
) -> tuple[Tensor, Tensor]:
    """Predict the rows of whole designs from all others, hyperparameters fixed.

    In the strain eigenbasis Q_II is block diagonal, one (q, q) block an eigenvalue, so ten
    folds of 441 designs x 25 strains take hundredths of a second. Entries that are missing
    in the other designs join I by their Schur complement.

    Args:
        at: the grid conditioned on everything.
        fold: (q,) indices of the designs to leave out.
        row_design: (t,) position in ``fold`` of each row's design.
        cross_design: (q, p) correlations of the left-out designs with all designs.
        cross_strain: (t, m) correlations of the rows' strains with the grid's.

    Returns:
        (t,) means and (t,) noise-free variances.
    """
    f, m = at.factors, len(at.factors.mu)
    rows = f.u[fold]
    scaled = rows[None, :, :] * f.weights.T[:, None, :]  # (m, q, p)
    blocks = torch.linalg.cholesky(scaled @ rows.T)
    pd, ps = cross_design @ f.u, cross_strain @ f.v
    half_y = _solve(blocks, (rows @ at.alpha).T[:, :, None])  # (m, q, 1)
    half_k = _solve(blocks, scaled @ pd.T)  # (m, q, q)
    explained = ((pd.square() @ f.weights - half_k.square().sum(1).T)[row_design]) * ps.square()
    gained = torch.zeros_like(explained[:, 0])
    here = ~torch.isin(at.missing // m, fold)
    missing = at.missing[here]
    change = torch.zeros_like(at.alpha)
    if len(missing):
        um, vm = f.u[missing // m], f.v[missing % m]
        half_m = _solve(blocks, (scaled @ um.T) * vm.T[:, None, :])  # (m, q, k)
        schur = inverse_block(f, missing) - torch.einsum("jik,jil->kl", half_m, half_m)
        root = torch.linalg.cholesky(schur)
        # (Q y)_M vanishes: the missing entries are already filled by what all rows say.
        right = -torch.einsum("jik,ji->k", half_m, half_y[:, :, 0])
        x_m = torch.cholesky_solve(right[:, None], root)[:, 0]
        half_y = half_y - (half_m @ x_m)[:, :, None]
        change = um.T @ (vm * x_m[:, None])
        crossed = _crossed(f, missing, pd, ps, row_design)
        for j in range(m):
            crossed -= (half_m[j].T @ half_k[j])[:, row_design] * ps[:, j]
        gained = torch.linalg.solve_triangular(root, crossed, upper=False).square().sum(0)
    residual = torch.linalg.solve_triangular(blocks.mT, half_y, upper=True)[:, :, 0].T  # (q, m)
    alpha = at.alpha - f.weights * (rows.T @ residual + change)
    mean = ((pd @ alpha)[row_design] * ps).sum(1)
    variance = at.signal * (1.0 - explained.sum(1) + gained).clamp_min(0.0)
    return mean, variance


def leave_entries_out(
    at: Conditioned,
    entries: Tensor,
    cross_design: Tensor,
    cross_strain: Tensor,
    row_design: Tensor,
) -> tuple[Tensor, Tensor]:
    """Predict observed grid entries from all other observed ones, hyperparameters fixed.

    Args:
        at: the grid conditioned on everything.
        entries: (t,) flat indices, none of them missing.
        cross_design: (q, p) correlations of the entries' q designs with all designs, noise-free.
        cross_strain: (t, m) correlations of the entries' strains with the grid's.
        row_design: (t,) which of the q designs each entry has.

    Returns:
        (t,) means and (t,) noise-free variances.
    """
    f = at.factors
    hidden = torch.cat([entries, at.missing])
    root = torch.linalg.cholesky(inverse_block(f, hidden))
    q_y = (f.u @ at.alpha @ f.v.T).reshape(-1)[hidden]
    residual = torch.zeros_like(at.filled)
    residual.view(-1)[hidden] = torch.cholesky_solve(q_y[:, None], root)[:, 0]
    alpha = at.alpha - f.weights * (f.u.T @ residual @ f.v)
    pd, ps = cross_design @ f.u, cross_strain @ f.v
    mean = ((pd @ alpha)[row_design] * ps).sum(1)
    explained = ((pd.square() @ f.weights)[row_design] * ps.square()).sum(1)
    crossed = _crossed(f, hidden, pd, ps, row_design)
    lost = torch.linalg.solve_triangular(root, crossed, upper=False).square().sum(0)
    return mean, at.signal * (1.0 - explained + lost).clamp_min(0.0)


def inverse_block(factors: Factors, entries: Tensor) -> Tensor:
    """(k, k) block of the inverse covariance at flat grid indices.

    Entries share designs, so the costly product is done once for each pair of designs.
    """
    m = len(factors.mu)
    designs, which = torch.unique(entries // m, return_inverse=True)
    u, v = factors.u[designs], factors.v[entries % m]
    block: Tensor = torch.zeros((len(entries), len(entries)), dtype=u.dtype, device=u.device)
    for j in range(m):
        pairs = (u * factors.weights[:, j]) @ u.T
        block += pairs[which][:, which] * (v[:, j, None] * v[None, :, j])
    return block


def _solve(blocks: Tensor, right: Tensor) -> Tensor:
    solved: Tensor = torch.linalg.solve_triangular(blocks, right, upper=False)
    return solved


def _crossed(f: Factors, entries: Tensor, pd: Tensor, ps: Tensor, row_design: Tensor) -> Tensor:
    """(k, t): rows of the inverse covariance at grid entries times the points' correlations.

    Args:
        f: of the grid.
        entries: (k,) flat indices.
        pd, ps: (q, p) and (t, m) correlations in the eigenbasis.
        row_design: (t,) which of the q designs each point has.
    """
    m = len(f.mu)
    designs, which = torch.unique(entries // m, return_inverse=True)
    u, v = f.u[designs], f.v[entries % m]
    total = torch.zeros((len(entries), len(ps)), dtype=u.dtype, device=u.device)
    for j in range(m):
        pairs = (u * f.weights[:, j]) @ pd.T
        total += pairs[which][:, row_design] * (v[:, j, None] * ps[None, :, j])
    return total
