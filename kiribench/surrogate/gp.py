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
from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters
from kiribench.surrogate.kernel_form import KernelForm, start_parameters
from kiribench.surrogate.learning import Problem, coarse_objective, learn, starts_of
from kiribench.surrogate.likelihood import likeliest

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

    def _kernel_forms(self, inputs: int) -> tuple[KernelForm, ...]:
        free = not self.shared_sigma
        return (KernelForm("gaussian", "gaussian", inputs, shared_scale=True, free_noise=free),)

    def _scaling(self) -> tuple[str, bool]:
        return self.input_scaling, self.centre_targets

    def _grid_of(self, X: FloatArray, y: FloatArray) -> DesignGrid | None:
        if self.solver == "dense":
            return None
        return super()._grid_of(X, y)

    def _learn(
        self, problem: Problem, form: KernelForm, start: Parameters | None
    ) -> tuple[Hyperparameters, int]:
        if problem.grid is not None or self.shared_sigma:
            return learn(problem, form, start)
        from kiribench.surrogate.gpytorch_exact import maximise_in_gpytorch

        inputs = torch.as_tensor(problem.scaled.scale_inputs(problem.X), device=problem.place)
        values = torch.as_tensor(problem.scaled.scale_targets(problem.y), device=problem.place)
        if start is not None:
            starts = [start]
        else:
            tried = starts_of(form)
            starts = [likeliest(coarse_objective(problem, form), tried)]
            if problem.raw:  # several optima: see learning
                wide = 0.5 * np.ptp(problem.X, axis=0).max(keepdims=True)
                starts.append(replace(start_parameters(form), length_scales=wide))
        found = [
            maximise_in_gpytorch(
                inputs, values, (float(one.length_scales[0]), one.noise_ratio), self.max_evaluations
            )
            for one in starts
        ]
        best = min(found, key=lambda one: one.negative_log_likelihood)
        learnt = replace(
            problem.scaled,
            length_scales=(best.length_scale,),
            signal_variance=best.signal_variance,
            noise_ratio=best.noise_ratio,
        )
        return learnt, sum(one.evaluations for one in found)
