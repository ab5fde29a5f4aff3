"""Fit a surrogate to a design space, keep it in one file, and predict from it.

The file is safetensors: plain arrays and one JSON string, nothing that runs when it is
read. A Gaussian process keeps its data and hyperparameters and is conditioned anew when
it is loaded; other models keep data, settings and seed and are fitted anew. Both must
give back the predictions, means and standard deviations, that were stored with them.

Where the table holds the nominal stress, a Gaussian process of Poisson's ratio carries a second
one of the logarithm of the secant modulus, ``ln(stress / strain)``: it stays finite at strain 0,
is positive by construction, and its error is a relative one over a range of forces of 30 to 1.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import DataError, TableError
from kiribench.provenance import provenance
from kiribench.schema.design_space import MEASURES, DesignSpace
from kiribench.surrogate import kept_file
from kiribench.surrogate.exact_gp import ExactGP
from kiribench.surrogate.kept_file import Arrays
from kiribench.surrogate.kept_model import KeptModel, Probes
from kiribench.surrogate.leave_out import leave_folds_out
from kiribench.surrogate.registry import Regressor, make, spec
from kiribench.surrogate.state import state_of, with_state
from kiribench.surrogate.svgp import SparseVariationalGP

FloatArray = NDArray[np.float64]
SCHEMA = "kiribench.model/2"
PROBES = 16
PROBE_TOLERANCE = 1e-6  # of the targets' range; other versions of the libraries may differ
FOLDS = 10
TARGETS = ("poisson_ratio", "log_secant_modulus")
STRESS = "stress."  # before the names of the second model's arrays


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
    low, high = X.min(axis=0), X.max(axis=0)
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
        low=low,
        high=high,
        summary=summary,
        provenance=provenance(space.files),
        estimator=estimator,
        probes=_predicted(estimator, name, _probe_points(low, high, seed)),
        arrays=state_of(estimator, X, y),
        target=target,
    )


def save(kept: KeptModel, path: Path) -> None:
    """Write a model to a safetensors file; the same model gives the same bytes.

    Raises:
        UsageError: the settings hold what JSON cannot.
    """

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
    kept_file.write(path, record, arrays)


def load(path: Path | str, *, device: str = "cpu") -> KeptModel:
    """Read a model that :func:`save` has written, and see that it predicts as it did.

    Raises:
        TableError: the file is missing, truncated, altered, or no model of ours.
        DataError: the model does not give its stored predictions with these libraries.
    """
    path = Path(path)
    record, arrays = kept_file.read(path, SCHEMA, what="model")
    try:
        own = {name: array for name, array in arrays.items() if not name.startswith(STRESS)}
        kept = _restored(record, own, path, device)
        if "stress" not in record:
            return kept
        names = record["stress"]["arrays"]
        theirs = {
            name: arrays[STRESS + name if STRESS + name in arrays else name] for name in names
        }
        return replace(kept, stress=_restored(record | record["stress"], theirs, path, device))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RuntimeError) as error:
        # Its checksum is right: a program of ours, or of somebody else, wrote it so.
        absent = error.args[0] if isinstance(error, KeyError) and error.args else None
        raise TableError(
            "model-file-incomplete",
            "The model file lacks something that this version of kiribench needs, or has it "
            f"otherwise ({type(error).__name__}).",
            remedy="Fit the model again with this version.",
            file=path,
            column=None if absent is None else str(absent),
        ) from error


def _arrays(kept: KeptModel) -> Arrays:
    points, means, sds = kept.probes
    probes = {"probe_points": points, "probe_means": means}
    return dict(kept.arrays) | probes | ({} if sds is None else {"probe_sds": sds})


def _restored(record: dict[str, Any], arrays: Arrays, path: Path, device: str) -> KeptModel:
    """One of the models of a file, checked against its stored predictions."""
    model, settings, seed = record["model"], dict(record["settings"]), int(record["seed"])
    arrays = dict(arrays)
    stored: Probes = (
        arrays.pop("probe_points"),
        arrays.pop("probe_means"),
        arrays.pop("probe_sds") if spec(model).has_uncertainty else None,
    )
    estimator = with_state(make(model, seed=seed, device=device, **settings), record, arrays)
    low, high = (np.array(record[name], dtype=np.float64).reshape(3) for name in ("low", "high"))
    _compare(stored, _predicted(estimator, model, _probe_points(low, high, seed)), path)
    if record["strain_measure"] not in MEASURES or record["target"] not in TARGETS:
        raise ValueError("a strain measure or a target that there is not")
    return KeptModel(
        name=model,
        settings=settings,
        seed=seed,
        measure=record["strain_measure"],
        low=low,
        high=high,
        summary=record["summary"],
        provenance=record["provenance"],
        estimator=estimator,
        probes=stored,
        arrays=arrays,
        target=record["target"],
    )


def _probe_points(low: FloatArray, high: FloatArray, seed: int) -> FloatArray:
    return np.asarray(low + (high - low) * np.random.default_rng(seed).random((PROBES, 3)))


def _predicted(estimator: Regressor, model: str, points: FloatArray) -> Probes:
    if spec(model).has_uncertainty:
        mean, sd = estimator.predict(points, return_std=True)  # type: ignore[call-arg]
        return points, np.asarray(mean), np.asarray(sd)
    return points, np.asarray(estimator.predict(points)), None


def _compare(stored: Probes, found: Probes, path: Path) -> None:
    """See that points (of range and seed), means and standard deviations are the file's."""
    spread = float(np.ptp(stored[1])) or 1.0
    for before, now, unit in zip(stored, found, (np.ptp(stored[0]), spread, spread), strict=True):
        if before is None or now is None:
            continue
        off = float(np.abs(now - before).max() / unit)
        if not off <= PROBE_TOLERANCE:
            raise DataError(
                "model-not-reproduced",
                "The loaded model does not give the predictions that were stored with it.",
                remedy="Load it with the library versions in its provenance, or fit it again.",
                file=path,
                got=f"off by {off:.2g} of the range",
                expected=f"at most {PROBE_TOLERANCE:.2g}",
            )


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
