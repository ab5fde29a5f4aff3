"""A fitted surrogate with all that is needed to keep it and to use it rightly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiribench.errors import UsageError
from kiribench.surrogate.kept_file import Arrays
from kiribench.surrogate.registry import Regressor, spec

FloatArray = NDArray[np.float64]
Probes = tuple[FloatArray, FloatArray, FloatArray | None]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Poisson's ratio at n points.

    Attributes:
        mean: (n,).
        sd: (n,) standard deviation of an observation, ``None`` for models without one.
        inside: (n,) bool, whether each input lies in the range of the training data.
    """

    mean: FloatArray
    sd: FloatArray | None
    inside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class KeptModel:
    """A fitted surrogate with all that is needed to keep it and to use it rightly.

    Attributes:
        name: of the registry.
        settings: that were given beside the registry's.
        seed: of the fit.
        measure: the strain measure of inputs and targets.
        low, high: (3,) range of a_percent, b_percent, strain in the training data.
        summary: rows, designs, structure, how well left-out designs are predicted.
        provenance: of the fit.
        estimator: the scikit-learn estimator.
        probes: (k, 3) points, (k,) means there and (k,) standard deviations where the model has
            them, to check a loaded model.
        arrays: what the file holds besides the probes.
        target: what is predicted: ``poisson_ratio``, or ``log_secant_modulus`` (of MPa).
        stress: the model of the secant modulus fitted to the same table, or ``None``.
    """

    name: str
    settings: dict[str, Any]
    seed: int
    measure: str
    low: FloatArray
    high: FloatArray
    summary: dict[str, Any]
    provenance: dict[str, Any]
    estimator: Regressor
    probes: Probes
    arrays: Arrays
    target: str = "poisson_ratio"
    stress: KeptModel | None = None

    def predict(
        self,
        a_percent: ArrayLike,
        b_percent: ArrayLike,
        longitudinal_strain: ArrayLike,
        *,
        measure: str | None = None,
    ) -> Prediction:
        """The target at the given points, which are broadcast against each other.

        Args:
            a_percent, b_percent: cut lengths, percent of the cell.
            longitudinal_strain: fraction, in the model's measure.
            measure: what the caller believes the measure to be; checked if given.

        Raises:
            UsageError: the measures differ, or a number is not finite.
        """
        if measure is not None and measure != self.measure:
            raise UsageError(
                "strain-measure-mixed",
                "The points are in another strain measure than the model.",
                remedy=f"Convert the strains to {self.measure}, or fit the model in {measure}.",
                got=measure,
                expected=self.measure,
            )
        columns = np.broadcast_arrays(a_percent, b_percent, longitudinal_strain)
        points = np.column_stack([np.asarray(x, dtype=np.float64).ravel() for x in columns])
        if not np.isfinite(points).all():
            raise UsageError(
                "point-not-finite",
                "A point has a coordinate that is no finite number.",
                remedy="Give three finite numbers a point: a_percent, b_percent, strain.",
            )
        inside = np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))
        if spec(self.name).has_uncertainty:
            mean, sd = self.estimator.predict(points, return_std=True)  # type: ignore[call-arg]
            return Prediction(mean, sd, inside)
        return Prediction(np.asarray(self.estimator.predict(points)), None, inside)

    def predict_stress(
        self,
        a_percent: ArrayLike,
        b_percent: ArrayLike,
        longitudinal_strain: ArrayLike,
        *,
        measure: str | None = None,
    ) -> Prediction:
        """Nominal stress in MPa, with its standard deviation to first order; see :meth:`predict`.

        Raises:
            UsageError: the table had no stress, or as :meth:`predict`.
        """
        if self.stress is None:
            raise UsageError(
                "surrogate-without-stress",
                "The surrogate knows Poisson's ratio only.",
                remedy="Fit a Gaussian process (kiribench fit) to a table with the column "
                "nominal_stress_mpa, such as kiribench simulate writes.",
            )
        modulus = self.stress.predict(a_percent, b_percent, longitudinal_strain, measure=measure)
        strain = np.broadcast_arrays(a_percent, b_percent, longitudinal_strain)[2].ravel()
        stress = strain * np.exp(modulus.mean)
        sd = None if modulus.sd is None else np.abs(stress) * modulus.sd
        return Prediction(stress, sd, modulus.inside)
