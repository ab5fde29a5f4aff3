"""Rows to a designs x strains grid: found where it is there, made by splines where it is not.

A table of ``simulate`` is a set of curves: one design (a, b), some 25 strains. On a
common strain grid an exact Gaussian process with a product kernel is a Kronecker one and
about a hundred times cheaper. Where every design has its own strains (a sheet pulled by
displacement) each curve is resampled by a cubic spline, never beyond its own range:
entries that a design does not reach stay unobserved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]
MIN_CURVE = 8  # a spline through fewer points is no resampling worth the name
MIN_DESIGNS = 4
_END_SLACK = 0.3  # of a step: ends so close together may be cut to what all curves reach
_SNAP = 1e-9  # strains closer than this fraction of the range are one grid strain


@dataclass(frozen=True, eq=False)
class DesignGrid:
    """Curves on a common strain grid, with what is not observed marked.

    Attributes:
        designs: (p, d - 1) inputs of the designs, units of the table.
        curve: (m,) the grid's strains, increasing.
        values: (p, m) targets; 0 where not observed.
        observed: (p, m) bool.
        row_design: (n,) design index of each row of the table.
        row_strain: (n,) strain of each row, as the table has it.
        row_curve: (n,) grid index of each row, or -1 where the row was resampled.
        resampled: whether splines were used.
        resampling_rms: targets' unit; estimated rms error of the splines, 0 where nothing
            was resampled: splines through every second row against the rows between them,
            over 16 because a cubic spline errs with the fourth power of the spacing.
    """

    designs: FloatArray
    curve: FloatArray
    values: FloatArray
    observed: NDArray[np.bool_]
    row_design: NDArray[np.int64]
    row_strain: FloatArray
    row_curve: NDArray[np.int64]
    resampled: bool
    resampling_rms: float

    @property
    def missing(self) -> NDArray[np.int64]:
        """(k,) flat indices of the entries that are not observed."""
        return np.flatnonzero(~self.observed.ravel()).astype(np.int64)

    @property
    def lost(self) -> float:
        """Share of the table's rows that lie more than half a step off both ends of the grid."""
        low = self.curve[0] - 0.5 * (self.curve[1] - self.curve[0])
        high = self.curve[-1] + 0.5 * (self.curve[-1] - self.curve[-2])
        return float(np.mean((self.row_strain < low) | (self.row_strain > high)))


def find_grid(X: FloatArray, y: FloatArray, *, min_filled: float = 0.5) -> DesignGrid | None:
    """The grid that the rows already are, or ``None``.

    Args:
        X: (n, d) inputs, the strain last.
        y: (n,) targets.
        min_filled: the least observed fraction of the grid; a set of scattered rows has
            a grid too, but an almost empty one.
    """
    if X.shape[1] < 2:
        return None
    designs, row_design = np.unique(X[:, :-1], axis=0, return_inverse=True)
    row_design = row_design.ravel()
    curve, row_curve = _snapped(X[:, -1])
    p, m = len(designs), len(curve)
    if p < 2 or m < 2 or len(X) < min_filled * p * m:
        return None
    flat = row_design * m + row_curve
    if len(np.unique(flat)) < len(flat):
        return None  # repeated rows: no grid, the dense path takes them
    values = np.zeros(p * m)
    values[flat] = y
    observed = np.zeros(p * m, dtype=bool)
    observed[flat] = True
    return DesignGrid(
        designs=designs,
        curve=curve,
        values=values.reshape(p, m),
        observed=observed.reshape(p, m),
        row_design=row_design.astype(np.int64),
        row_strain=curve[row_curve],
        row_curve=row_curve.astype(np.int64),
        resampled=False,
        resampling_rms=0.0,
    )


def are_curves(X: FloatArray) -> bool:
    """Whether the rows are curves that :func:`resample` takes: few designs, many strains each."""
    if X.shape[1] < 2 or len(X) < MIN_CURVE * MIN_DESIGNS:
        return False
    designs, row_design = np.unique(X[:, :-1], axis=0, return_inverse=True)
    counts = np.bincount(row_design.ravel())
    if len(designs) < MIN_DESIGNS or np.median(counts) < MIN_CURVE:
        return False
    repeated = len(np.unique(X, axis=0)) < len(X)
    return not repeated


def thinned(X: FloatArray, most: int) -> NDArray[np.int64]:
    """Row numbers, increasing: as many of each curve as ``most`` allows, its ends among them.

    Args:
        X: (n, d) inputs, the strain last.
        most: rows to keep, but two of each design at least.
    """
    if len(X) <= most:
        return np.arange(len(X))
    _, row_design = np.unique(X[:, :-1], axis=0, return_inverse=True)
    row_design = row_design.ravel()
    counts = np.bincount(row_design)
    each = max(2, most // len(counts))
    order = np.lexsort((X[:, -1], row_design))
    kept = [
        rows[np.unique(np.linspace(0, len(rows) - 1, each).round().astype(np.int64))]
        for rows in np.split(order, np.cumsum(counts)[:-1])
    ]
    return np.sort(np.concatenate(kept))


def resample(X: FloatArray, y: FloatArray, *, curve: FloatArray | None = None) -> DesignGrid:
    """Each design's curve by a cubic spline on a common strain grid, never extrapolated.

    Args:
        X: (n, d) inputs, the strain last; :func:`are_curves` holds.
        y: (n,) targets.
        curve: (m,) the grid's strains; by default :func:`common_strains`.
    """
    designs, row_design = np.unique(X[:, :-1], axis=0, return_inverse=True)
    row_design = row_design.ravel().astype(np.int64)
    strain = X[:, -1]
    grid = common_strains(strain, row_design) if curve is None else curve
    slack = _SNAP * float(np.ptp(grid))
    values = np.zeros((len(designs), len(grid)))
    observed = np.zeros(values.shape, dtype=bool)
    squared, compared = 0.0, 0
    order = np.lexsort((strain, row_design))
    for design, rows in enumerate(np.split(order, np.cumsum(np.bincount(row_design))[:-1])):
        x, f = strain[rows], y[rows]
        inside = (grid >= x[0] - slack) & (grid <= x[-1] + slack)
        if len(x) < 4:  # too few for a cubic: only strains that were simulated count
            inside &= np.isclose(grid[:, None], x[None, :], rtol=0.0, atol=slack).any(axis=1)
        if not inside.any():
            continue
        values[design, inside] = _curve_at(x, f, np.clip(grid[inside], x[0], x[-1]))
        observed[design] = inside
        for start in (0, 1):
            known = slice(start, None, 2)
            between = np.arange(1 + start, len(x) - 1, 2)
            if len(x[known]) >= 4:
                error = _curve_at(x[known], f[known], x[between]) - f[between]
                squared += float(np.sum(error[x[between] < x[known][-1]] ** 2))
                compared += int(np.sum(x[between] < x[known][-1]))
    return DesignGrid(
        designs=designs,
        curve=grid,
        values=values,
        observed=observed,
        row_design=row_design,
        row_strain=strain.copy(),
        row_curve=np.full(len(X), -1, dtype=np.int64),
        resampled=True,
        resampling_rms=float(np.sqrt(squared / compared)) / 16.0 if compared else 0.0,
    )


def common_strains(strain: FloatArray, row_design: NDArray[np.int64]) -> FloatArray:
    """Strains that suit all curves: the medians, step by step, within what most designs reach.

    The ends are those that all full-length curves reach, where that costs no curve more than a
    part of a step. Else they are the 90 % quantile of the first and the 10 % quantile of the last
    strains of the full-length curves, so that at most a tenth of the designs leaves an entry
    unobserved at an end.

    Args:
        strain: (n,) of all rows.
        row_design: (n,) design index of each row.
    """
    counts = np.bincount(row_design)
    steps = int(np.median(counts))
    order = np.lexsort((strain, row_design))
    curves = [
        strain[rows] for rows in np.split(order, np.cumsum(counts)[:-1]) if len(rows) >= steps
    ]
    fraction = np.linspace(0.0, 1.0, steps)
    at = np.array([np.interp(fraction, np.linspace(0, 1, len(c)), c) for c in curves])
    middle = np.median(at, axis=0)
    low, high = np.quantile(at[:, 0], 0.9), np.quantile(at[:, -1], 0.1)
    if at[:, 0].max() - at[:, 0].min() < _END_SLACK * (middle[1] - middle[0]):
        low = at[:, 0].max()
    if at[:, -1].max() - at[:, -1].min() < _END_SLACK * (middle[-1] - middle[-2]):
        high = at[:, -1].min()
    if not low < high:
        low, high = middle[0], middle[-1]
    position = (middle - middle[0]) / (middle[-1] - middle[0])
    return np.asarray(low + position * (high - low), dtype=np.float64)


def _curve_at(x: FloatArray, f: FloatArray, at: FloatArray) -> FloatArray:
    if len(x) < 4:
        return np.asarray(np.interp(at, x, f), dtype=np.float64)
    return np.asarray(CubicSpline(x, f)(at), dtype=np.float64)


def _snapped(strain: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Strains that differ by rounding only are one grid strain."""
    order = np.argsort(strain, kind="stable")
    gaps = np.diff(strain[order])
    span = float(np.ptp(strain))
    group = np.concatenate(([0], np.cumsum(gaps > _SNAP * span)))
    index = np.empty(len(strain), dtype=np.int64)
    index[order] = group
    firsts = np.concatenate(([0], np.flatnonzero(np.diff(group)) + 1))
    return strain[order][firsts], index
