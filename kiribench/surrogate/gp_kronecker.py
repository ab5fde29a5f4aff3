"""The exact Gaussian process with a product kernel: Kronecker algebra where the rows are a grid."""

from __future__ import annotations

from dataclasses import replace

from kiribench.errors import UsageError
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.hyperparameters import Hyperparameters
from kiribench.surrogate.kernel_form import KernelForm


class KroneckerGP(ExactGP):
    """Exact GP: k_designs(a, b) x k_strain(strain), one length scale an input, plus noise.

    On a designs x strains grid of p x m rows a likelihood with its gradient costs
    p^3 + m^3. Removing whole designs leaves a grid, so folds grouped by design stay exact.
    Curves with strains of their own are resampled (:mod:`kiribench.surrogate.grid`), at common
    fractions of their paths where these are smooth functions of the cut lengths
    (:mod:`kiribench.surrogate.strain_path`); other rows take a dense covariance up to
    ``max_dense_rows``.

    Two design inputs get a third coordinate, the angle about a corner
    (:class:`kiribench.surrogate.kernel_form.KernelForm`): a stationary kernel over (a, b)
    alone cannot follow the response where b nears the whole cell and a vanishes. Each design
    has an error in common over its curve (its mesh's), so left-out designs are not believed to
    be better known than they are. Design inputs may be warped as well: whether they are is
    decided by left-out designs of the training rows, in closed form. The same designs set a
    factor on the standard deviation with which their 95 % intervals hold 95 %.

    Args:
        design_kernel, strain_kernel: keys of :data:`kiribench.surrogate.kernels.FAMILIES`.
        corner: use the angle (where there are two design inputs).
        curve_noise: learn an error that a design's rows have in common.
        warp: ``"auto"`` decides as said; ``"always"`` and ``"never"``.
        path: use the strain along the path where curves end at strains of their own.
        calibrate: set the factor.
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
        design_kernel: str = "matern72",
        strain_kernel: str = "gaussian",
        corner: bool = True,
        curve_noise: bool = True,
        warp: str = "auto",
        path: bool = True,
        calibrate: bool = True,
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
        self.corner = corner
        self.curve_noise = curve_noise
        self.warp = warp
        self.path = path
        self.calibrate = calibrate
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

    def _kernel_forms(self, inputs: int) -> tuple[KernelForm, ...]:
        plain = KernelForm(
            self.design_kernel,
            self.strain_kernel,
            inputs,
            cornered=self.corner and inputs == 3,
            curve_noise=self.curve_noise and inputs > 1,
            noise_floor=self.noise_floor,
        )
        if inputs == 1:
            return (plain,)
        warped = replace(plain, warped=True)
        choices = {"auto": (plain, warped), "always": (warped,), "never": (plain,)}
        if self.warp not in choices:
            raise UsageError(
                "gp-warp-unknown",
                "There is no such choice of the warp.",
                remedy="Use auto, always or never.",
                got=self.warp,
            )
        return choices[self.warp]

    def _calibrated(self) -> bool:
        return self.calibrate

    def _follows_paths(self) -> bool:
        return self.path

    def _gain(self) -> float:
        # Of the log likelihood, a step: left-out designs see no difference to a finer search.
        return 5e-5
