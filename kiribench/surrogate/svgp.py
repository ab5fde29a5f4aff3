"""Sparse variational Gaussian process with inducing points, for scattered rows.

The collapsed bound of :mod:`kiribench.surrogate.sparse_bound` is maximised: no stochastic
steps, no learning rate. Kernels are GPyTorch's, and the tests compare the bound with
GPyTorch's own ``VariationalELBO``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.errors import UsageError
from kiribench.surrogate.devices import device_of, torch_threads
from kiribench.surrogate.hyperparameters import Hyperparameters, scaling_of
from kiribench.surrogate.likelihood import LENGTH_BOUNDS, MOST_NOISE
from kiribench.surrogate.sparse_bound import (
    SparseState,
    bound,
    greedy_points,
    posterior,
    predict_scaled,
    whitened,
)

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]


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
        inducing: int = 128,
        max_fit_rows: int = 1000,
        hyperparameters: Hyperparameters | None = None,
        optimise: bool = True,
        inducing_points: FloatArray | None = None,
        max_evaluations: int = 32,
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
        root, _, noise = whitened(learnt, points, points[:1])
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
        return centred, learnt.observation_sd(variance.cpu().numpy())


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
