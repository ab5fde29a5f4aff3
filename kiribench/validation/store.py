"""Results on disk, one file a (protocol, model, fold), written at once and whole.

A file is safetensors under a checksum (:mod:`kiribench.surrogate.kept_file`): the predictions
as arrays, the rest as one JSON record. It is written under another name and then renamed, so that
a killed run leaves whole files only; the next run with the same settings and the same table
reads them and computes what is missing or damaged.
"""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.errors import TableError, UsageError
from kiribench.surrogate import kept_file
from kiribench.validation.outcome import FoldOutcome

PLAN = "cv_plan.json"
FOLDS = "folds"
SCHEMA = "kiribench.fold/1"


class Store:
    """The folder of a run.

    Args:
        folder: made if it is not there.
        plan: everything that the numbers depend on, as JSON: settings, hash of the table,
            versions of the libraries.

    Raises:
        UsageError: the folder holds results of another plan.
    """

    def __init__(self, folder: Path, plan: dict[str, Any]) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / PLAN
        plan = json.loads(json.dumps(plan))
        if path.is_file():
            _compare(path, plan)
        elif (folder / FOLDS).is_dir() and any((folder / FOLDS).iterdir()):
            raise _other(folder, f"{PLAN} is missing beside {FOLDS}/")
        else:
            _replace(path, (json.dumps(plan, indent=2) + "\n").encode())

    def path(self, protocol: str, model: str, fold: str) -> Path:
        """Where the outcome of a fold is kept."""
        return self.folder / FOLDS / protocol / model.replace(":", "-") / f"{fold}.safetensors"

    def write(self, outcome: FoldOutcome) -> None:
        """Keep an outcome: all of it or nothing."""
        arrays = {"mean": outcome.mean}
        if outcome.sd is not None:
            arrays["sd"] = outcome.sd
        record = {
            key: getattr(outcome, key)
            for key in (
                "protocol",
                "model",
                "fold",
                "fit_s",
                "predict_s",
                "train_r2",
                "closed_form",
                "failure",
                "notes",
            )
        }
        path = self.path(outcome.protocol, outcome.model, outcome.fold)
        kept_file.write(path, {"schema": SCHEMA, **record}, arrays)

    def read(self, protocol: str, model: str, fold: str, rows: int) -> FoldOutcome | None:
        """The kept outcome; ``None`` where there is none, or where the file is damaged.

        Args:
            protocol, model, fold: names.
            rows: number of test rows that it must have.
        """
        path = self.path(protocol, model, fold)
        try:
            record, arrays = kept_file.read(path, SCHEMA, what="fold")
        except TableError:
            return None
        del record["schema"]
        asked = (protocol, model, fold)
        if tuple(record.get(key) for key in ("protocol", "model", "fold")) != asked:
            return None
        mean = arrays.get("mean")
        if mean is None or (record["failure"] is None and mean.shape != (rows,)):
            return None
        sd = arrays.get("sd")
        return FoldOutcome(
            mean=mean.astype(np.float64),
            sd=None if sd is None else sd.astype(np.float64),
            **record,
        )


def _compare(path: Path, plan: dict[str, Any]) -> None:
    try:
        old = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise _other(path.parent, f"{PLAN} cannot be read") from error
    differs = sorted(key for key in {*old, *plan} if old.get(key) != plan.get(key))
    if differs:
        shown = "; ".join(f"{key}: {old.get(key)} there, {plan.get(key)} now" for key in differs)
        raise _other(path.parent, shown)


def _other(folder: Path, what: str) -> UsageError:
    return UsageError(
        "cv-out-of-another-run",
        "The folder holds the results of another cross-validation.",
        remedy="Give another --out folder, or the same table and settings to go on.",
        file=folder,
        got=what if len(what) < 400 else what[:397] + "...",
    )


def _replace(path: Path, content: bytes) -> None:
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            partial.unlink()
