"""Designs for the fabrication tests: uniform, random, one-celled and without cuts."""

from __future__ import annotations

import numpy as np

from kiribench.schema.patch_design import PatchDesign


def given_design(
    a: np.ndarray,
    b: np.ndarray,
    *,
    side: str = "right",
    participant: str = "S1",
    cell: float = 15.0,
) -> PatchDesign:
    a, b = np.asarray(a, float), np.asarray(b, float)
    words = np.full(a.shape, "", dtype="<U8")
    return PatchDesign(participant, "given", side, cell, 2.0, "log", a, b, words, words)


def uniform_design(a: float, b: float, rows: int = 12, columns: int = 6, **more) -> PatchDesign:
    return given_design(np.full((rows, columns), a), np.full((rows, columns), b), **more)


def random_design(
    seed: int, rows: int = 12, columns: int = 6, *, low: float = 0.2, high: float = 0.9, **more
) -> PatchDesign:
    rng = np.random.default_rng(seed)
    shape = (rows, columns)
    return given_design(rng.uniform(low, high, shape), rng.uniform(low, high, shape), **more)
