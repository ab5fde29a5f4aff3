"""Responses with known answers, and a small surrogate of a closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from stand_in import stand_in_table

from kiribench.design.problem import DesignProblem
from kiribench.design.response import Jet
from kiribench.design.surrogates import Surrogates
from kiribench.schema.design_space import DesignSpace
from kiribench.surrogate import fit_table

FloatArray = np.ndarray


@dataclass(frozen=True, eq=False)
class Toy:
    """The same function f(a, b) in every cell, scaled by a number of its own.

    ``function`` takes (a, b) and gives f, f_a, f_b, f_aa, f_ab, f_bb.
    """

    function: Callable[[FloatArray, FloatArray], tuple[FloatArray, ...]]
    scale: FloatArray

    @property
    def count(self) -> int:
        return len(self.scale)

    def on_grid(self, a: FloatArray, b: FloatArray, cells: FloatArray | None = None) -> FloatArray:
        scale = self.scale if cells is None else self.scale[cells]
        x, y = np.meshgrid(a, b, indexing="ij")
        return scale[:, None, None] * self.function(x, y)[0]

    def jet(self, points: FloatArray, cells: FloatArray | None = None) -> Jet:
        scale = self.scale if cells is None else self.scale[cells]
        f, fa, fb, faa, fab, fbb = self.function(points[:, 0], points[:, 1])
        zero = np.zeros(len(points))
        slope = np.stack([fa + zero, fb + zero], axis=-1)
        curvature = np.stack([faa + zero, fab + zero, fab + zero, fbb + zero], axis=-1)
        return Jet(
            scale * f,
            scale[:, None] * slope,
            scale[:, None, None] * curvature.reshape(-1, 2, 2),
        )


def plane(a: FloatArray, b: FloatArray) -> tuple[FloatArray, ...]:
    """3 a + 4 b: the nearest point of 3 a + 4 b = c to the origin is c (3, 4) / 25."""
    return 3 * a + 4 * b, 3.0, 4.0, 0.0, 0.0, 0.0


def hill(a: FloatArray, b: FloatArray) -> tuple[FloatArray, ...]:
    """A hill of height 1 at (.6, .3) and of width .2; nothing else."""
    u, v = (a - 0.6) / 0.2, (b - 0.3) / 0.2
    f = np.exp(-0.5 * (u * u + v * v))
    return (
        f,
        -u * f / 0.2,
        -v * f / 0.2,
        (u * u - 1) * f / 0.04,
        u * v * f / 0.04,
        (v * v - 1) * f / 0.04,
    )


def product(a: FloatArray, b: FloatArray) -> tuple[FloatArray, ...]:
    """a b: the nearest point of a b = c to the origin is (sqrt c, sqrt c)."""
    return a * b, b, a, 0.0, 1.0, 0.0


def modulus(a: FloatArray, b: FloatArray) -> FloatArray:
    """Secant modulus in MPa of the stand-in: falls thirtyfold as the cuts grow."""
    return 0.6 * np.exp(-2.5 * a**2 - 1.2 * b**2 - 0.5 * a * b)


@cache
def surrogates(model: str = "gp_kronecker", levels: int = 8) -> Surrogates:
    """A model of the closed-form stand-in, with its stress."""
    X, nu = stand_in_table(levels, np.linspace(0.05, 0.6, 8))
    _, design = np.unique(X[:, :2], axis=0, return_inverse=True)
    space = DesignSpace(
        file=Path(__file__),
        a_percent=X[:, 0],
        b_percent=X[:, 1],
        longitudinal_strain=X[:, 2],
        poisson_ratio=nu,
        design=design,
        design_names=tuple(map(str, range(design.max() + 1))),
        measure="log",
        nominal_stress_mpa=X[:, 2] * modulus(X[:, 0] / 100, X[:, 1] / 100),
    )
    settings = {} if model == "polynomial" else {"max_evaluations": 8}
    return Surrogates(fit_table(space, model, **settings))


def problem(
    strain: FloatArray, nu: FloatArray, *, measure: str = "log", cell_mm: float = 15.0
) -> DesignProblem:
    """A patch with these targets in log strain; NaN is a missing one."""
    stretch = np.exp(strain)
    return DesignProblem(
        participant="T",
        side="right",
        cell_mm=cell_mm,
        thickness_mm=2.0,
        strain_measure=measure,
        region=np.full(strain.shape, "all"),
        longitudinal_strain=strain,
        poisson_ratio=nu,
        longitudinal_stretch=stretch,
        lateral_stretch=np.exp(-nu * strain),
        reason=np.where(np.isfinite(nu), "", "node-missing"),
    )


def drawn_problem(seed: int, rows: int = 5, columns: int = 4) -> tuple[DesignProblem, FloatArray]:
    """Targets that known cuts have by the surrogate's own mean, and these cuts (R, C, 2)."""
    rng = np.random.default_rng(seed)
    strain = rng.uniform(0.08, 0.5, (rows, columns))
    cuts = rng.uniform(0.05, 0.85, (rows, columns, 2))
    kept = surrogates().poisson
    nu = kept.predict(100 * cuts[..., 0].ravel(), 100 * cuts[..., 1].ravel(), strain.ravel()).mean
    return problem(strain, nu.reshape(rows, columns)), cuts
