"""The paper's Gaussian process: eqs 2-4, in GPyTorch, float64, always by Cholesky.

Reading of the equations. Eq. 2 adds ``sigma_n^2 I`` to K (noise variance); eq. 3 has
``K_ij = sigma_n^2 exp(-|x_i - x_j|^2 / (2 l^2))`` and then speaks of "some hyper parameters
sigma, l". We read the sigma of eq. 3 as the signal's, a number of its own (its subscript a
misprint): otherwise noise would equal signal, and no data could be fitted closely.
``shared_sigma=True`` is the other reading, to the letter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.grid import DesignGrid
from kiribench.surrogate.hyperparameters import Hyperparameters, scaling_of
from kiribench.surrogate.likelihood import KernelForm

FloatArray = NDArray[np.float64]


class PaperGP(ExactGP):
    """Exact GP with one Gaussian kernel of a single length scale over all inputs.

    With ``solver="auto"`` a grid is solved by Kronecker algebra (the Gaussian kernel is a
    product over the inputs, so it is the same model to rounding) and other rows by
    GPyTorch; ``solver="dense"`` is GPyTorch whatever the rows.

    Args:
        solver: ``"auto"`` or ``"dense"``.
        input_scaling: ``"range"`` maps each input's range to [0, 1] (the paper is silent),
            ``"none"`` takes the columns as they are.
        centre_targets: subtract the targets' mean (eq. 2 has none).
        shared_sigma: noise variance equal to signal variance (see the module).
        hyperparameters: where to start the search, or with ``optimise=False`` what to use.
        optimise: maximise the marginal likelihood (the paper does not say what it did).
        resampling: ``"auto"`` or ``"never"``: curves onto a common strain grid.
        max_dense_rows: refuse more scattered rows than that.
        max_missing: more unobserved grid entries than that are no grid.
        max_evaluations: limit on likelihoods.
        device: ``"cpu"`` or ``"cuda"``.
        threads: torch's CPU threads, ``None`` leaves torch's own choice.
        random_state: seed of the choice of designs where a grid has holes everywhere.
    """

    def __init__(
        self,
        *,
        solver: str = "auto",
        input_scaling: str = "range",
        centre_targets: bool = True,
        shared_sigma: bool = False,
        hyperparameters: Hyperparameters | None = None,
        optimise: bool = True,
        resampling: str = "auto",
        max_dense_rows: int = 12000,
        max_missing: int = 2000,
        max_evaluations: int = 200,
        device: str = "cpu",
        threads: int | None = 1,
        random_state: int | None = 0,
    ) -> None:
        self.solver = solver
        self.input_scaling = input_scaling
        self.centre_targets = centre_targets
        self.shared_sigma = shared_sigma
        self.hyperparameters = hyperparameters
        self.optimise = optimise
        self.resampling = resampling
        self.max_dense_rows = max_dense_rows
        self.max_missing = max_missing
        self.max_evaluations = max_evaluations
        self.device = device
        self.threads = threads
        self.random_state = random_state

    def _kernel_form(self, inputs: int) -> KernelForm:
        return KernelForm(
            "gaussian", "gaussian", inputs, shared_scale=True, free_noise=not self.shared_sigma
        )

    def _scaling(self) -> tuple[str, bool]:
        return self.input_scaling, self.centre_targets

    def _grid_of(self, X: FloatArray, y: FloatArray) -> DesignGrid | None:
        if self.solver == "dense":
            return None
        return super()._grid_of(X, y)

    def _learn(
        self,
        form: KernelForm,
        X: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        start: Hyperparameters | None,
        place: torch.device,
    ) -> Hyperparameters:
        if grid is not None or self.shared_sigma:
            return super()._learn(form, X, y, grid, start, place)
        from kiribench.surrogate.gpytorch_exact import maximise_in_gpytorch

        low, span, mean, scale = scaling_of(
            X, y, inputs=self.input_scaling, centre=self.centre_targets
        )
        unscaled = Hyperparameters(
            tuple(low.tolist()), tuple(span.tolist()), mean, scale, (), (), 1.0, 1.0
        )
        inputs = torch.as_tensor(unscaled.scale_inputs(X), device=place)
        values = torch.as_tensor(unscaled.scale_targets(y), device=place)
        if start is not None:
            starts = [(start.length_scales[0], start.noise_ratio)]
        elif self.input_scaling == "range":
            starts = [(0.5, 1e-4)]
        else:  # several optima: see ExactGP
            starts = [(0.5, 1e-4), (0.5 * float(np.ptp(X, axis=0).max()), 1e-4)]
        found = [maximise_in_gpytorch(inputs, values, x, self.max_evaluations) for x in starts]
        best = min(found, key=lambda one: one.negative_log_likelihood)
        self.evaluations_ = sum(one.evaluations for one in found)
        return replace(
            unscaled,
            length_scales=(best.length_scale,),
            signal_variance=best.signal_variance,
            noise_ratio=best.noise_ratio,
        )
