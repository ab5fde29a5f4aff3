"""What the exact Gaussian processes share: from rows to a grid or a dense matrix and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, overload

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from kiribench.errors import DataError, NotConvergedError, UsageError
from kiribench.surrogate import dense, kronecker, likelihood
from kiribench.surrogate.devices import device_of, torch_threads
from kiribench.surrogate.grid import DesignGrid, are_curves, find_grid, resample
from kiribench.surrogate.hyperparameters import Hyperparameters, Parameters, scaling_of
from kiribench.surrogate.likelihood import KernelForm, TorchParameters

Tensor = torch.Tensor
FloatArray = NDArray[np.float64]
Structure = Literal["grid", "resampled", "dense"]
COARSE_DESIGNS = 128  # designs of the first, cheap search
CHEAP_HOLES = 1e9  # multiplications that the holes may add to one likelihood


@dataclass(frozen=True, eq=False)
class GridState:
    """A process on a grid, ready to predict: scaled tensors and the conditioned process."""

    grid: DesignGrid
    designs: Tensor
    strains: Tensor
    conditioned: kronecker.Conditioned


@dataclass(frozen=True, eq=False)
class DenseState:
    """A process on scattered rows, ready to predict."""

    inputs: Tensor
    conditioned: dense.DenseConditioned


class ExactGP(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Base of the exact Gaussian processes; a subclass says which kernel.

    Fitted attributes: ``hyperparameters_`` (:class:`Hyperparameters`), ``structure_``
    (``"grid"``, ``"resampled"`` or ``"dense"``), ``resampling_rms_`` (targets' unit, the
    cost of resampling), ``evaluations_`` (likelihoods computed),
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

    def _kernel_form(self, inputs: int) -> KernelForm:
        raise NotImplementedError

    def _scaling(self) -> tuple[str, bool]:
        return "range", True

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
        with torch_threads(self.threads):
            grid = self._grid_of(X_, y_)
            self.structure_: Structure = (
                "dense" if grid is None else "resampled" if grid.resampled else "grid"
            )
            self.resampling_rms_ = 0.0 if grid is None else grid.resampling_rms
            form = self._kernel_form(X_.shape[1])
            if given is not None and not self.optimise:
                self.hyperparameters_ = given
                self.evaluations_ = 0
            else:
                self.hyperparameters_ = self._learn(form, X_, y_, grid, given, place)
            self._condition(form, X_, y_, grid, place)
        return self

    def restore(self, learnt: Hyperparameters, grid: DesignGrid, resampling_rms: float) -> ExactGP:
        """Become the process that was kept as a grid: conditioned anew, nothing learnt."""
        self.structure_ = "resampled" if grid.resampled else "grid"
        self.resampling_rms_ = resampling_rms
        self.hyperparameters_, self.evaluations_ = learnt, 0
        self.n_features_in_ = grid.designs.shape[1] + 1
        none = np.zeros((0, self.n_features_in_))
        with torch_threads(self.threads):
            form = self._kernel_form(self.n_features_in_)
            self._condition(form, none, none[:, 0], grid, device_of(self.device))
        return self

    def restore_rows(self, learnt: Hyperparameters, X: FloatArray, y: FloatArray) -> ExactGP:
        """Become the process that was kept as scattered rows."""
        self.structure_, self.resampling_rms_ = "dense", 0.0
        self.hyperparameters_, self.evaluations_ = learnt, 0
        self.n_features_in_ = X.shape[1]
        with torch_threads(self.threads):
            form = self._kernel_form(self.n_features_in_)
            self._condition(form, X, y, None, device_of(self.device))
        return self

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

    def _learn(
        self,
        form: KernelForm,
        X: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        start: Hyperparameters | None,
        place: torch.device,
    ) -> Hyperparameters:
        inputs, centre = self._scaling()
        low, span, mean, scale = scaling_of(X, y, inputs=inputs, centre=centre)
        first = likelihood.start_parameters(form)
        if start is not None:
            first = Parameters(
                np.array(start.length_scales),
                np.array(start.warp) if start.warp else first.warp,
                start.noise_ratio if form.free_noise else first.noise_ratio,
            )
        unscaled = Hyperparameters(
            tuple(low.tolist()), tuple(span.tolist()), mean, scale, (), (), 1.0, 1.0
        )
        if grid is None:
            objective = likelihood.dense_objective(
                form,
                _tensor(unscaled.scale_inputs(X), place),
                _tensor(unscaled.scale_targets(y), place),
            )
            rows = len(y)
        else:
            whole = _for_likelihood(grid, self.random_state)
            objective = _grid_objective(form, whole, unscaled, place)
            rows = int(whole.observed.sum())
            if start is None and len(whole.designs) > 2 * COARSE_DESIGNS:
                # A few designs tell nearly as much about the kernel, at a hundredth of the cost.
                few = _some_designs(whole, COARSE_DESIGNS, self.random_state)
                near = _maximise(
                    form,
                    _grid_objective(form, few, unscaled, place),
                    first,
                    int(few.observed.sum()),
                    self.max_evaluations,
                )
                first = near.parameters
        best = _maximise(form, objective, first, rows, self.max_evaluations)
        self.evaluations_ = best.evaluations
        if inputs == "none" and start is None:
            # One length scale over inputs of different units has several optima: also
            # start from the widest input's range, and keep the likelier.
            wide = replace(
                likelihood.start_parameters(form),
                length_scales=0.5 * np.ptp(X, axis=0).max(keepdims=True),
            )
            other = _maximise(form, objective, wide, rows, self.max_evaluations)
            self.evaluations_ += other.evaluations
            if other.negative_log_likelihood < best.negative_log_likelihood:
                best = other
        return replace(
            unscaled,
            length_scales=tuple(best.parameters.length_scales.tolist()),
            warp=tuple((low, high) for low, high in best.parameters.warp.tolist())
            if form.warped
            else (),
            noise_ratio=best.parameters.noise_ratio,
            signal_variance=float("nan"),  # set from the whole data by _condition
        )

    def _condition(
        self,
        form: KernelForm,
        X: FloatArray,
        y: FloatArray,
        grid: DesignGrid | None,
        place: torch.device,
    ) -> None:
        learnt = self.hyperparameters_
        signal = None if np.isnan(learnt.signal_variance) else learnt.signal_variance
        self._state: GridState | DenseState
        if grid is None:
            inputs = _tensor(learnt.scale_inputs(X), place)
            at = TorchParameters.of(learnt.kernel_parameters(), inputs)
            k = likelihood.full_correlation(form, inputs, inputs, at)
            flat = dense.condition(
                k, learnt.noise_ratio, _tensor(learnt.scale_targets(y), place), signal
            )
            self._state = DenseState(inputs, flat)
            signal, nll, rows = flat.signal, flat.negative_log_likelihood, len(y)
        else:
            designs, strains = _scaled_axes(grid, learnt, place)
            at = TorchParameters.of(learnt.kernel_parameters(), designs)
            factors = kronecker.factorise(
                likelihood.design_correlation(form, designs, designs, at),
                likelihood.strain_correlation(form, strains, strains, at),
                learnt.noise_ratio,
            )
            values = _tensor(learnt.scale_targets(grid.values), place)
            conditioned = kronecker.condition(
                factors, values, torch.as_tensor(grid.missing, device=place), signal
            )
            self._state = GridState(grid, designs, strains, conditioned)
            signal, nll = conditioned.signal, conditioned.negative_log_likelihood
            rows = conditioned.count
        self.hyperparameters_ = replace(learnt, signal_variance=signal)
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
        noisy = variance + learnt.signal_variance * learnt.noise_ratio
        return np.asarray(centred), np.asarray(np.sqrt(noisy) * learnt.target_scale)

    def _predict_scaled(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        state = self._state
        form = self._kernel_form(X.shape[1])
        like = state.designs if isinstance(state, GridState) else state.inputs
        points = _tensor(self.hyperparameters_.scale_inputs(X), like.device)
        at = TorchParameters.of(self.hyperparameters_.kernel_parameters(), like)
        if isinstance(state, DenseState):
            cross = likelihood.full_correlation(form, points, state.inputs, at)
            mean, variance = dense.predict(state.conditioned, cross)
        else:
            # Rows share designs: correlate each design once.
            designs, row_design = torch.unique(points[:, :-1], dim=0, return_inverse=True)
            mean, variance = kronecker.predict(
                state.conditioned,
                likelihood.design_correlation(form, designs, state.designs, at),
                likelihood.strain_correlation(form, points[:, -1:], state.strains, at),
                row_design,
            )
        return mean.cpu().numpy(), variance.cpu().numpy()

    def __getstate__(self) -> dict[str, Any]:
        # Worker processes get the fitted estimator; tensors travel as they are.
        return dict(super().__getstate__())


def _maximise(
    form: KernelForm, objective: Any, start: Parameters, rows: int, limit: int
) -> likelihood.Maximum:
    try:
        return likelihood.maximise(form, objective, start, rows=rows, max_evaluations=limit)
    except torch.linalg.LinAlgError as error:  # type: ignore[attr-defined]
        raise NotConvergedError(
            "gp-not-positive-definite",
            f"The covariance of the rows is not positive definite ({error}).",
            remedy="Remove rows that are nearly equal, or give a larger start for the noise.",
        ) from error


def _for_likelihood(grid: DesignGrid, seed: int | None) -> DesignGrid:
    """The part of a grid on which the kernel parameters are learnt.

    All of it where little is missing. Else the complete part that is left after dropping the
    emptiest strains and designs, or, where holes are everywhere, a random choice of designs
    with so few holes that the exact likelihood stays cheap. The process itself is always
    conditioned on every row.
    """
    missing = len(grid.missing)
    if missing * missing * grid.values.size <= CHEAP_HOLES:
        return grid
    rows = np.ones(len(grid.designs), dtype=bool)
    columns = np.ones(len(grid.curve), dtype=bool)
    while not grid.observed[np.ix_(rows, columns)].all():
        kept = grid.observed[np.ix_(rows, columns)]
        by_row, by_column = 1.0 - kept.mean(axis=1), 1.0 - kept.mean(axis=0)
        if by_row.max() >= by_column.max():
            rows[np.flatnonzero(rows)[by_row.argmax()]] = False
        else:
            columns[np.flatnonzero(columns)[by_column.argmax()]] = False
    if rows.sum() * columns.sum() >= 0.6 * grid.observed.sum():
        return _part(grid, rows, columns)
    # Holes grow with the designs: n designs cost n^3.
    share = (CHEAP_HOLES / (missing * missing * grid.values.size)) ** (1.0 / 3.0)
    count = max(20, int(share * len(grid.designs)))
    return _some_designs(grid, count, seed)


def _some_designs(grid: DesignGrid, count: int, seed: int | None) -> DesignGrid:
    chosen = np.random.default_rng(seed).permutation(len(grid.designs))[:count]
    some = np.zeros(len(grid.designs), dtype=bool)
    some[chosen] = True
    return _part(grid, some, np.ones(len(grid.curve), dtype=bool))


def _grid_objective(
    form: KernelForm, grid: DesignGrid, scaling: Hyperparameters, place: torch.device
) -> Callable[[Parameters], tuple[float, Parameters]]:
    designs, strains = _scaled_axes(grid, scaling, place)
    return likelihood.grid_objective(
        form,
        designs,
        strains,
        _tensor(scaling.scale_targets(grid.values), place),
        torch.as_tensor(grid.missing, device=place),
    )


def _part(grid: DesignGrid, rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> DesignGrid:
    return replace(
        grid,
        designs=grid.designs[rows],
        curve=grid.curve[columns],
        values=grid.values[np.ix_(rows, columns)],
        observed=grid.observed[np.ix_(rows, columns)],
    )


def _scaled_axes(
    grid: DesignGrid, scaling: Hyperparameters, place: torch.device
) -> tuple[Tensor, Tensor]:
    low, span = np.array(scaling.input_low), np.array(scaling.input_span)
    designs = (grid.designs - low[:-1]) / span[:-1]
    strains = (grid.curve[:, None] - low[-1]) / span[-1]
    return _tensor(designs, place), _tensor(strains, place)


def _tensor(array: FloatArray, place: torch.device) -> Tensor:
    return torch.as_tensor(np.ascontiguousarray(array, dtype=np.float64), device=place)
