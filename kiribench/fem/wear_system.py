"""The equations of a patch on a surface: facets condensed to their ligaments, then a band.

Facets meet in their ligaments only, and all have the same mesh topology: the inside of each is
eliminated in batches (:mod:`kiribench.fem.batches`), and what is left on the ligaments is a band
matrix for LAPACK's Cholesky factorisation. No approximation is made. A tangent that is not
positive definite shows itself there, and is made so (``projected``) away from equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from kiribench.fem.batches import LANES
from kiribench.fem.facet_batch import FacetBatch
from kiribench.fem.surface_map import SurfaceJet, SurfaceMap
from kiribench.fem.wear_kernels import membrane_block, membrane_energy
from kiribench.fem.wear_mesh import PatchMesh, facet_plan

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


def lanes_last(values: FloatArray, fill: IntArray) -> FloatArray:
    """Facet-wise values (f, ...) as batches (B, ..., LANES); ``fill`` (B L,) picks the facets."""
    batched = values[fill].reshape(-1, LANES, *values.shape[1:])
    return np.ascontiguousarray(np.moveaxis(batched, 1, -1))


class FacetGroup(FacetBatch):
    """Facets of a patch with one elimination plan.

    Attributes:
        facets: (f,) which they are. chosen: (B L,) which lies in each lane.
        gradients, areas: of the mesh, in batches. diagonal: (n,) block of each node.
        kept_place: (f, p, 4) place of the kept entries in the band.
    """

    def __init__(
        self, mesh: PatchMesh, facets: IntArray, gradients: FloatArray, areas: FloatArray
    ) -> None:
        template = mesh.template
        one = mesh.full[facets[0]].tolist()
        plan = facet_plan(template.intervals, template.order, (one[0], one[1], one[2], one[3]))
        super().__init__(plan, mesh.nodes[facets])
        self.facets = facets
        self.chosen = facets[self.fill]
        self.gradients = lanes_last(gradients, self.chosen)
        self.areas = lanes_last(areas, self.chosen)
        corners = np.arange(template.elements.shape[1])
        self.diagonal = np.empty(len(template.spread), dtype=np.int64)
        self.diagonal[template.elements] = plan.element[:, corners, corners]
        self.kept_place = np.empty((0, 0, 4), dtype=np.int64)


class WearSystem:
    """Residual and tangent of a patch on a surface, in the skin's material coordinates.

    Args:
        mesh: the patch.
        surface: the skin.
        fixed: (U, 2) coordinates that are held; only of nodes that the elimination keeps.
        mu_mpa: shear modulus.
    """

    def __init__(
        self, mesh: PatchMesh, surface: SurfaceMap, fixed: BoolArray, mu_mpa: float
    ) -> None:
        self.mesh = mesh
        self.surface = surface
        self.fixed = fixed
        self.mu_mpa = float(mu_mpa)
        gradients, areas = mesh.gradients()
        patterns, which = np.unique(mesh.full, axis=0, return_inverse=True)
        self.groups = [
            FacetGroup(mesh, np.flatnonzero(which.ravel() == k), gradients, areas)
            for k in range(len(patterns))
        ]
        self.share = 1.0 / np.bincount(mesh.nodes.ravel())
        kept = np.zeros(len(mesh.points_mm), dtype=bool)
        for group in self.groups:
            kept[group.nodes[:, group.plan.kept]] = True
        if np.any(fixed[~kept]):
            raise ValueError("only nodes on kept edges can be held")
        self._number_band(kept)
        self._factor: FloatArray | None = None

    def _number_band(self, kept: BoolArray) -> None:
        """Order the kept unknowns along the patch, and place every facet's entries."""
        nodes = np.flatnonzero(kept)
        points = self.mesh.points_mm[nodes]
        long = 1 if self.mesh.shape[0] >= self.mesh.shape[1] else 0
        nodes = nodes[np.lexsort((points[:, 1 - long], np.round(points[:, long], 9)))]
        self.kept_nodes = nodes
        free = ~self.fixed[nodes]
        self.equation = np.full(self.fixed.shape, -1, dtype=np.int64)
        numbers = np.full(free.shape, -1, dtype=np.int64)
        numbers[free] = np.arange(free.sum())
        self.equation[nodes] = numbers
        self.size = int(free.sum())
        width = 0
        for group in self.groups:
            equations = self.equation[group.nodes[:, group.plan.kept]].reshape(len(group.nodes), -1)
            low = np.where(equations >= 0, equations, self.size).min(axis=1)
            width = max(width, int((equations.max(axis=1) - low).max()))
        self.width = width
        for group in self.groups:
            rows, columns = group.kept_entries(self.equation)
            high, low = np.maximum(rows, columns), np.minimum(rows, columns)
            place = low * (width + 1) + high - low
            place[low < 0] = -1
            place[:, group.pairs[:, 0] == group.pairs[:, 1], 1] = -1
            group.kept_place = place
        self._band = np.zeros((self.size, width + 1))

    def jet(self, q: FloatArray) -> SurfaceJet:
        """The surface at all nodes, q (U, 2)."""
        return self.surface.at(q)

    def energy(self, q: FloatArray) -> float:
        """Elastic energy per thickness, N; inf where an element is folded."""
        x = self.surface.at(q).x
        total = 0.0
        for group in self.groups:
            total += membrane_energy(
                q,
                x,
                group.nodes,
                group.count,
                self.mesh.template.elements,
                group.gradients,
                group.areas,
                self.mu_mpa,
            )
            if total == np.inf:
                break
        return total

    def _assemble(
        self, jet: SurfaceJet, extra: FloatArray, with_stiffness: bool, projected: bool
    ) -> FloatArray:
        force = np.zeros_like(jet.x)
        flat = self._band.reshape(-1)
        for group in self.groups:
            plan = group.plan
            membrane_block(
                jet.x,
                jet.first,
                jet.second,
                group.nodes,
                group.count,
                self.mesh.template.elements,
                group.gradients,
                group.areas,
                self.mu_mpa,
                plan.element,
                group.diagonal,
                extra,
                self.share,
                plan.start,
                plan.column,
                plan.pivot,
                plan.target_start,
                plan.target,
                group.kept_code,
                group.kept_place,
                with_stiffness,
                projected,
                force,
                group.store,
                flat,
            )
        return force

    def forces(self, jet: SurfaceJet) -> FloatArray:
        """(U, 3) gradient of the energy by the places of the nodes, N/mm per mm thickness."""
        return self._assemble(jet, np.empty((0, 4)), False, False)

    def residual(self, jet: SurfaceJet, force: FloatArray) -> FloatArray:
        """(U, 2) J'f, 0 where held."""
        return np.asarray(np.where(self.fixed, 0.0, np.einsum("nad,nd->na", jet.first, force)))

    def linearise(
        self, jet: SurfaceJet, *, extra: FloatArray | None = None, projected: bool = False
    ) -> tuple[FloatArray, bool]:
        """Forces (U, 3), and whether the tangent is positive definite and now factorised."""
        self._band[:] = 0.0
        force = self._assemble(jet, np.empty((0, 4)) if extra is None else extra, True, projected)
        try:
            self._factor = cholesky_banded(
                self._band.T, overwrite_ab=False, lower=True, check_finite=False
            )
        except LinAlgError:
            self._factor = None
        definite = self._factor is not None and bool(np.isfinite(self._factor[0]).all())
        # What was eliminated counts as well (Haynsworth 1968): the condensed matrix alone can be
        # positive definite where the tangent is not. A projected one has no negative part.
        definite = definite and (
            projected or not any(group.negative_pivots() for group in self.groups)
        )
        return force, definite

    def solve_kept(self, right: FloatArray) -> FloatArray:
        """Solution of the condensed equations for right sides (size,) or (size, k)."""
        if self._factor is None:
            raise ValueError("no factorised tangent")
        return np.asarray(cho_solve_banded((self._factor, True), right, check_finite=False))

    def solve(self, residual: FloatArray) -> FloatArray:
        """(U, 2) solution with the last factorised tangent; 0 where held."""
        condensed = np.zeros_like(residual)
        condensed[self.kept_nodes] = residual[self.kept_nodes]
        for group in self.groups:
            group.reduce(residual, condensed)
        free = self.equation >= 0
        right = np.zeros(self.size)
        right[self.equation[free]] = condensed[free]
        answer = self.solve_kept(right)
        solution = np.where(free, answer[self.equation], 0.0)
        for group in self.groups:
            group.expand(solution)
        return solution


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The end of Newton's method: nodes q (U, 2), forces (U, 3), or why there is none."""

    q: FloatArray
    force: FloatArray
    iterations: int
    energy: float
    reason: str | None


_MOST_ITERATIONS = 60
_RESIDUAL = 1e-10
"""Largest residual / (mu * cell edge): forces far below any that could move a node by 1e-6 mm."""
_SMALLEST_STEP = 1.0 / 4096
_SHORTER_STEPS = (0.5, 0.25)
"""Parts of Newton's step with which it begins again where it got stuck."""
_NEAR_END = 1e-4
"""A step that promises less of the energy is Newton's own: it converges quadratically."""
_STUCK = "no step lowers the energy"


class Potential(Protocol):
    """Another potential of the nodes' q (U, 2), such as friction."""

    def energy(self, q: FloatArray) -> float:
        """Per thickness, N."""

    def gradient(self, q: FloatArray) -> FloatArray:
        """(U, 2) its derivative."""

    def stiffness(self, q: FloatArray) -> FloatArray:
        """(U, 4) second derivatives, row by row, not negative."""


def relax(system: WearSystem, start: FloatArray, other: Potential | None = None) -> Equilibrium:
    """Minimise the energy from q (U, 2) by Newton's method with an energy line search.

    Where the tangent is not positive definite its negative parts are raised to zero, element
    by element, so that every step goes downhill. A full step can leave an element all but
    folded, from where no step leads on: then it begins again with steps of a part of Newton's.
    """
    found = _descend(system, start, other, 1.0)
    for longest in _SHORTER_STEPS:
        if found.reason is None or not found.reason.startswith(_STUCK):
            break
        again = _descend(system, start, other, longest)
        found = replace(again, iterations=found.iterations + again.iterations)
    return found


def _descend(
    system: WearSystem, start: FloatArray, other: Potential | None, longest: float
) -> Equilibrium:
    """Newton's method of which no step is longer than a part of Newton's, but near the end."""

    def total(q: FloatArray) -> float:
        elastic = system.energy(q)
        return elastic if other is None or elastic == np.inf else elastic + other.energy(q)

    q = start
    energy = total(q)
    tolerance = _RESIDUAL * system.mu_mpa * system.mesh.cut_map.cell_mm
    # Close to equilibrium rounding decides the energy: such steps are taken.
    noise = 1e-14 * (abs(energy) + system.mu_mpa * float(np.prod(system.mesh.cut_map.size_mm)))
    force = np.zeros((len(q), 3))
    reason = f"no equilibrium after {_MOST_ITERATIONS} iterations"
    if energy == np.inf:
        return Equilibrium(q, force, 0, energy, "the patch is folded where it starts")
    iteration = 0
    for iteration in range(_MOST_ITERATIONS + 1):
        jet = system.jet(q)
        extra = None if other is None else other.stiffness(q)
        force, definite = system.linearise(jet, extra=extra)
        residual = system.residual(jet, force)
        if other is not None:
            residual += np.where(system.fixed, 0.0, other.gradient(q))
        worst = float(np.abs(residual).max())
        if worst <= tolerance and definite:
            return Equilibrium(q, force, iteration, energy, None)
        if not definite:
            force, definite = system.linearise(jet, extra=extra, projected=True)
            if not definite:
                reason = "the tangent is singular: a part of the patch is loose"
                break
            if worst <= tolerance:
                reason = "the patch stands, but not stably: its tangent is not positive definite"
                break
        if iteration == _MOST_ITERATIONS:
            break
        step = -system.solve(residual)
        slope = float(np.sum(residual * step))
        # Near the end, where a full step promises little, it is Newton's own again.
        size = 1.0 if -slope < _NEAR_END * abs(energy) else longest
        trial = total(q + size * step)
        while not trial <= energy + 1e-4 * size * slope + noise:
            size *= 0.5
            if size < _SMALLEST_STEP:
                break
            trial = total(q + size * step)
        if size < _SMALLEST_STEP:
            reason = (
                f"{_STUCK}; the largest residual is {worst / tolerance:.1e} times the tolerance"
            )
            break
        q, energy = q + size * step, trial
    return Equilibrium(q, force, iteration, energy, reason)
