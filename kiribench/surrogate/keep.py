"""Fit a surrogate to a design space, keep it in one file, and predict from it.

The file is safetensors: plain arrays and one JSON string, nothing that runs when it is
read. A Gaussian process keeps its data and hyperparameters and is conditioned anew when
it is loaded; other models keep data, settings and seed and are fitted anew. Both must
give back the predictions that were stored with them.

Where the table holds the nominal stress, a Gaussian process of Poisson's ratio carries a second
one of the logarithm of the secant modulus, ``ln(stress / strain)``: it stays finite at strain 0,
is positive by construction, and its error is a relative one over a range of forces of 30 to 1.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kiribench.errors import DataError, TableError, UsageError
from kiribench.provenance import provenance
from kiribench.schema.design_space import DesignSpace
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.leave_out import leave_folds_out
from kiribench.surrogate.registry import Regressor, make, spec
from kiribench.surrogate.state import Arrays, state_of, with_state
from kiribench.surrogate.svgp import SparseVariationalGP

FloatArray = NDArray[np.float64]
SCHEMA = "kiribench.model/1"
PROBES = 16
PROBE_TOLERANCE = 1e-6  # of the targets' range; other versions of the libraries may differ
FOLDS = 10
STRESS = "stress."  # before the names of the second model's arrays


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
        probes: (k, 3) points and (k,) means there, to check a loaded model.
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
    probes: tuple[FloatArray, FloatArray]
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


def fit_table(
    space: DesignSpace,
    model: str = "gp_kronecker",
    *,
    seed: int = 0,
    device: str = "cpu",
    **settings: Any,
) -> KeptModel:
    """Fit one model to a whole design space.

    Args:
        space: from :func:`kiribench.schema.design_space.read_design_space`.
        model: a name of the registry.
        seed: of the model, and of the folds that judge it.
        device: ``"cpu"`` or ``"cuda"``.
        settings: further parameters of the estimator.
    """
    # A fixed order of the rows: forests depend on it, and the file stores it for nothing.
    order = np.lexsort((space.longitudinal_strain, space.b_percent, space.a_percent))
    X, design = space.inputs[order], space.design[order]
    known: dict[str, Any] = {"name": model, "settings": settings, "seed": seed}
    known |= {"device": device, "space": space}
    kept = _fit(X, space.poisson_ratio[order], design, target="poisson_ratio", **known)
    if space.nominal_stress_mpa is None or not spec(model).is_gp:
        return kept
    with np.errstate(invalid="ignore", divide="ignore"):
        modulus = space.nominal_stress_mpa[order] / X[:, 2]
    some = np.isfinite(modulus) & (modulus > 0)
    if some.sum() < 2:
        return kept
    stress = _fit(
        X[some], np.log(modulus[some]), design[some], target="log_secant_modulus", **known
    )
    return replace(kept, stress=stress)


def _fit(
    X: FloatArray,
    y: FloatArray,
    design: NDArray[np.int64],
    *,
    target: str,
    name: str,
    settings: dict[str, Any],
    seed: int,
    device: str,
    space: DesignSpace,
) -> KeptModel:
    estimator = make(name, seed=seed, device=device, **settings)
    estimator.fit(X, y)
    probes = _probes(X, seed)
    summary: dict[str, Any] = {
        "rows": len(X),
        "designs": len(np.unique(design)),
        "targets": {"mean": float(y.mean()), "sd": float(y.std())},
        "table": str(space.file),
        "dropped": space.dropped,
    }
    if isinstance(estimator, ExactGP):
        summary |= {
            "structure": estimator.structure_,
            "resampling_rms": estimator.resampling_rms_,
            "log_marginal_likelihood": estimator.log_marginal_likelihood_,
        }
    if isinstance(estimator, (ExactGP, SparseVariationalGP)):
        summary["hyperparameters"] = estimator.hyperparameters_.as_dict()
        summary["designs_left_out"] = _left_out(estimator, design, y, seed)
    return KeptModel(
        name=name,
        settings=settings,
        seed=seed,
        measure=space.measure,
        low=X.min(axis=0),
        high=X.max(axis=0),
        summary=summary,
        provenance=provenance(space.files),
        estimator=estimator,
        probes=(probes, np.asarray(estimator.predict(probes))),
        arrays=state_of(estimator, X, y),
        target=target,
    )


def save(kept: KeptModel, path: Path) -> None:
    """Write a model to a safetensors file; the same model gives the same bytes.

    Raises:
        UsageError: the settings hold what JSON cannot.
    """
    from safetensors.numpy import save as encode

    record: dict[str, Any] = {
        "schema": SCHEMA,
        "model": kept.name,
        "settings": kept.settings,
        "seed": kept.seed,
        "strain_measure": kept.measure,
        "columns": ["a_percent", "b_percent", "longitudinal_strain"],
        "target": kept.target,
        "low": kept.low.tolist(),
        "high": kept.high.tolist(),
        "summary": kept.summary,
        "provenance": kept.provenance,
    }
    arrays = _arrays(kept)
    if kept.stress is not None:
        record["stress"] = {
            "target": kept.stress.target,
            "low": kept.stress.low.tolist(),
            "high": kept.stress.high.tolist(),
            "summary": kept.stress.summary,
            "arrays": sorted(_arrays(kept.stress)),
        }
        # Designs and strains are those of Poisson's ratio: stored once.
        arrays |= {
            STRESS + name: array
            for name, array in _arrays(kept.stress).items()
            if not (name in arrays and np.array_equal(arrays[name], array))
        }
    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    try:
        text = json.dumps(record, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UsageError(
            "settings-not-plain",
            f"The model's settings cannot be written ({error}).",
            remedy="Use numbers, texts and lists only as settings.",
        ) from error
    record["sha256"] = _checksum(text, arrays)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(path.name + ".part")
    metadata = {"kiribench": json.dumps(record, sort_keys=True)}
    unfinished.write_bytes(encode(arrays, metadata=metadata))
    unfinished.replace(path)


def load(path: Path | str, *, device: str = "cpu") -> KeptModel:
    """Read a model that :func:`save` has written, and see that it predicts as it did.

    Raises:
        TableError: the file is missing, truncated, altered, or no model of ours.
        DataError: the model does not give its stored predictions with these libraries.
    """
    path = Path(path)
    record, arrays = _read(path)
    own = {name: array for name, array in arrays.items() if not name.startswith(STRESS)}
    kept = _restored(record, own, path, device)
    if "stress" not in record:
        return kept
    names = record["stress"]["arrays"]
    further = {name: arrays[STRESS + name if STRESS + name in arrays else name] for name in names}
    stress = _restored(record | record["stress"], further, path, device)
    return replace(kept, stress=stress)


def _arrays(kept: KeptModel) -> Arrays:
    return dict(kept.arrays) | {"probe_points": kept.probes[0], "probe_means": kept.probes[1]}


def _restored(record: dict[str, Any], arrays: Arrays, path: Path, device: str) -> KeptModel:
    """One of the models of a file, checked against its stored predictions."""
    model, settings, seed = record["model"], dict(record["settings"]), int(record["seed"])
    arrays = dict(arrays)
    probes = (arrays.pop("probe_points"), arrays.pop("probe_means"))
    estimator = with_state(make(model, seed=seed, device=device, **settings), record, arrays)
    spread = float(np.ptp(probes[1])) or 1.0
    off = float(np.abs(np.asarray(estimator.predict(probes[0])) - probes[1]).max())
    if not off <= PROBE_TOLERANCE * spread:
        raise DataError(
            "model-not-reproduced",
            "The loaded model does not give the predictions that were stored with it.",
            remedy="Load it with the library versions in its provenance, or fit it again.",
            file=path,
            got=f"off by {off:.2g}",
            expected=f"at most {PROBE_TOLERANCE * spread:.2g}",
        )
    return KeptModel(
        name=model,
        settings=settings,
        seed=seed,
        measure=record["strain_measure"],
        low=np.array(record["low"]),
        high=np.array(record["high"]),
        summary=record["summary"],
        provenance=record["provenance"],
        estimator=estimator,
        probes=probes,
        arrays=arrays,
        target=record["target"],
    )


def _read(path: Path) -> tuple[dict[str, Any], Arrays]:
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise TableError(
            "model-file-missing", "The model file does not exist.", remedy="Check it.", file=path
        )
    try:
        with safe_open(path, framework="numpy") as stream:
            metadata = stream.metadata() or {}
            arrays = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118
        record = json.loads(metadata["kiribench"])
        declared = record.pop("sha256")
        schema = record["schema"]
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise TableError(
            "model-file-damaged",
            f"The file is no model of kiribench, or is truncated ({type(error).__name__}).",
            remedy="Copy it again, or fit the model again.",
            file=path,
        ) from error
    if schema != SCHEMA:
        raise TableError(
            "model-file-version",
            "The model file has another format.",
            remedy="Use the version of kiribench that wrote it, or fit the model again.",
            file=path,
            got=schema,
            expected=SCHEMA,
        )
    if declared != _checksum(json.dumps(record, sort_keys=True), arrays):
        raise TableError(
            "model-file-altered",
            "The file's content does not match its checksum.",
            remedy="It was changed after it was written: copy it again, or fit the model again.",
            file=path,
        )
    return record, arrays


def _checksum(text: str, arrays: Arrays) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _probes(X: FloatArray, seed: int) -> FloatArray:
    low, high = X.min(axis=0), X.max(axis=0)
    return np.asarray(low + (high - low) * np.random.default_rng(seed).random((PROBES, 3)))


def _left_out(
    estimator: ExactGP | SparseVariationalGP,
    design: NDArray[np.int64],
    y: FloatArray,
    seed: int,
) -> dict[str, Any]:
    """How well folds of whole designs are predicted, hyperparameters kept (closed form)."""
    names = np.unique(design)
    count = min(FOLDS, len(names))
    if count < 2:
        return {"folds": 0}
    shuffled = np.random.default_rng(seed).permutation(names)
    folds = [np.flatnonzero(np.isin(design, some)) for some in np.array_split(shuffled, count)]
    results = leave_folds_out(estimator, folds)
    rows = np.concatenate([result.rows for result in results])
    error = np.concatenate([result.mean for result in results]) - y[rows]
    sd = np.concatenate([result.sd for result in results])
    return {
        "folds": count,
        "rmse": float(np.sqrt(np.mean(error**2))),
        "median_error": float(np.median(np.abs(error))),
        "max_error": float(np.abs(error).max()),
        "coverage95": float(np.mean(np.abs(error) <= 1.959963984540054 * sd)),
    }
