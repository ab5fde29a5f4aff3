"""The form of a Gaussian process's kernel: families, warps, the corner, and its correlations.

The last input is the strain, the others are the design. Whatever the design part is, the kernel
is a product of one over designs and one over strains, so that a grid stays a Kronecker one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters
from kiribench.surrogate.kernels import correlation

Tensor = torch.Tensor

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
        cornered: two design inputs (x, y), scaled to [0, 1], get a third coordinate, the angle
            ``atan2(x + c, 1 - y + c')`` about a point outside the corner of low x and high y,
            with free c and c'. In the cross-cut lattice this is where vertical cuts (b) meet
            horizontal ones (a) of vanishing length: what counts there is the ratio of a to the
            ligament 1 - b, and the response has every value of a whole edge within the corner.
        curve_noise: whether the rows of a design have an error in common (each design has a mesh
            of its own), whose covariance over strains is the process's; it is noise to the
            prediction, which stays smooth.
        free_noise: whether the noise ratio is free; else it is kept.
        noise_floor: least noise ratio. Simulated tables have next to no noise, and the
            likelihood would run to where rounding and the kernel's faults take over.
    """

    design_family: str
    strain_family: str
    inputs: int
    shared_scale: bool = False
    warped: bool = False
    cornered: bool = False
    curve_noise: bool = False
    free_noise: bool = True
    noise_floor: float = 1e-8

    def with_values_of(self, learnt: Hyperparameters) -> KernelForm:
        """The form that such hyperparameters belong to."""
        return replace(self, warped=bool(learnt.warp), cornered=bool(learnt.corner))


def start_parameters(form: KernelForm) -> Parameters:
    """Where the search starts: smooth, one input's range wide, little noise."""
    scales = np.full(1 if form.shared_scale else form.inputs + form.cornered, 0.5)
    if form.cornered:
        scales[-2] = 2.0
    return Parameters(
        length_scales=scales,
        warp=np.full((form.inputs - 1, 2), 0.3),
        noise_ratio=1e-4 if form.free_noise else 1.0,
        corner=np.full(2, 0.02),
        curve_noise=1e-4 if form.curve_noise else 0.0,
    )


def design_correlation(
    form: KernelForm, left: Tensor, right: Tensor, at: TorchParameters
) -> Tensor:
    """(p, q) correlations over the design inputs, (p, d - 1) and (q, d - 1); smooth."""
    scales = at.length_scales if form.shared_scale else at.length_scales[:-1]
    return correlation(
        form.design_family, _coordinates(form, left, at), _coordinates(form, right, at), scales
    )


def observed_design_correlation(form: KernelForm, designs: Tensor, at: TorchParameters) -> Tensor:
    """(p, p) over the designs that were observed: with the error that each has to itself."""
    smooth = design_correlation(form, designs, designs, at)
    return smooth + at.curve_noise * torch.eye(
        len(designs), dtype=designs.dtype, device=designs.device
    )


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


def observed_correlation(form: KernelForm, inputs: Tensor, at: TorchParameters) -> Tensor:
    """(n, n) over the rows that were observed: with the errors that rows of a design share."""
    smooth = full_correlation(form, inputs, inputs, at)
    if form.inputs == 1 or not (form.curve_noise or bool(at.curve_noise.detach() > 0.0)):
        return smooth
    _, design = torch.unique(inputs[:, :-1], dim=0, return_inverse=True)
    same = (design[:, None] == design[None, :]).to(inputs.dtype)
    shared = same * strain_correlation(form, inputs[:, -1:], inputs[:, -1:], at)
    return torch.add(smooth, at.curve_noise * shared)


@dataclass(frozen=True, eq=False)
class TorchParameters:
    """:class:`Parameters` as tensors on the device of the computation."""

    length_scales: Tensor
    warp: Tensor
    corner: Tensor
    curve_noise: Tensor

    def tensors(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Length scales, warp, corner, curve noise."""
        return self.length_scales, self.warp, self.corner, self.curve_noise

    @classmethod
    def of(cls, parameters: Parameters, like: Tensor) -> TorchParameters:
        """The parameters on the device of ``like``."""
        return cls(
            *(
                torch.tensor(value, dtype=like.dtype, device=like.device)
                for value in (
                    parameters.length_scales,
                    parameters.warp,
                    parameters.corner,
                    parameters.curve_noise,
                )
            )
        )


def _coordinates(form: KernelForm, x: Tensor, at: TorchParameters) -> Tensor:
    columns = _warp(x, at.warp) if form.warped else x
    if not form.cornered:
        return columns
    angle = torch.atan2(x[:, 0] + at.corner[0], 1.0 - x[:, 1] + at.corner[1]) / (0.5 * math.pi)
    return torch.cat([columns, angle[:, None]], dim=1)


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
