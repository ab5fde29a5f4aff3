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
BETAS, EPSILON = (0.9, 0.999), 1e-8  # of Adam, as its authors have them


class MLPEnsemble(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Networks with two hidden layers that differ in their start and their batches.

    The mean of the members is the prediction; their spread and the residuals of training
    are its variance (deep ensembles, Lakshminarayanan et al. 2017, arXiv 1612.01474,
    without the learnt noise). All members are one batched network: four cost little more
    than one. The gradient is written out and Adam (Kingma and Ba 2015, arXiv 1412.6980) steps
    on one vector: for networks of this size autograd and torch's optimiser took twice the
    time. It learns in float32: its errors are thousands of times larger than rounding.

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
        max_steps: int = 1000,
        batch: int = 128,
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
            with torch.no_grad():
                self._layers = [layer.double() for layer in self._train(inputs, values)]
                residual = _forward(self._layers, inputs.double()).mean(0) - values
        self.noise_variance_ = float(residual.square().mean()) + 1e-12
        return self

    def _train(self, inputs: Tensor, values: Tensor) -> list[Tensor]:
        # Numbers are drawn on the CPU: the same seed means the same start on any device.
        generator = torch.Generator().manual_seed(
            0 if self.random_state is None else int(self.random_state)
        )
        sizes = (inputs.shape[1], self.width, self.width, 1)
        network = _Network(self.members, sizes, inputs.device)
        for weight in network.layers[::2]:
            drawn = torch.randn(weight.shape, generator=generator, dtype=torch.float64)
            weight.copy_(drawn / math.sqrt(weight.shape[1]))
        shape = (self.max_steps, self.members, min(self.batch, len(inputs)))
        batches = torch.randint(len(inputs), shape, generator=generator).to(inputs.device)
        mean, square = torch.zeros_like(network.flat), torch.zeros_like(network.flat)
        for step, rows in enumerate(batches):
            slope = network.slope(inputs[rows], values[rows])
            mean.lerp_(slope, 1.0 - BETAS[0])
            square.mul_(BETAS[1]).addcmul_(slope, slope, value=1.0 - BETAS[1])
            rate = 0.5 * self.learning_rate * (1.0 + math.cos(math.pi * step / self.max_steps))
            rate /= 1.0 - BETAS[0] ** (step + 1)
            root = square.sqrt().div_(math.sqrt(1.0 - BETAS[1] ** (step + 1))).add_(EPSILON)
            network.flat.addcdiv_(mean, root, value=-rate)
        return network.layers

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
            inputs = torch.as_tensor(self._scaled(X_), device=self._layers[0].device)
            each = _forward(self._layers, inputs)
            mean, spread = each.mean(0).cpu().numpy(), each.var(0, correction=1).cpu().numpy()
        centred = np.asarray(mean * self.target_scale_ + self.target_mean_)
        if not return_std:
            return centred
        return centred, np.asarray(np.sqrt(spread + self.noise_variance_) * self.target_scale_)

    def _scaled(self, X: FloatArray) -> FloatArray:
        # To [-1, 1]: what the start of the weights is made for.
        return np.asarray(2.0 * (X - self.input_low_) / self.input_span_ - 1.0)


class _Network:
    """Weights and biases of all members in one vector, and the slope of the loss by it.

    Attributes:
        flat: all of them.
        layers: views of it: (members, fan in, fan out) and (members, 1, fan out) in turn.
    """

    def __init__(self, members: int, sizes: tuple[int, ...], place: torch.device) -> None:
        shapes = [
            (members, rows, fan_out) for fan_in, fan_out in pairwise(sizes) for rows in (fan_in, 1)
        ]
        self.flat = torch.zeros(sum(map(math.prod, shapes)), dtype=FLOAT, device=place)
        self._slope = torch.zeros_like(self.flat)
        counts = [math.prod(shape) for shape in shapes]
        self.layers, self._slopes = (
            [part.view(shape) for part, shape in zip(parts, shapes, strict=True)]
            for parts in (torch.split(self.flat, counts), torch.split(self._slope, counts))
        )

    def slope(self, inputs: Tensor, values: Tensor) -> Tensor:
        """The gradient of the members' mean squared errors, added up, by ``flat``.

        Args:
            inputs: (members, n, d).
            values: (members, n).
        """
        entering, steepness = [inputs], []
        for weight, bias in zip(self.layers[0:-2:2], self.layers[1:-2:2], strict=True):
            z = torch.baddbmm(bias, entering[-1], weight)
            gate = torch.sigmoid(z)
            x = z * gate
            entering.append(x)
            steepness.append(gate + x - x * gate)  # of silu(z) = z gate
        out = torch.baddbmm(self.layers[-1], entering[-1], self.layers[-2])
        by_out = (out - values[..., None]).mul_(2.0 / values.shape[1])
        for layer in reversed(range(len(entering))):
            torch.bmm(entering[layer].mT, by_out, out=self._slopes[2 * layer])
            torch.sum(by_out, dim=1, keepdim=True, out=self._slopes[2 * layer + 1])
            if layer:
                by_out = torch.bmm(by_out, self.layers[2 * layer].mT).mul_(steepness[layer - 1])
        return self._slope


def _forward(layers: list[Tensor], inputs: Tensor) -> Tensor:
    """(members, n) outputs; inputs (n, d) for all members or (members, n, d) each its own."""
    x = inputs
    for weight, bias in zip(layers[0:-2:2], layers[1:-2:2], strict=True):
        x = torch.nn.functional.silu(torch.matmul(x, weight) + bias)
    return (torch.matmul(x, layers[-2]) + layers[-1])[..., 0]
