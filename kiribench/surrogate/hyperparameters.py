"""What an exact Gaussian process has learnt besides its data: scalings and kernel parameters."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.surrogate.strain_path import along

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Parameters:
    """Kernel parameters in scaled inputs.

    Attributes:
        length_scales: (d,), with a corner (d + 1,) of which the last but one is the angle's, or
            (1,) for one scale over all inputs.
        warp: (d - 1, 2) extra slopes p and q at the two ends; not used where nothing is warped.
        noise_ratio: noise variance over signal variance.
        corner: (2,) how far outside the range the corner of the angle lies, see
            :class:`kiribench.surrogate.kernel_form.KernelForm`; not used without an angle.
        curve_noise: variance that all rows of a design have in common, over signal variance.
    """

    length_scales: FloatArray
    warp: FloatArray
    noise_ratio: float
    corner: FloatArray = field(default_factory=lambda: np.ones(2))
    curve_noise: float = 0.0


@dataclass(frozen=True)
class Hyperparameters:
    """Scalings of inputs and targets, and the kernel's parameters in scaled units.

    The process is ``y = target_mean + target_scale f((x - input_low) / input_span)``.

    Attributes:
        input_low, input_span: d numbers, units of the inputs (of the strain along the path).
        target_mean, target_scale: unit of the targets.
        length_scales: d numbers (d + 1 with a corner), or one for all inputs, in scaled inputs.
        warp: d - 1 pairs of extra end slopes; empty where designs are not warped.
        signal_variance: of the scaled process.
        noise_ratio: noise variance over signal variance.
        corner: two numbers, or empty where there is no angle.
        curve_noise: variance common to a design's rows, over signal variance.
        spread: factor on the standard deviations, from left-out designs of the training data.
        path: of :func:`kiribench.surrogate.strain_path.strain_path`, or empty: the last input is
            then the strain as it is.
    """

    input_low: tuple[float, ...]
    input_span: tuple[float, ...]
    target_mean: float
    target_scale: float
    length_scales: tuple[float, ...]
    warp: tuple[tuple[float, float], ...]
    signal_variance: float
    noise_ratio: float
    corner: tuple[float, ...] = ()
    curve_noise: float = 0.0
    spread: float = 1.0
    path: tuple[tuple[float, ...], ...] = ()

    @property
    def noise_variance(self) -> float:
        """Variance of an observation about the scaled process."""
        return self.signal_variance * (self.noise_ratio + self.curve_noise)

    @property
    def noise_sd(self) -> float:
        """Standard deviation of an observation about the process, unit of the targets."""
        return float(np.sqrt(self.noise_variance) * self.target_scale)

    def observation_sd(self, variance: FloatArray) -> FloatArray:
        """Standard deviation of observations, unit of the targets.

        Args:
            variance: (n,) of the scaled process, noise-free.
        """
        sd = np.sqrt(variance + self.noise_variance) * self.target_scale * self.spread
        return np.asarray(sd, dtype=np.float64)

    @property
    def signal_sd(self) -> float:
        """Prior standard deviation of the process, unit of the targets."""
        return float(np.sqrt(self.signal_variance) * self.target_scale)

    def kernel_parameters(self) -> Parameters:
        """What the kernel needs of these."""
        designs = len(self.input_low) - 1
        warp = np.array(self.warp) if self.warp else np.zeros((designs, 2))
        corner = np.array(self.corner) if self.corner else np.ones(2)
        return Parameters(
            np.array(self.length_scales), warp, self.noise_ratio, corner, self.curve_noise
        )

    def scale_inputs(self, X: FloatArray) -> FloatArray:
        """(n, d) inputs in the kernel's units."""
        return np.asarray(
            (self.along_path(X) - np.array(self.input_low)) / np.array(self.input_span)
        )

    def along_path(self, X: FloatArray) -> FloatArray:
        """(n, d) inputs, the strain along the path of each row's design where there are paths."""
        if not self.path:
            return X
        designs = (X[:, :-1] - np.array(self.input_low[:-1])) / np.array(self.input_span[:-1])
        return np.column_stack([X[:, :-1], along(self.path, designs, X[:, -1])])

    def scale_targets(self, y: FloatArray) -> FloatArray:
        """Targets as the process sees them."""
        return np.asarray((y - self.target_mean) / self.target_scale)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> Hyperparameters:
        """The inverse of :meth:`as_dict`.

        Raises:
            KeyError: a number is not there.
            ValueError: a number cannot be what it should.
        """
        read = cls(
            input_low=tuple(map(float, record["input_low"])),
            input_span=tuple(map(float, record["input_span"])),
            target_mean=float(record["target_mean"]),
            target_scale=float(record["target_scale"]),
            length_scales=tuple(map(float, record["length_scales"])),
            warp=tuple((float(low), float(high)) for low, high in record["warp"]),
            signal_variance=float(record["signal_variance"]),
            noise_ratio=float(record["noise_ratio"]),
            corner=tuple(map(float, record["corner"])),
            curve_noise=float(record["curve_noise"]),
            spread=float(record["spread"]),
            path=tuple(tuple(map(float, row)) for row in record["path"]),
        )
        positive = (*read.input_span, read.target_scale, *read.length_scales, read.signal_variance)
        others = (*read.input_low, read.target_mean, read.noise_ratio, read.curve_noise)
        if not (
            np.isfinite([*positive, *others, read.spread]).all()
            and min(*positive, read.spread) > 0.0
            and min(read.noise_ratio, read.curve_noise, *np.ravel(read.warp), *read.corner) >= 0.0
        ):
            raise ValueError("hyperparameters that no process has")
        return read


def scaling_of(
    X: FloatArray, y: FloatArray, *, inputs: str, centre: bool
) -> tuple[FloatArray, FloatArray, float, float]:
    """Low and span of each input, mean and scale of the targets.

    Args:
        X: (n, d).
        y: (n,).
        inputs: ``"range"`` maps each input's range to [0, 1], ``"none"`` leaves them.
        centre: subtract the targets' mean.
    """
    if inputs == "range":
        low, span = X.min(axis=0), np.ptp(X, axis=0)
        span = np.where(span > 0.0, span, 1.0)
    else:
        low, span = np.zeros(X.shape[1]), np.ones(X.shape[1])
    mean = float(y.mean()) if centre else 0.0
    scale = float(np.sqrt(np.mean((y - mean) ** 2)))
    # Rounding leaves a constant target a scale of 1e-17 instead of 0.
    if scale <= 1e-12 * max(1.0, float(np.abs(y).max())):
        scale = 1.0
    return low, span, mean, scale
