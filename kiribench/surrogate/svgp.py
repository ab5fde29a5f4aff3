"""Sparse variational Gaussian process with inducing points, for scattered rows.

Titsias 2009 (PMLR 5:567-574): with Gaussian noise the best variational distribution of
the inducing values is known in closed form, and the bound with it put in is what is
maximised; no stochastic steps, no learning rate. Kernels are GPyTorch's, and the tests
compare the bound with GPyTorch's own ``VariationalELBO``. The inducing points are rows,
chosen greedily by conditional variance (Burt et al. 2020, arXiv 2008.00323).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.errors import UsageError
from kiribench.surrogate.devices import device_of, torch_threads
from kiribench.surrogate.gpytorch_import import gpytorch
from kiribench.surrogate.hyperparameters import Hyperparameters, scaling_of
from kiribench.surrogate.likelihood import LENGTH_BOUNDS, MOST_NOISE

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]
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


class SparseVariationalGP(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Sparse variational GP, Matern 5/2 with one length scale an input, float64.

    Args:
        inducing: number of inducing points, at most the number of rows.
        max_fit_rows: rows on which the kernel parameters are learnt (a random choice where
            there are more); the posterior uses all rows.
        hyperparameters: where to start, or with ``optimise=False`` what to use.
        optimise: maximise the bound.
        inducing_points: (m, d) points in the inputs' units to use as they are.
        max_evaluations: limit on evaluations of the bound.
        device: ``"cpu"`` or ``"cuda"``.
        threads: torch's CPU threads, ``None`` leaves torch's own choice.
        random_state: seed of the choice of rows.
    """

    def __init__(
        self,
        *,
        inducing: int = 144,
        max_fit_rows: int = 3000,
        hyperparameters: Hyperparameters | None = None,
        optimise: bool = True,
        inducing_points: FloatArray | None = None,
        max_evaluations: int = 60,
        device: str = "cpu",
        threads: int | None = 1,
        random_state: int | None = 0,
    ) -> None:
        self.inducing = inducing
        self.max_fit_rows = max_fit_rows
        self.hyperparameters = hyperparameters
        self.optimise = optimise
        self.inducing_points = inducing_points
        self.max_evaluations = max_evaluations
        self.device = device
        self.threads = threads
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> SparseVariationalGP:
        """Learn the kernel and the posterior of the inducing values from (n, d) rows.

        Raises:
            UsageError: fixed hyperparameters were asked for but not given.
        """
        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        y_ = np.asarray(y_, dtype=np.float64)
        given = self.hyperparameters
        if given is None and not self.optimise:
            raise UsageError(
                "hyperparameters-absent",
                "There are no hyperparameters to keep.",
                remedy="Pass hyperparameters=..., or leave optimise=True.",
            )
        place = device_of(self.device)
        with torch_threads(self.threads):
            learnt = given if given is not None else _start(X_, y_)
            if self.optimise:
                learnt = self._learn(learnt, X_, y_, place)
            self.hyperparameters_ = learnt
            inputs = torch.as_tensor(learnt.scale_inputs(X_), device=place)
            values = torch.as_tensor(learnt.scale_targets(y_), device=place)
            points = self._points(learnt, inputs)
            self.inducing_points_ = points.cpu().numpy() * np.array(learnt.input_span) + np.array(
                learnt.input_low
            )
            self._state = posterior(learnt, points, inputs, values)
            self._rows, self._values = X_, y_
        return self

    def restore(
        self,
        learnt: Hyperparameters,
        inducing: FloatArray,
        precision: FloatArray,
        weighted: FloatArray,
    ) -> SparseVariationalGP:
        """Become the process that was kept: scaled inducing points, their posterior."""
        place = device_of(self.device)
        points = torch.as_tensor(inducing, device=place)
        self.hyperparameters_, self.evaluations_ = learnt, 0
        self.n_features_in_ = inducing.shape[1]
        self.inducing_points_ = inducing * np.array(learnt.input_span) + np.array(learnt.input_low)
        root, _, noise = _whitened(learnt, points, points[:1])
        self._state = SparseState(
            points,
            root,
            torch.as_tensor(precision, device=place),
            torch.as_tensor(weighted, device=place),
            learnt.signal_variance,
            noise,
        )
        self._rows = np.zeros((0, inducing.shape[1]))
        self._values = np.zeros(0)
        return self

    def _learn(
        self, start: Hyperparameters, X: FloatArray, y: FloatArray, place: torch.device
    ) -> Hyperparameters:
        generator = np.random.default_rng(self.random_state)
        some = np.sort(generator.permutation(len(X))[: self.max_fit_rows])
        low, span, mean, scale = scaling_of(X, y, inputs="range", centre=True)
        learnt = Hyperparameters(
            tuple(low.tolist()),
            tuple(span.tolist()),
            mean,
            scale,
            start.length_scales,
            (),
            start.signal_variance,
            start.noise_ratio,
        )
        inputs = torch.as_tensor(learnt.scale_inputs(X[some]), device=place)
        values = torch.as_tensor(learnt.scale_targets(y[some]), device=place)
        self.evaluations_ = 0
        if self.hyperparameters is None:
            learnt = self._best_start(learnt, inputs, values)
        # The best inducing points depend on the length scales: choose, learn, choose again.
        for _ in range(2):
            points = self._points(learnt, inputs)
            learnt, used = _maximise(learnt, points, inputs, values, self.max_evaluations // 2)
            self.evaluations_ += used
        return learnt

    def _best_start(
        self, learnt: Hyperparameters, inputs: Tensor, values: Tensor
    ) -> Hyperparameters:
        # From a poor start the bound runs to the optimum where everything is noise.
        starts = [
            replace(
                learnt,
                length_scales=tuple(factor * scale for scale in learnt.length_scales),
                noise_ratio=ratio,
            )
            for factor in (0.5, 1.0, 2.0, 4.0)
            for ratio in (1e-3, 1e-1)
        ]

        def bound_at(start: Hyperparameters) -> float:
            numbers = (start.length_scales, start.signal_variance, start.noise_ratio)
            free = [torch.as_tensor(x, dtype=inputs.dtype, device=inputs.device) for x in numbers]
            with torch.no_grad():
                points = self._points(start, inputs)
                return float(bound(free[0], free[1], free[1] * free[2], points, inputs, values))

        self.evaluations_ += len(starts)
        return max(starts, key=bound_at)

    def _points(self, learnt: Hyperparameters, inputs: Tensor) -> Tensor:
        if self.inducing_points is not None:
            given = learnt.scale_inputs(np.asarray(self.inducing_points, dtype=np.float64))
            return torch.as_tensor(given, device=inputs.device)
        return greedy_points(learnt, inputs, self.inducing)

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, X: ArrayLike, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    def predict(
        self, X: ArrayLike, return_std: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Mean at (t, d) points, and the standard deviation of an observation, noise included."""
        check_is_fitted(self, "hyperparameters_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        learnt = self.hyperparameters_
        with torch_threads(self.threads):
            points = torch.as_tensor(learnt.scale_inputs(X_), device=self._state.inducing.device)
            mean, variance = predict_scaled(learnt, self._state, points)
        centred = np.asarray(mean.cpu().numpy() * learnt.target_scale + learnt.target_mean)
        if not return_std:
            return centred
        noisy = variance.cpu().numpy() + self._state.noise
        return centred, np.asarray(np.sqrt(noisy) * learnt.target_scale)


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
    root, a, noise = _whitened(learnt, points, inputs)
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
    _, a, noise = _whitened(learnt, state.inducing, inputs)
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
    left = torch.ones(len(inputs), dtype=inputs.dtype, device=inputs.device)
    factor = torch.zeros((min(count, len(inputs)), len(inputs)), dtype=inputs.dtype)
    factor = factor.to(inputs.device)
    chosen: list[int] = []
    for step in range(len(factor)):
        pivot = int(left.argmax())
        if float(left[pivot]) < 1e-10:
            break
        row = _matern(inputs[pivot][None, :], inputs, scales)[0]
        row = row - factor[:step, pivot] @ factor[:step]
        factor[step] = row / left[pivot].sqrt()
        left = (left - factor[step].square()).clamp_min(0.0)
        chosen.append(pivot)
    return inputs[torch.as_tensor(chosen, device=inputs.device)]


def _whitened(
    learnt: Hyperparameters, points: Tensor, inputs: Tensor
) -> tuple[Tensor, Tensor, float]:
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
    # GPyTorch's kernel with the length scales as a differentiable argument. The small term
    # keeps the root's slope finite for equal points.
    squared = torch.zeros((len(left), len(right)), dtype=left.dtype, device=left.device)
    for column in range(left.shape[1]):
        gap = (left[:, None, column] - right[None, :, column]) / scales[column]
        squared = squared + gap.square()
    distance = (5.0 * squared + 1e-30).sqrt()
    return (1.0 + distance + 5.0 / 3.0 * squared) * torch.exp(-distance)


def _start(X: FloatArray, y: FloatArray) -> Hyperparameters:
    low, span, mean, scale = scaling_of(X, y, inputs="range", centre=True)
    return Hyperparameters(
        tuple(low.tolist()),
        tuple(span.tolist()),
        mean,
        scale,
        # Many inputs make rows far apart.
        (0.5 * float(np.sqrt(X.shape[1])),) * X.shape[1],
        (),
        1.0,
        1e-3,
    )


def _maximise(
    start: Hyperparameters, points: Tensor, inputs: Tensor, values: Tensor, limit: int
) -> tuple[Hyperparameters, int]:
    d = inputs.shape[1]
    noise = start.signal_variance * start.noise_ratio
    first = np.log([*start.length_scales, start.signal_variance, noise])
    bounds = [LENGTH_BOUNDS] * d + [(1e-4, 1e6), (1e-8, MOST_NOISE)]

    def evaluate(vector: FloatArray) -> tuple[float, FloatArray]:
        free = torch.as_tensor(vector, device=inputs.device).exp().requires_grad_(True)
        loss = -bound(free[:d], free[d], free[d + 1], points, inputs, values) / len(values)
        slope = np.asarray(torch.autograd.grad(loss, free)[0].cpu()) * np.exp(vector)
        return float(loss.detach()), slope

    result = minimize(
        evaluate,
        first,
        jac=True,
        method="L-BFGS-B",
        bounds=[(float(np.log(low)), float(np.log(high))) for low, high in bounds],
        options={"maxfun": limit, "ftol": 1e-7, "gtol": 1e-5},
    )
    best = np.exp(np.asarray(result.x))
    learnt = Hyperparameters(
        start.input_low,
        start.input_span,
        start.target_mean,
        start.target_scale,
        tuple(best[:d].tolist()),
        (),
        float(best[d]),
        float(best[d + 1] / best[d]),
    )
    return learnt, int(result.nfev)
