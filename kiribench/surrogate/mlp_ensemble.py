"""An ensemble of small neural networks, trained side by side on torch."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.surrogate.devices import device_of, torch_threads
from kiribench.surrogate.hyperparameters import scaling_of

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]
FLOAT = torch.float32


class MLPEnsemble(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Networks with two hidden layers that differ in their start and their batches.

    The mean of the members is the prediction; their spread and the residuals of training
    are its variance (deep ensembles, Lakshminarayanan et al. 2017, arXiv 1612.01474,
    without the learnt noise). All members are one batched network: four cost little more
    than one. It computes in float32: its errors are thousands of times larger than rounding.

    Args:
        members: networks.
        width: neurons of each hidden layer.
        max_steps: Adam steps, learning rate falling to zero along a cosine.
        batch: rows of a step, drawn anew for each member.
        learning_rate: at the start.
        device: ``"cpu"`` or ``"cuda"``.
        threads: torch's CPU threads, ``None`` leaves torch's own choice.
        random_state: seed.
    """

    def __init__(
        self,
        *,
        members: int = 4,
        width: int = 48,
        max_steps: int = 800,
        batch: int = 256,
        learning_rate: float = 0.01,
        device: str = "cpu",
        threads: int | None = 1,
        random_state: int | None = 0,
    ) -> None:
        self.members = members
        self.width = width
        self.max_steps = max_steps
        self.batch = batch
        self.learning_rate = learning_rate
        self.device = device
        self.threads = threads
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> MLPEnsemble:
        """Train on (n, d) rows and (n,) targets."""
        X_, y_ = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        low, span, mean, scale = scaling_of(X_, y_, inputs="range", centre=True)
        self.input_low_, self.input_span_ = low, span
        self.target_mean_, self.target_scale_ = mean, scale
        place = device_of(self.device)
        with torch_threads(self.threads):
            inputs = torch.as_tensor(self._scaled(X_), dtype=FLOAT, device=place)
            values = torch.as_tensor((y_ - mean) / scale, dtype=FLOAT, device=place)
            self._layers = self._train(inputs, values)
            with torch.no_grad():
                residual = _forward(self._layers, inputs).mean(0) - values
        self.noise_variance_ = float(residual.square().mean()) + 1e-12
        return self

    def _train(self, inputs: Tensor, values: Tensor) -> list[Tensor]:
        # Numbers are drawn on the CPU: the same seed means the same start on any device.
        generator = torch.Generator().manual_seed(
            0 if self.random_state is None else int(self.random_state)
        )
        sizes = (inputs.shape[1], self.width, self.width, 1)
        layers: list[Tensor] = []
        for fan_in, fan_out in pairwise(sizes):
            shape = (self.members, fan_in, fan_out)
            weight = torch.randn(shape, generator=generator, dtype=torch.float64)
            layers += [weight / math.sqrt(fan_in), torch.zeros(self.members, 1, fan_out)]
        layers = [x.to(inputs.device, FLOAT).requires_grad_(True) for x in layers]
        optimiser = torch.optim.Adam(layers, lr=self.learning_rate)
        rows = min(self.batch, len(inputs))
        for step in range(self.max_steps):
            for group in optimiser.param_groups:
                progress = step / self.max_steps
                group["lr"] = 0.5 * self.learning_rate * (1.0 + math.cos(math.pi * progress))
            drawn = torch.randint(len(inputs), (self.members, rows), generator=generator)
            drawn = drawn.to(inputs.device)
            loss = (_forward(layers, inputs[drawn]) - values[drawn]).square().mean((1,)).sum()
            optimiser.zero_grad(set_to_none=True)
            torch.autograd.backward((loss,))
            optimiser.step()
        return [x.detach() for x in layers]

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, X: ArrayLike, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    def predict(
        self, X: ArrayLike, return_std: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Mean of the members at (t, d) points, and the standard deviation of an observation."""
        check_is_fitted(self, "noise_variance_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        with torch_threads(self.threads), torch.no_grad():
            inputs = torch.as_tensor(self._scaled(X_), dtype=FLOAT, device=self._layers[0].device)
            each = _forward(self._layers, inputs).double()
            mean, spread = each.mean(0).cpu().numpy(), each.var(0, correction=1).cpu().numpy()
        centred = np.asarray(mean * self.target_scale_ + self.target_mean_)
        if not return_std:
            return centred
        return centred, np.asarray(np.sqrt(spread + self.noise_variance_) * self.target_scale_)

    def _scaled(self, X: FloatArray) -> FloatArray:
        # To [-1, 1]: what the start of the weights is made for.
        return np.asarray(2.0 * (X - self.input_low_) / self.input_span_ - 1.0)


def _forward(layers: list[Tensor], inputs: Tensor) -> Tensor:
    """(members, n) outputs; inputs (n, d) for all members or (members, n, d) each its own."""
    x = inputs
    for weight, bias in zip(layers[0:-2:2], layers[1:-2:2], strict=True):
        x = torch.nn.functional.silu(torch.matmul(x, weight) + bias)
    return (torch.matmul(x, layers[-2]) + layers[-1])[..., 0]
