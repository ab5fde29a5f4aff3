"""Fit a surrogate to a design space, keep it in one file, and predict from it.

The file is safetensors: plain arrays and one JSON string, nothing that runs when it is
read. A Gaussian process keeps its data and hyperparameters and is conditioned anew when
it is loaded; other models keep data, settings and seed and are fitted anew. Both must
give back the predictions that were stored with them.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
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

    def predict(
        self,
        a_percent: ArrayLike,
        b_percent: ArrayLike,
        longitudinal_strain: ArrayLike,
        *,
        measure: str | None = None,
    ) -> Prediction:
        """Poisson's ratio at the given points, which are broadcast against each other.

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
    X, y, design = space.inputs[order], space.poisson_ratio[order], space.design[order]
    estimator = make(model, seed=seed, device=device, **settings)
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
        name=model,
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
    )


def save(kept: KeptModel, path: Path) -> None:
    """Write a model to a safetensors file; the same model gives the same bytes.

    Raises:
        UsageError: the settings hold what JSON cannot.
    """
    from safetensors.numpy import save as encode

    record = {
        "schema": SCHEMA,
        "model": kept.name,
        "settings": kept.settings,
        "seed": kept.seed,
        "strain_measure": kept.measure,
        "columns": ["a_percent", "b_percent", "longitudinal_strain"],
        "target": "poisson_ratio",
        "low": kept.low.tolist(),
        "high": kept.high.tolist(),
        "summary": kept.summary,
        "provenance": kept.provenance,
    }
    arrays = dict(kept.arrays) | {"probe_points": kept.probes[0], "probe_means": kept.probes[1]}
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
    model, settings, seed = record["model"], dict(record["settings"]), int(record["seed"])
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
        "max_error": float(np.abs(error).max()),
        "coverage95": float(np.mean(np.abs(error) <= 1.959963984540054 * sd)),
    }
