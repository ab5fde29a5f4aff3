"""What is cross-validated: inputs, targets and groups, from a design space or any table."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, TableError
from kiribench.schema.design_space import DesignSpace, read_frame
from kiribench.schema.strict_json import short

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
DESIGN_FEATURES = ("a_percent", "b_percent", "longitudinal_strain")
_MOST_FAULTS = 20


@dataclass(frozen=True, eq=False)
class CvTable:
    """Rows to learn from, and what belongs together.

    Attributes:
        X: (n, d) inputs in the table's units.
        y: (n,) targets.
        features: (d,) names of the inputs.
        target: name of the targets.
        group: (n,) number of each row's group, 0 to p - 1: its design, or what the user
            says; each row its own where nobody says anything.
        group_names: (p,).
        group_word: what a group is called, singular: ``design``, ``group`` or ``row``.
        own_fold: (n,) the user's fold of each row, or ``None``.
        fold_names: names of the user's folds.
        mesh_error: (n,) the simulation's own error of the target, NaN where unknown, or
            ``None``.
        measure: the strain measure of a design space, else ``None``.
        space: the design space that the rows come from, else ``None``.
        files: what was read.
    """

    X: FloatArray
    y: FloatArray
    features: tuple[str, ...]
    target: str
    group: IntArray
    group_names: tuple[str, ...]
    group_word: str
    own_fold: IntArray | None = None
    fold_names: tuple[str, ...] = ()
    mesh_error: FloatArray | None = None
    measure: str | None = None
    space: DesignSpace | None = None
    files: tuple[Path, ...] = ()

    @property
    def is_design_space(self) -> bool:
        """Whether the inputs are a, b (percent) and the longitudinal strain."""
        return self.features == DESIGN_FEATURES

    @property
    def groups(self) -> int:
        """The number of groups."""
        return len(self.group_names)

    @property
    def mesh_error_rms(self) -> float | None:
        """Root mean square of the mesh error over the rows that have one."""
        if self.mesh_error is None or not np.isfinite(self.mesh_error).any():
            return None
        known = self.mesh_error[np.isfinite(self.mesh_error)]
        return float(np.sqrt(np.mean(known**2))) or None

    @property
    def sha256(self) -> str:
        """Hash of everything that the results depend on, whatever file it came from."""
        digest = hashlib.sha256()
        digest.update(repr((self.features, self.target, self.measure)).encode())
        for array in (self.X, self.y, self.group, self.own_fold, self.mesh_error):
            digest.update(b"none" if array is None else np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def of_design_space(space: DesignSpace, own_fold: Sequence[str] | None = None) -> CvTable:
    """The rows of a design space: (a, b, strain) to Poisson's ratio, grouped by design.

    Two designs with the same cut lengths are one group, whatever their names: leaving one of
    them out would not hide its answer.

    Args:
        space: checked by its reader.
        own_fold: (n,) fold of each row of ``space``, if the user brings folds.
    """
    cuts = np.column_stack([space.a_percent, space.b_percent])
    pairs, group = np.unique(cuts, axis=0, return_inverse=True)
    group = group.ravel().astype(np.int64)
    names = [""] * len(pairs)
    for row in range(len(group) - 1, -1, -1):
        names[group[row]] = space.design_names[space.design[row]]
    folds, fold_names = _numbered(own_fold)
    return CvTable(
        X=space.inputs,
        y=space.poisson_ratio,
        features=DESIGN_FEATURES,
        target="poisson_ratio",
        group=group,
        group_names=tuple(names),
        group_word="design",
        own_fold=folds,
        fold_names=fold_names,
        mesh_error=space.mesh_error_poisson,
        measure=space.measure,
        space=space,
        files=space.files,
    )


def column_of_space(space: DesignSpace, column: str) -> list[str]:
    """A further column of a design space's file, for the rows that were kept.

    Raises:
        TableError: there is no such column, or a value is missing.
    """
    frame = read_frame(space.file)
    _check_columns(list(frame.columns), [column], space.file)
    values = frame[column].iloc[space.table_row - 1]
    _check_complete(values.isna().to_numpy(), space.table_row, column, space.file)
    return [str(value) for value in values]


def grouped_by(table: CvTable, labels: Sequence[str]) -> CvTable:
    """The same rows with the user's groups, (n,) labels."""
    from dataclasses import replace

    group, names = _numbered(labels)
    if group is None:
        raise ValueError("labels are needed")
    return replace(table, group=group, group_names=names, group_word="group")


def read_regression_table(
    path: Path,
    features: Sequence[str],
    target: str,
    *,
    group_column: str | None = None,
    fold_column: str | None = None,
) -> CvTable:
    """Read any table of numbers: no strain grid, no designs.

    Args:
        path: CSV, TSV or Parquet.
        features: columns of the inputs.
        target: column of the targets.
        group_column: rows with the same value are never on both sides of an honest split.
        fold_column: the user's own folds.

    Raises:
        TableError: with every fault found: columns that are missing or named twice, values
            that are no finite numbers, labels that are missing.
    """
    import pandas as pd

    frame = read_frame(path)
    labels = [name for name in (group_column, fold_column) if name is not None]
    _check_columns(list(frame.columns), [*features, target, *labels], path)
    if target in features or len(set(features)) < len(features):
        raise TableError(
            "column-twice",
            "A column is named twice among the inputs and the target.",
            remedy="Name each column once, and the target not among the inputs.",
            file=path,
            got=", ".join([*features, target]),
        )
    faults: list[Fault] = []
    numbers: dict[str, FloatArray] = {}
    for name in (*features, target):
        numbers[name] = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
        faults += [
            Fault(
                "value-no-number",
                "The value is no finite number.",
                "Correct it, or leave the row out.",
                file=str(path),
                row=int(index) + 1,
                column=name,
                got=short(str(frame[name].iloc[index])),
            )
            for index in np.flatnonzero(~np.isfinite(numbers[name]))[:_MOST_FAULTS]
        ]
    if faults:
        raise TableError.of(faults[:_MOST_FAULTS])
    rows = np.arange(1, len(frame) + 1)
    for name in labels:
        _check_complete(frame[name].isna().to_numpy(), rows, name, path)
    group, group_names = _numbered(
        [str(value) for value in (rows if group_column is None else frame[group_column])]
    )
    own_fold, fold_names = _numbered(
        None if fold_column is None else [str(value) for value in frame[fold_column]]
    )
    if group is None:
        raise ValueError("a table without rows has passed its reader")
    return CvTable(
        X=np.column_stack([numbers[name] for name in features]),
        y=numbers[target],
        features=tuple(features),
        target=target,
        group=group,
        group_names=group_names,
        group_word="row" if group_column is None else "group",
        own_fold=own_fold,
        fold_names=fold_names,
        files=(path,),
    )


def _numbered(labels: Sequence[str] | None) -> tuple[IntArray | None, tuple[str, ...]]:
    """Numbers in the order of first appearance, and the names."""
    if labels is None:
        return None, ()
    number: dict[str, int] = {}
    for label in labels:
        number.setdefault(label, len(number))
    return np.array([number[label] for label in labels], dtype=np.int64), tuple(number)


def _check_columns(have: list[str], wanted: Sequence[str], path: Path) -> None:
    absent = [name for name in wanted if name not in have]
    if absent:
        raise TableError.of(
            Fault(
                "column-missing",
                f"The column {name} is missing.",
                "Name columns of the table.",
                file=str(path),
                column=name,
                got=short(", ".join(map(str, have)), 200),
            )
            for name in absent
        )


def _check_complete(missing: NDArray[np.bool_], rows: IntArray, column: str, path: Path) -> None:
    if missing.any():
        raise TableError.of(
            Fault(
                "label-missing",
                "The row has no group or fold.",
                "Give every row a label.",
                file=str(path),
                row=int(rows[index]),
                column=column,
            )
            for index in np.flatnonzero(missing)[:_MOST_FAULTS]
        )
