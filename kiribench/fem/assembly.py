"""Energy, nodal forces and tangent stiffness of six-node triangles, assembled as one matrix."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from kiribench.fem.material import Material, energy_density, response

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# The six-point rule of degree four (Dunavant, Int. J. Num. Meth. Eng. 21, 1985). The three-point
# rule of degree two costs half, but triangles at a tip then fold between its points at stretches
# of ten and more, which stopped the sheet of 90 % cuts at a strain of .3.
_NEAR, _FAR = 0.445948490915965, 0.091576213509771
POINTS = np.array(
    [
        [_NEAR, _NEAR],
        [1 - 2 * _NEAR, _NEAR],
        [_NEAR, 1 - 2 * _NEAR],
        [_FAR, _FAR],
        [1 - 2 * _FAR, _FAR],
        [_FAR, 1 - 2 * _FAR],
    ]
)
WEIGHTS = np.array([0.223381589678011] * 3 + [0.109951743655322] * 3) / 2


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Shape-function gradients at the integration points of m elements.

    Attributes:
        gradients: (m, q, 6, 2) derivatives by the undeformed x and y, 1/mm.
        areas_mm2: (m, q) undeformed area that belongs to each point, mm^2.
    """

    gradients: FloatArray
    areas_mm2: FloatArray


def quadrature(points_mm: FloatArray, triangles: IntArray) -> Quadrature:
    """Gradients and areas of six-node triangles (m, 6) on nodes (n, 2), either orientation.

    Raises:
        ValueError: an element is folded.
    """
    r, s = POINTS[:, 0], POINTS[:, 1]
    t = 1 - r - s
    zero = np.zeros_like(r)
    by_r = np.stack([1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s], axis=1)
    by_s = np.stack([1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)], axis=1)
    local = np.stack([by_r, by_s], axis=2)
    jacobian = np.einsum("eai,qar->eqir", points_mm[triangles], local)
    determinant = np.linalg.det(jacobian)
    if np.any(determinant.min(axis=1) * determinant.max(axis=1) <= 0):
        raise ValueError("an element of the mesh is folded")
    gradients = np.einsum("qar,eqri->eqai", local, np.linalg.inv(jacobian))
    return Quadrature(np.ascontiguousarray(gradients), np.abs(determinant) * WEIGHTS)


@njit(cache=True, error_model="numpy")
def total_energy(
    x: FloatArray,
    triangles: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    alpha: float,
) -> float:
    """Energy (N, per unit thickness N mm / mm) at deformed nodes x (n, 2); inf if folded."""
    total = 0.0
    for e in range(triangles.shape[0]):
        for q in range(areas.shape[1]):
            a = b = c = d = 0.0
            for i in range(6):
                node = triangles[e, i]
                g0, g1 = gradients[e, q, i, 0], gradients[e, q, i, 1]
                a += x[node, 0] * g0
                b += x[node, 0] * g1
                c += x[node, 1] * g0
                d += x[node, 1] * g1
            total += areas[e, q] * energy_density(a, b, c, d, mu, alpha)
            if not isfinite(total):
                return inf
    return total


@njit(cache=True, error_model="numpy")
def forces_and_stiffness(
    x: FloatArray,
    triangles: IntArray,
    gradients: FloatArray,
    areas: FloatArray,
    mu: float,
    alpha: float,
    place: npt.NDArray[np.int32],
    with_stiffness: bool,
    projected: float,
    force: FloatArray,
    values: FloatArray,
) -> None:
    """Add nodal forces (n, 2) and, by ``place`` (m, 12, 12), stiffness entries ``values`` (z,).

    ``place`` holds -1 where a row or column is prescribed.
    """
    local = np.empty((12, 12))
    out = np.empty(14)
    cofactor = np.empty((6, 2))
    for e in range(triangles.shape[0]):
        if with_stiffness:
            local[:] = 0.0
        for q in range(areas.shape[1]):
            a = b = c = d = 0.0
            for i in range(6):
                node = triangles[e, i]
                g0, g1 = gradients[e, q, i, 0], gradients[e, q, i, 1]
                a += x[node, 0] * g0
                b += x[node, 0] * g1
                c += x[node, 1] * g0
                d += x[node, 1] * g1
            w = areas[e, q]
            if alpha == 2.0 and projected == 0.0:
                # Neo-Hookean, written with c_i = dJ/du_i: the Hessian of J is a cross product.
                det = a * d - b * c
                w *= mu
                j3 = w / (det * det * det)
                j4 = 3.0 * j3 / det
                for i in range(6):
                    node = triangles[e, i]
                    g0, g1 = gradients[e, q, i, 0], gradients[e, q, i, 1]
                    c0, c1 = d * g0 - c * g1, a * g1 - b * g0
                    cofactor[i, 0], cofactor[i, 1] = c0, c1
                    force[node, 0] += w * (a * g0 + b * g1) - j3 * c0
                    force[node, 1] += w * (c * g0 + d * g1) - j3 * c1
                if not with_stiffness:
                    continue
                for i in range(6):
                    g0, g1 = gradients[e, q, i, 0], gradients[e, q, i, 1]
                    c0, c1 = j4 * cofactor[i, 0], j4 * cofactor[i, 1]
                    for j in range(i, 6):
                        h0, h1 = gradients[e, q, j, 0], gradients[e, q, j, 1]
                        dot = w * (g0 * h0 + g1 * h1)
                        cross = j3 * (g0 * h1 - g1 * h0)
                        local[2 * i, 2 * j] += dot + c0 * cofactor[j, 0]
                        local[2 * i, 2 * j + 1] += c0 * cofactor[j, 1] - cross
                        local[2 * i + 1, 2 * j] += c1 * cofactor[j, 0] + cross
                        local[2 * i + 1, 2 * j + 1] += dot + c1 * cofactor[j, 1]
                continue
            response(a, b, c, d, mu, alpha, projected, out)
            for i in range(6):
                node = triangles[e, i]
                g0, g1 = w * gradients[e, q, i, 0], w * gradients[e, q, i, 1]
                force[node, 0] += out[0] * g0 + out[1] * g1
                force[node, 1] += out[2] * g0 + out[3] * g1
                if not with_stiffness:
                    continue
                x0, x1 = out[4] * g0 + out[5] * g1, out[5] * g0 + out[8] * g1
                x2, x3 = out[6] * g0 + out[9] * g1, out[7] * g0 + out[10] * g1
                y0, y1 = out[6] * g0 + out[7] * g1, out[9] * g0 + out[10] * g1
                y2, y3 = out[11] * g0 + out[12] * g1, out[12] * g0 + out[13] * g1
                for j in range(i, 6):
                    h0, h1 = gradients[e, q, j, 0], gradients[e, q, j, 1]
                    local[2 * i, 2 * j] += x0 * h0 + x1 * h1
                    local[2 * i, 2 * j + 1] += x2 * h0 + x3 * h1
                    local[2 * i + 1, 2 * j] += y0 * h0 + y1 * h1
                    local[2 * i + 1, 2 * j + 1] += y2 * h0 + y3 * h1
        if not with_stiffness:
            continue
        for i in range(12):
            for j in range(2 * (i // 2), 12):
                at = place[e, i, j]
                if at >= 0:
                    values[at] += local[i, j]
                if j // 2 > i // 2:
                    at = place[e, j, i]
                    if at >= 0:
                        values[at] += local[i, j]


@dataclass(frozen=True, eq=False)
class Factor:
    """A factorised symmetric matrix.

    Attributes:
        lu: SuperLU's factors; None where the matrix has no inverse.
    """

    lu: SuperLU | None

    def solve(self, right: FloatArray) -> FloatArray:
        """The solution of the linear equations; NaN where there is none."""
        return np.full(len(right), np.nan) if self.lu is None else self.lu.solve(right)

    def negative_pivots(self) -> int:
        """How many eigenvalues are negative (Sylvester), one where that is not known.

        SuperLU exchanges rows only where a pivot is zero.
        """
        if self.lu is None or not np.array_equal(self.lu.perm_r, self.lu.perm_c):
            return 1
        return int(np.count_nonzero(self.lu.U.diagonal() < 0))


def factorise(matrix: csc_array) -> Factor:
    """SuperLU in its symmetric mode."""
    if not np.isfinite(matrix.data).all():
        return Factor(None)
    try:
        lu = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # SuperLU's "Factor is exactly singular"
        return Factor(None)
    return Factor(lu)


class AssembledSystem:
    """The equations of a mesh as one sparse matrix, factorised by SuperLU.

    Args:
        points_mm: (n, 2) nodes at rest.
        triangles: (m, 6) elements.
        equation: (n, 2) equation of each displacement; the same number twice ties two, -1 is
            prescribed.
        material: the law.
    """

    def __init__(
        self, points_mm: FloatArray, triangles: IntArray, equation: IntArray, material: Material
    ) -> None:
        self.points_mm = points_mm
        self.triangles = triangles
        self.equation = equation
        self.size = int(equation.max()) + 1
        self._law = (material.mu_mpa, float(material.alpha))
        self._quadrature = quadrature(points_mm, triangles)
        rows = equation[triangles].reshape(len(triangles), 12)
        one = np.repeat(rows[:, :, None], 12, axis=2)
        two = np.repeat(rows[:, None, :], 12, axis=1)
        kept = (one >= 0) & (two >= 0)
        code, position = np.unique(two[kept] * self.size + one[kept], return_inverse=True)
        self._place = np.full(kept.shape, -1, dtype=np.int32)
        self._place[kept] = position
        self._indices = (code % self.size).astype(np.int32)
        self._pointers = np.searchsorted(code // self.size, np.arange(self.size + 1)).astype(
            np.int32
        )
        self._factor: Factor
        self.area_mm2 = float(self._quadrature.areas_mm2.sum())

    def energy(self, x: FloatArray) -> float:
        """Elastic energy per unit thickness (N) at deformed nodes (n, 2) mm; inf if folded."""
        part = self._quadrature
        return float(total_energy(x, self.triangles, part.gradients, part.areas_mm2, *self._law))

    def _assemble(self, x: FloatArray, values: FloatArray, projected: float = 0.0) -> FloatArray:
        """Nodal forces (n, 2); adds the stiffness to ``values`` unless these are empty."""
        force = np.zeros_like(self.points_mm)
        part = self._quadrature
        forces_and_stiffness(
            x,
            self.triangles,
            part.gradients,
            part.areas_mm2,
            *self._law,
            self._place,
            len(values) > 0,
            projected,
            force,
            values,
        )
        return force

    def _matrix(self, values: FloatArray) -> csc_array:
        return csc_array((values, self._indices, self._pointers), shape=(self.size, self.size))

    def forces(self, x: FloatArray) -> FloatArray:
        """(n, 2) internal nodal forces per unit thickness, N/mm."""
        return self._assemble(x, np.empty(0))

    def reduce(self, force: FloatArray) -> FloatArray:
        """(size,) residual of the free equations from nodal forces (n, 2)."""
        free = self.equation >= 0
        total = np.bincount(self.equation[free], force[free], minlength=self.size)
        return total.astype(np.float64)

    def assemble(self, x: FloatArray) -> tuple[FloatArray, csc_array]:
        """Nodal forces (n, 2) N/mm and tangent stiffness (size, size) N/mm per mm, in one pass."""
        values = np.zeros(len(self._indices))
        return self._assemble(x, values), self._matrix(values)

    def stiffness(self, x: FloatArray) -> csc_array:
        """(size, size) tangent stiffness of the free equations, N/mm per mm."""
        return self.assemble(x)[1]

    def linearise(self, x: FloatArray, *, projected: float = 0.0) -> FloatArray:
        """Factorise the tangent at x, raised by ``projected``; the residual (size,)."""
        values = np.zeros(len(self._indices))
        force = self._assemble(x, values, projected)
        self._factor = factorise(self._matrix(values))
        return self.reduce(force)

    def solve(self, residual: FloatArray) -> FloatArray:
        """(size,) solution with the last factorised tangent."""
        return np.asarray(self._factor.solve(residual))

    def negative_modes(self) -> int:
        """Negative eigenvalues of the last factorised tangent."""
        return self._factor.negative_pivots()
