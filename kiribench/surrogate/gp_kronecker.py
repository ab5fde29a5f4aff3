"""The exact Gaussian process with a product kernel: Kronecker algebra where the rows are a grid."""

from __future__ import annotations

from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.likelihood import KernelForm


class KroneckerGP(ExactGP):
    """Exact GP: k_designs(a, b) x k_strain(strain), one length scale an input, plus noise.

    On a designs x strains grid of p x m rows a likelihood with its gradient costs
    p^3 + m^3. Removing whole designs leaves a grid, so folds grouped by design stay exact.
    Curves with strains of their own are resampled (:mod:`kiribench.surrogate.grid`), other
    rows take a dense covariance up to ``max_dense_rows``.

    Design inputs are warped: the response changes faster towards the ends of the design
    space (hinges that vanish as a cut length nears the cell's), so a stationary kernel is
    too cautious inside and too bold at the rim.

    Args:
        design_kernel, strain_kernel: keys of :data:`kiribench.surrogate.kernels.FAMILIES`.
        warp: learn the design inputs' warps.
        noise_floor: least noise variance over signal variance.
        hyperparameters: where to start the search, or with ``optimise=False`` what to use.
        optimise: maximise the marginal likelihood.
        resampling: ``"auto"`` or ``"never"``.
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
        design_kernel: str = "gaussian",
        strain_kernel: str = "gaussian",
        warp: bool = True,
        noise_floor: float = 1e-6,
        hyperparameters: Hyperparameters | None = None,
        optimise: bool = True,
        resampling: str = "auto",
        max_dense_rows: int = 5000,
        max_missing: int = 2000,
        max_evaluations: int = 200,
        device: str = "cpu",
        threads: int | None = 1,
        random_state: int | None = 0,
    ) -> None:
        self.design_kernel = design_kernel
        self.strain_kernel = strain_kernel
        self.warp = warp
        self.noise_floor = noise_floor
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
            self.design_kernel,
            self.strain_kernel,
            inputs,
            warped=self.warp and inputs > 1,
            noise_floor=self.noise_floor,
        )
