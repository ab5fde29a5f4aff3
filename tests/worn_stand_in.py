"""A worn model in closed form: corners move linearly, or a little more, with the cuts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kiribench.fem.wear import WearSensitivities, WornPatch
from kiribench.lattice import CutMap

FloatArray = NDArray[np.float64]


def worn_patch(corner_q_mm: FloatArray, *, status: str = "ok") -> WornPatch:
    """A worn patch of which only the corners are known."""
    rows, columns = corner_q_mm.shape[0] - 1, corner_q_mm.shape[1] - 1
    cells = np.ones((rows, columns))
    sites = np.zeros((2 * rows + 1, 2 * columns + 1, 3))
    return WornPatch(
        corner_q_mm=corner_q_mm,
        site_q_mm=sites[..., :2],
        site_mm=sites,
        longitudinal_stretch=cells,
        lateral_stretch=cells,
        shear=0 * cells,
        contact_pressure_mpa=np.zeros((2 * rows, 2 * columns)),
        contact_area_mm2=np.ones((2 * rows, 2 * columns)),
        tip_stress_mpa=np.zeros(0),
        tip_stretch=np.zeros(0),
        facet_overlap_mm=np.zeros((2 * rows, 2 * columns)),
        strap_force_n=0.0,
        energy_mj=0.0,
        newton_iterations=1,
        status=status,
        reason=None if status == "ok" else "the stand-in refuses",
        cpu_seconds=0.0,
    )


@dataclass(eq=False)
class StandIn:
    """q = target + A (p - best) + curvature A (p - best)^2 + mesh / elements.

    Attributes:
        rows, columns: of cells. best: (2 R C,) cuts that put every corner on its node.
        curvature: strength of the quadratic term. mesh_mm: error of a mesh of one element.
        fails_beyond: no equilibrium where any cut differs by more from the start.
        rank: of A; below 2 R C some directions of the cuts move no corner.
    """

    rows: int = 4
    columns: int = 3
    best: FloatArray | None = None
    curvature: float = 0.0
    mesh_mm: float = 0.0
    fails_beyond: float = np.inf
    rank: int | None = None
    seed: int = 3
    calls: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        count = 2 * self.rows * self.columns
        corners = (self.rows + 1) * (self.columns + 1) * 2
        self.matrix = 10.0 * rng.normal(size=(corners, count)) / np.sqrt(count)
        if self.rank is not None:
            left, size, right = np.linalg.svd(self.matrix, full_matrices=False)
            size[self.rank :] = 0.0
            self.matrix = left * size @ right
        if self.best is None:
            self.best = rng.uniform(0.3, 0.7, count)
        steps = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        self.node_q_mm = 15.0 * np.stack(steps, axis=-1).astype(np.float64)
        self.target_q_mm = self.node_q_mm.copy()
        self.weight = np.ones((self.rows + 1, self.columns + 1))
        self.first: FloatArray | None = None

    def corners(self, p: FloatArray, elements: int) -> FloatArray:
        """(R+1, C+1, 2) where the corners lie."""
        off = p - self.best
        moved = self.matrix @ (off + self.curvature * off**2) + self.mesh_mm / elements
        return np.asarray(self.node_q_mm + moved.reshape(self.node_q_mm.shape))

    def worn(self, cut_map: CutMap, elements: int) -> WornPatch:
        """The patch in equilibrium."""
        return self.sensitivities(cut_map, elements).worn

    def sensitivities(self, cut_map: CutMap, elements: int) -> WearSensitivities:
        """The same with its derivatives."""
        self.calls.append(elements)
        p = np.concatenate([cut_map.a.ravel(), cut_map.b.ravel()])
        if self.first is None:
            self.first = p
        failed = bool(np.abs(p - self.first).max() > self.fails_beyond)
        worn = worn_patch(self.corners(p, elements), status="not-converged" if failed else "ok")
        derivative = self.matrix * (1 + 2 * self.curvature * (p - self.best))
        return WearSensitivities(worn, derivative, 0.0)
