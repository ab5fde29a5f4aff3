"""One division of the rows into those that a model learns from and those that test it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Fold:
    """Training and test rows of one fit.

    Attributes:
        repeat: which division of the rows, 0 for protocols with one.
        index: which fold of it.
        label: for people: ``a = 35``, ``120 designs``.
        train, test: row numbers, increasing.
        size: training groups, for the learning curve, else ``None``.
    """

    repeat: int
    index: int
    label: str
    train: IntArray
    test: IntArray
    size: int | None = None

    @property
    def name(self) -> str:
        """A name for its file, unique within a protocol."""
        return f"r{self.repeat:02d}-f{self.index:03d}"


def complement(test: IntArray, rows: int) -> IntArray:
    """The row numbers below ``rows`` that are not in ``test``."""
    kept = np.ones(rows, dtype=bool)
    kept[test] = False
    return np.flatnonzero(kept).astype(np.int64)


def folds_of_labels(
    label: IntArray, *, repeat: int = 0, names: tuple[str, ...] | None = None
) -> tuple[Fold, ...]:
    """One fold a label: its rows are tested, all others train.

    Args:
        label: (n,) fold of each row, 0 to k - 1; labels without rows give no fold.
        repeat: see :class:`Fold`.
        names: (k,) for people; ``fold 1`` and so on by default.
    """
    folds = []
    for index in range(int(label.max()) + 1):
        test = np.flatnonzero(label == index).astype(np.int64)
        if 0 < len(test) < len(label):
            name = names[index] if names is not None else f"fold {index + 1}"
            folds.append(Fold(repeat, index, name, complement(test, len(label)), test))
    return tuple(folds)
