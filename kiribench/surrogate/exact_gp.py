"""What the exact Gaussian processes share: from rows to a grid or a dense matrix and back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.errors import DataError, UsageError
from kiribench.surrogate import dense, kronecker
from kiribench.surrogate.closed_form import DenseState, GridState, folds_left_out
from kiribench.surrogate.devices import device_of, torch_threads
from kiribench.surrogate.grid import DesignGrid, are_curves, find_grid, resample, thinned
from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters
from kiribench.surrogate.kernel_form import (
    KernelForm,
    TorchParameters,
    design_correlation,
    full_correlation,
    observed_correlation,
    observed_design_correlation,
    strain_correlation,
)
from kiribench.surrogate.learning import Problem, learn, scaled_axes, tensor
from kiribench.surrogate.likelihood import GAIN
from kiribench.surrogate.strain_path import Path, along, strain_path

FloatArray = NDArray[np.float64]
Structure = Literal["grid", "resampled", "dense"]
INNER_FOLDS = 10
MOST_LOST = 0.02  # of the rows may lie beyond a grid onto which they were resampled
MOST_CONDITIONED = 4000  # rows to condition on directly where the grid would lose more
MOST_LOST_OF_MANY = 0.2  # where the rows are more than that: thinning them costs as well
LEAST_GROUPS = 20  # fewer left-out designs say nothing about a 95 % interval
NORMAL_95 = 1.959963984540054  # half width of the normal distribution's central 95 %


class ExactGP(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Base of the exact Gaussian processes; a subclass says which kernel.

    Fitted attributes: ``hyperparameters_`` (:class:`Hyperparameters`), ``structure_``
    (``"grid"``, ``"resampled"`` or ``"dense"``), ``resampling_rms_`` (targets' unit, the
    cost of resampling), ``evaluations_`` (likelihoods of all rows computed),
    ``log_marginal_likelihood_`` (of the rows, or of the resampled grid).
    """

    # Set by the subclasses' __init__, as scikit-learn wants it.
    hyperparameters: Hyperparameters | None
    optimise: bool
    resampling: str
    max_dense_rows: int
    max_missing: int
    max_evaluations: int
    device: str
    threads: int | None
    random_state: int | None

    # Set by fit.
    hyperparameters_: Hyperparameters
    log_marginal_likelihood_: float
    _state: GridState | DenseState

    def _kernel_forms(self, inputs: int) -> tuple[KernelForm, ...]:
        """The kernels to choose from, the first the simplest."""
        raise NotImplementedError

    def _scaling(self) -> tuple[str, bool]:
        return "range", True

    def _calibrated(self) -> bool:
        return False

    def _follows_paths(self) -> bool:
        return False

    def _gain(self) -> float:
        return GAIN

    def fit(self, X: ArrayLike, y: ArrayLike) -> ExactGP:
        """Learn scalings and kernel parameters, and condition on the rows.

        Args:
            X: (n, d) inputs; for a design space a_percent, b_percent, strain, in this order.
            y: (n,) targets, for a design space Poisson's ratio.

        Raises:
            DataError: more scattered rows than a dense covariance should hold.
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
        self.rows_ = len(y_)
        with torch_threads(self.threads):
            kept = given if not self.optimise else None
            path = self._path_of(X_, y_) if kept is None else kept.path
            straight = X_
            if kept is not None:
                straight = kept.along_path(X_)
            elif path:
                designs = (X_[:, :-1] - X_[:, :-1].min(axis=0)) / np.ptp(X_[:, :-1], axis=0)
                straight = np.column_stack([X_[:, :-1], along(path, designs, X_[:, -1])])
            grid = self._grid_of(straight, y_)
            self.structure_: Structure = (
                "dense" if grid is None else "resampled" if grid.resampled else "grid"
            )
            self.resampling_rms_ = 0.0 if grid is None else grid.resampling_rms
            bearable = MOST_LOST if len(y_) <= MOST_CONDITIONED else MOST_LOST_OF_MANY
            short = grid is not None and grid.resampled and grid.lost > bearable
            self.evaluations_ = 0
            if kept is None:
                self._choose(X_, straight, y_, grid, given, path, place)
            elif not short:
                self._become(kept, X_, y_, grid, place)
            if short:
                self._condition_on_rows(X_, y_, kept, place)
        return self

    def _choose(
        self,
        X: FloatArray,
        straight: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        given: Hyperparameters | None,
        path: Path,
        place: torch.device,
    ) -> None:
        """Learn each kernel, and keep the one that predicts left-out designs of ``X`` best."""
        problem = Problem.of(
            straight,
            y,
            grid,
            scaling=self._scaling(),
            path=path,
            place=place,
            seed=self.random_state,
            max_evaluations=self.max_evaluations,
            gain=self._gain(),
        )
        forms = self._kernel_forms(X.shape[1])
        if given is not None:
            forms = (forms[0].with_values_of(given),)
        folds = _inner_folds(X, self.random_state)
        inner = len(folds) > 0 and (len(forms) > 1 or self._calibrated())
        best: tuple[float, float, Hyperparameters] | None = None
        start = None if given is None else given.kernel_parameters()
        self.evaluations_ = 0
        for form in forms if inner else forms[:1]:
            learnt, used = self._learn(problem, form, start)
            self.evaluations_ += used
            self._become(learnt, X, y, grid, place)
            rmse, spread = self._inner_scores(y, folds) if inner else (0.0, 1.0)
            if best is None or rmse < best[0]:
                best = rmse, spread, self.hyperparameters_
        if best is None:
            raise ValueError("there is no kernel to choose from")
        spread = best[1] if self._calibrated() else 1.0
        chosen = replace(best[2], spread=spread)
        if replace(chosen, spread=1.0) == self.hyperparameters_:
            self._state = replace(self._state, learnt=chosen)
            self.hyperparameters_ = chosen
        else:
            self._become(chosen, X, y, grid, place)

    def _condition_on_rows(
        self, X: FloatArray, y: FloatArray, kept: Hyperparameters | None, place: torch.device
    ) -> None:
        """Keep the kernel that was learnt on the grid's part of the curves, and use all of them.

        Curves of many lengths have no common grid: it would end where the shortest do. So the
        process takes the rows themselves, evenly thinned where they are too many.
        """
        self.structure_, self.resampling_rms_ = "dense", 0.0
        if kept is not None:
            self._become(kept, X, y, None, place, MOST_CONDITIONED)
            return
        learnt = replace(self.hyperparameters_, spread=1.0)
        self._become(learnt, X, y, None, place, MOST_CONDITIONED)
        folds = _inner_folds(X, self.random_state)
        if self._calibrated() and folds:
            chosen = replace(self.hyperparameters_, spread=self._inner_scores(y, folds)[1])
            self._state = replace(self._state, learnt=chosen)
            self.hyperparameters_ = chosen

    def _learn(
        self, problem: Problem, form: KernelForm, start: Parameters | None
    ) -> tuple[Hyperparameters, int]:
        return learn(problem, form, start)

    def _inner_scores(self, y: FloatArray, folds: list[NDArray[np.int64]]) -> tuple[float, float]:
        """RMSE of left-out designs, and the factor that makes 95 % intervals hold 95 % of them."""
        squared, ratios = 0.0, []
        for one in folds_left_out(self._state, folds):
            error = y[one.rows] - one.mean
            squared += float(np.sum(error**2))
            ratios.append(np.abs(error) / one.sd)
        spread = float(np.quantile(np.concatenate(ratios), 0.95)) / NORMAL_95
        return float(np.sqrt(squared / len(y))), float(np.clip(spread, 0.5, 2.0))

    def restore(self, learnt: Hyperparameters, grid: DesignGrid, resampling_rms: float) -> ExactGP:
        """Become the process that was kept as a grid: conditioned anew, nothing learnt."""
        self.structure_ = "resampled" if grid.resampled else "grid"
        self.resampling_rms_, self.evaluations_ = resampling_rms, 0
        self.n_features_in_, self.rows_ = grid.designs.shape[1] + 1, len(grid.row_design)
        none = np.zeros((0, self.n_features_in_))
        with torch_threads(self.threads):
            self._become(learnt, none, none[:, 0], grid, device_of(self.device))
        return self

    def restore_rows(self, learnt: Hyperparameters, X: FloatArray, y: FloatArray) -> ExactGP:
        """Become the process that was kept as scattered rows."""
        self.structure_, self.resampling_rms_, self.evaluations_ = "dense", 0.0, 0
        self.n_features_in_, self.rows_ = X.shape[1], len(y)
        with torch_threads(self.threads):
            self._become(learnt, X, y, None, device_of(self.device))
        return self

    def _path_of(self, X: FloatArray, y: FloatArray) -> Path:
        """The paths of curves that end at strains of their own; nothing for other rows."""
        if not self._follows_paths() or X.shape[1] != 3 or self.resampling != "auto":
            return ()
        grid = find_grid(X, y)
        if (grid is not None and len(grid.missing) <= self.max_missing) or not are_curves(X):
            return ()
        return strain_path(X)

    def _grid_of(self, X: FloatArray, y: FloatArray) -> DesignGrid | None:
        """The rows as a grid where they are one, or may be made one; else ``None``."""
        grid = find_grid(X, y)
        if grid is not None and len(grid.missing) <= self.max_missing:
            return grid
        if self.resampling == "auto" and are_curves(X):
            return resample(X, y)
        if len(X) > self.max_dense_rows:
            raise DataError(
                "gp-too-many-scattered-rows",
                "The rows are neither a designs x strains grid nor curves, and too many for "
                "an exact dense Gaussian process.",
                remedy="Use the sparse model svgp, or raise max_dense_rows if there is "
                "memory for the matrix.",
                got=f"{len(X)} rows",
                expected=f"at most {self.max_dense_rows}",
            )
        return None

    def _become(
        self,
        learnt: Hyperparameters,
        X: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        place: torch.device,
        most: int | None = None,
    ) -> None:
        """Condition on the rows with these parameters; a NaN signal variance is learnt here.

        Without a grid at most ``most`` rows are taken, see :func:`thinned`.
        """
        form = self._kernel_forms(len(learnt.input_low))[0].with_values_of(learnt)
        signal = None if np.isnan(learnt.signal_variance) else learnt.signal_variance
        if grid is None:
            every = tensor(learnt.scale_inputs(X), place)
            kept = thinned(X, len(X) if most is None else most)
            inputs = every[torch.as_tensor(kept, device=place)]
            at = TorchParameters.of(learnt.kernel_parameters(), inputs)
            values = tensor(learnt.scale_targets(y[kept]), place)
            k = observed_correlation(form, inputs, at)
            flat = dense.condition(k, learnt.noise_ratio, values, signal)
            learnt = replace(learnt, signal_variance=flat.signal)
            nll, rows = flat.negative_log_likelihood, len(kept)
            self._state = DenseState(form, learnt, inputs, flat, every, kept)
        else:
            designs, strains = scaled_axes(grid, learnt, place)
            at = TorchParameters.of(learnt.kernel_parameters(), designs)
            factors = kronecker.factorise(
                observed_design_correlation(form, designs, at),
                strain_correlation(form, strains, strains, at),
                learnt.noise_ratio,
            )
            values = tensor(learnt.scale_targets(grid.values), place)
            conditioned = kronecker.condition(
                factors, values, torch.as_tensor(grid.missing, device=place), signal
            )
            learnt = replace(learnt, signal_variance=conditioned.signal)
            nll, rows = conditioned.negative_log_likelihood, conditioned.count
            self._state = GridState(form, learnt, grid, designs, strains, conditioned)
        self.hyperparameters_ = learnt
        self.log_marginal_likelihood_ = -nll - rows * float(np.log(learnt.target_scale))

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, X: ArrayLike, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...

    def predict(
        self, X: ArrayLike, return_std: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """The posterior mean, and the standard deviation of a new observation.

        Args:
            X: (t, d) inputs, as in :meth:`fit`.
            return_std: also give the (t,) standard deviations, noise included.
        """
        check_is_fitted(self, "hyperparameters_")
        X_ = validate_data(self, X, dtype=np.float64, reset=False)
        with torch_threads(self.threads):
            mean, variance = self._predict_scaled(X_)
        learnt = self.hyperparameters_
        centred = mean * learnt.target_scale + learnt.target_mean
        if not return_std:
            return np.asarray(centred)
        return np.asarray(centred), learnt.observation_sd(variance)

    def _predict_scaled(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        state, learnt = self._state, self.hyperparameters_
        form = state.form
        like = state.designs if isinstance(state, GridState) else state.inputs
        points = tensor(learnt.scale_inputs(X), like.device)
        at = TorchParameters.of(learnt.kernel_parameters(), like)
        if isinstance(state, DenseState):
            cross = full_correlation(form, points, state.inputs, at)
            mean, variance = dense.predict(state.conditioned, cross)
        else:
            # Rows share designs: correlate each design once.
            designs, row_design = torch.unique(points[:, :-1], dim=0, return_inverse=True)
            mean, variance = kronecker.predict(
                state.conditioned,
                design_correlation(form, designs, state.designs, at),
                strain_correlation(form, points[:, -1:], state.strains, at),
                row_design,
            )
        return mean.cpu().numpy(), variance.cpu().numpy()

    def __getstate__(self) -> dict[str, Any]:
        # Worker processes get the fitted estimator; tensors travel as they are.
        return dict(super().__getstate__())


def _inner_folds(X: FloatArray, seed: int | None) -> list[NDArray[np.int64]]:
    """Rows of ten folds of whole designs, or of rows where no two share one; empty if too few."""
    if X.shape[1] > 1:
        _, group = np.unique(X[:, :-1], axis=0, return_inverse=True)
        group = group.ravel()
    else:
        group = np.arange(len(X))
    groups = int(group.max()) + 1
    if groups < LEAST_GROUPS:
        return []
    label = np.random.default_rng(seed).permutation(groups) % INNER_FOLDS
    return [np.flatnonzero(label[group] == k) for k in range(INNER_FOLDS)]
