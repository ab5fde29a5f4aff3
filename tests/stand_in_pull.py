"""Tensile tests made by the simulator itself, with known offsets and known scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kiribench.fem.facet import MeshSpec
from kiribench.fem.patch import simulate_patch
from kiribench.lattice import CutMap
from kiribench.reference.tensile import TensileOptions, uniform_design
from kiribench.reference.tensile_simulation import Specimen, with_longer_cuts
from kiribench.schema.patch_design import PatchDesign
from kiribench.tensile.result import TensileTest

ROWS, COLUMNS, CELL_MM = 8, 4, 10.0
BLOCK = (4, 2)
MESH = MeshSpec().scaled(1.3)
OPTIONS = TensileOptions(specimen=Specimen(mesh=MESH))
TRAVEL_MM = np.linspace(0.0, 40.0, 14)


@dataclass(frozen=True)
class Truth:
    """What the sample really is, against what the design says."""

    longer_a: float = 0.0
    longer_b: float = 0.0
    specimen: Specimen = OPTIONS.specimen
    slip: float = 0.0
    slack_mm: float = 0.0
    thicker: float = 0.0


def design(a: float = 0.8, b: float = 0.7) -> PatchDesign:
    return uniform_design(a, b, ROWS, COLUMNS, CELL_MM)


def pull(
    planned: PatchDesign,
    truth: Truth,
    *,
    noise_sd: float = 5e-4,
    cell_sd: float = 0.0,
    seed: int = 0,
    loads: bool = True,
) -> TensileTest:
    """The test that a camera with ``noise_sd`` (strain) would give of the true sample.

    ``cell_sd``: of the factor by which a cell's lateral strain differs for good.
    """
    sample = with_longer_cuts(planned, truth.longer_a, truth.longer_b)
    reached = np.maximum(TRAVEL_MM[1:] * (1 - truth.slip) - truth.slack_mm, 1e-3)
    path = simulate_patch(
        CutMap(sample.a, sample.b, sample.cell_mm),
        reached,
        grip_mm=truth.specimen.grip_mm,
        ends=truth.specimen.ends,
        mesh=truth.specimen.mesh,
        material=truth.specimen.material,
    )
    path.path.require_converged()
    return as_test(path.longitudinal_stretch, path.lateral_stretch, path.path.nominal_stress_mpa
                   * COLUMNS * CELL_MM * sample.thickness_mm * (1 + truth.thicker),
                   noise_sd=noise_sd, cell_sd=cell_sd, seed=seed, loads=loads)  # fmt: skip


def as_test(
    along: np.ndarray,
    across: np.ndarray,
    force_n: np.ndarray,
    *,
    noise_sd: float,
    cell_sd: float = 0.0,
    seed: int = 0,
    loads: bool = True,
) -> TensileTest:
    rng = np.random.default_rng(seed)
    first, left = (ROWS - BLOCK[0]) // 2, (COLUMNS - BLOCK[1]) // 2
    part = (slice(None), slice(first, first + BLOCK[0]), slice(left, left + BLOCK[1]))
    logs = np.stack([np.log(along[part]), np.log(across[part])], axis=-1)
    logs = np.concatenate([np.zeros((1, *logs.shape[1:])), logs]).reshape(len(along) + 1, -1, 2)
    logs[1:] += noise_sd * rng.normal(size=logs[1:].shape)
    logs[1:, :, 1] *= 1 + cell_sd * rng.normal(size=logs.shape[1])
    n, k = logs.shape[:2]
    row, col = (index.ravel() for index in np.indices(BLOCK))
    unknown = np.full(n, np.nan)
    force = np.concatenate([[0.0], force_n]) * (1 + 1e-3 * rng.normal(size=n))
    return TensileTest(
        frame=tuple(f"{i:03d}" for i in range(n)),
        time_s=unknown,
        displacement_mm=TRAVEL_MM[:n] if loads else unknown,
        force_n=force if loads else unknown,
        cell=tuple(f"r{r}c{c}" for r, c in zip(row, col, strict=True)),
        row=row,
        col=col,
        longitudinal_stretch=np.exp(logs[..., 0]),
        lateral_stretch=np.exp(logs[..., 1]),
        status=np.full((n, k), "ok"),
        stretch_sd=np.full((n, k, 2), noise_sd),
        block_stretch=np.exp(logs.mean(axis=1)),
        corner_px=np.full((n, BLOCK[0] + 1, BLOCK[1] + 1, 2), np.nan),
        strain_sd=noise_sd,
        scale_mm_per_px=None,
        marker="speckle",
        notes=(),
        warnings=(),
        record={},
    )


def without_cell(test: TensileTest, frame: int, cell: int) -> TensileTest:
    along, across = test.longitudinal_stretch.copy(), test.lateral_stretch.copy()
    along[frame, cell] = across[frame, cell] = np.nan
    return replace(test, longitudinal_stretch=along, lateral_stretch=across)
