"""The equations of a sheet whose facets repeat, with the inside of every facet eliminated.

Facets meet in their ligaments only. So the exact tangent is factorised facet by facet: inner
and cut-face nodes are eliminated by a sparse L D L^T whose pattern is that of the template, for
a batch of facets at once, and what is left is one sparse matrix on the nodes of the ligaments
for SuperLU. No approximation is made: the solution is that of the assembled matrix.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_array

from kiribench.fem.assembly import Factor, factorise, quadrature
from kiribench.fem.batches import block_energy, linearise_block
from kiribench.fem.elimination import plan_elimination
from kiribench.fem.facet_batch import FacetBatch
from kiribench.fem.material import Material
from kiribench.fem.mesh import FacetBlock, SheetMesh

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class _Block(FacetBatch):
    """One block of facets with its quadrature."""

    def __init__(self, block: FacetBlock) -> None:
        template = block.template
        super().__init__(plan_elimination(template), block.nodes, block.mirrored)
        self.triangles = template.triangles
        part = quadrature(template.points * block.size_mm, template.triangles)
        self.gradients, self.areas = part.gradients, part.areas_mm2


class CondensedSystem:
    """The equations of a sheet, solved by eliminating the inside of every facet.

    Gives the same answers as ``AssembledSystem`` on the same mesh. The condensed matrix is
    symmetric, and positive definite where the equilibrium is stable.

    Args:
        mesh: the sheet.
        equation: (n, 2) equation of each displacement, -1 prescribed; only nodes of ligaments
            may be prescribed, and no two displacements be tied.
        material: the law.
    """

    def __init__(self, mesh: SheetMesh, equation: IntArray, material: Material) -> None:
        self.points_mm = mesh.points_mm
        self.equation = equation
        self.size = int(equation.max()) + 1
        self._law = (material.mu_mpa, float(material.alpha))
        self._blocks = [_Block(block) for block in mesh.blocks]
        kept = np.zeros(len(mesh.points_mm), dtype=bool)
        for block in self._blocks:
            kept[block.nodes[:, block.plan.kept]] = True
        if np.any(equation[~kept] < 0):
            raise ValueError("only nodes of ligaments may be prescribed in a condensed system")
        self._kept_nodes = np.flatnonzero(kept)
        free = equation[self._kept_nodes] >= 0
        self._global = np.full(equation.shape, -1, dtype=np.int64)
        numbers = np.full((len(self._kept_nodes), 2), -1, dtype=np.int64)
        numbers[free] = np.arange(free.sum())
        self._global[self._kept_nodes] = numbers
        self.condensed_size = int(free.sum())
        self._factor: Factor
        self._plan_condensed()
        self.area_mm2 = float(sum(block.count * block.areas.sum() for block in self._blocks))

    def _plan_condensed(self) -> None:
        """Pattern of the condensed matrix, and the place of every facet's entries in it."""
        size = self.condensed_size
        codes = []
        for block in self._blocks:
            rows, columns = block.kept_entries(self._global)
            lower = columns * size + rows
            upper = rows * size + columns
            diagonal = (block.pairs[:, 0] == block.pairs[:, 1])[None, :, None]
            upper = np.where(diagonal, -1, upper)
            both = np.stack([lower, upper], axis=-1)
            both[(rows < 0) | (columns < 0)] = -1
            codes.append(both)
        flat = np.concatenate([code.ravel() for code in codes])
        pattern = np.unique(flat[flat >= 0])
        self._indices = (pattern % size).astype(np.int32)
        self._pointers = np.searchsorted(pattern // size, np.arange(size + 1)).astype(np.int32)
        self._values = np.zeros(len(pattern))
        self._places = []
        for block, code in zip(self._blocks, codes, strict=True):
            place = np.searchsorted(pattern, code).astype(np.int32)
            place[code < 0] = -1
            filled = np.full((len(block.nodes), *place.shape[1:]), -1, dtype=np.int32)
            filled[: block.count] = place
            self._places.append(filled)

    def energy(self, x: FloatArray) -> float:
        """Elastic energy per unit thickness (N) at deformed nodes (n, 2) mm; inf if folded."""
        total = 0.0
        for block in self._blocks:
            total += block_energy(
                x,
                block.nodes,
                block.sign,
                block.count,
                block.triangles,
                block.gradients,
                block.areas,
                *self._law,
            )
        return total

    def _assemble(self, x: FloatArray, with_stiffness: bool, projected: float = 0.0) -> FloatArray:
        force = np.zeros_like(self.points_mm)
        for block, places in zip(self._blocks, self._places, strict=True):
            plan = block.plan
            linearise_block(
                x,
                block.nodes,
                block.sign,
                block.count,
                block.triangles,
                block.gradients,
                block.areas,
                *self._law,
                plan.element,
                plan.start,
                plan.column,
                plan.pivot,
                plan.target_start,
                plan.target,
                block.kept_code,
                places,
                with_stiffness,
                projected,
                force,
                block.store,
                self._values,
            )
        return force

    def forces(self, x: FloatArray) -> FloatArray:
        """(n, 2) internal nodal forces per unit thickness, N/mm."""
        return self._assemble(x, with_stiffness=False)

    def reduce(self, force: FloatArray) -> FloatArray:
        """(size,) residual of the free equations from nodal forces (n, 2)."""
        result = np.zeros(self.size)
        free = self.equation >= 0
        result[self.equation[free]] = force[free]
        return result

    def linearise(self, x: FloatArray, *, projected: float = 0.0) -> FloatArray:
        """Factorise the tangent at x, raised by ``projected``; the residual (size,)."""
        self._values[:] = 0.0
        force = self._assemble(x, True, projected)
        matrix = csc_array(
            (self._values, self._indices, self._pointers),
            shape=(self.condensed_size, self.condensed_size),
        )
        self._factor = factorise(matrix)
        return self.reduce(force)

    def solve(self, residual: FloatArray) -> FloatArray:
        """(size,) solution with the last factorised tangent."""
        nodal = np.where(self.equation >= 0, residual[self.equation], 0.0)
        condensed = np.zeros_like(nodal)
        condensed[self._kept_nodes] = nodal[self._kept_nodes]
        for block in self._blocks:
            block.reduce(nodal, condensed)
        free = self._global >= 0
        right = np.zeros(self.condensed_size)
        right[self._global[free]] = condensed[free]
        answer = self._factor.solve(right)
        solution = np.where(free, answer[self._global], 0.0)
        for block in self._blocks:
            block.expand(solution)
        return self.reduce(solution)

    def negative_modes(self) -> int:
        """Negative eigenvalues of the last factorised tangent, by Sylvester's law of inertia."""
        inner = sum(block.negative_pivots() for block in self._blocks)
        return inner + self._factor.negative_pivots()
