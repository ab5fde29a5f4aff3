"""Maps from skin material coordinates to space: where a point of the skin is in a pose.

Material coordinates q = (u, v), mm on the flat drawn grid: u across from the lateral edge, v
along from the proximal edge; node (r, c) of the grid is q = (c pitch, r pitch). A map gives the
place X(q) with its first and second derivatives; everything that a membrane on the skin needs
(metric, normal, curvature) follows from these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from kiribench.errors import NodesError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceJet:
    """A surface map at n points.

    Attributes:
        x: (n, 3) place, mm.
        first: (n, 2, 3) derivatives by u and v.
        second: (n, 3, 3) derivatives by uu, uv, vv, 1/mm.
    """

    x: FloatArray
    first: FloatArray
    second: FloatArray

    @property
    def metric(self) -> FloatArray:
        """(n, 2, 2) metric: squared length on the surface per squared length in q."""
        return np.asarray(np.einsum("nia,nja->nij", self.first, self.first))

    def normal(self, outward: float) -> FloatArray:
        """(n, 3) unit normal, to the side that ``outward`` (+1 or -1) says; see SurfaceMap."""
        cross = np.cross(self.first[:, 0], self.first[:, 1])
        return np.asarray(outward * cross / np.linalg.norm(cross, axis=1, keepdims=True))

    @property
    def gauss_curvature(self) -> FloatArray:
        """(n,) Gauss curvature, 1/mm^2."""
        normal = self.normal(1.0)
        uu, uv, vv = (np.einsum("na,na->n", self.second[:, k], normal) for k in range(3))
        return np.asarray((uu * vv - uv * uv) / np.linalg.det(self.metric))


class SurfaceMap(Protocol):
    """A twice continuously differentiable map from skin material coordinates to space."""

    @property
    def outward(self) -> float:
        """+1 where X_u x X_v points away from the body, -1 where into it."""

    def at(self, q: FloatArray) -> SurfaceJet:
        """The map at points q (n, 2) mm."""


def _jet(x: FloatArray, first: FloatArray, second: FloatArray) -> SurfaceJet:
    return SurfaceJet(
        np.ascontiguousarray(x), np.ascontiguousarray(first), np.ascontiguousarray(second)
    )


@dataclass(frozen=True)
class Plane:
    """A stretched plane: x = (lateral u, longitudinal v, 0).

    Attributes:
        lateral, longitudinal: the stretches of the skin.
        shear: of the v axis towards u: x gains ``shear * v``.
    """

    lateral: float = 1.0
    longitudinal: float = 1.0
    shear: float = 0.0

    @property
    def outward(self) -> float:
        """+1: up."""
        return 1.0

    def at(self, q: FloatArray) -> SurfaceJet:
        """The map at points q (n, 2) mm."""
        count = len(q)
        zero = np.zeros(count)
        x = np.column_stack(
            [self.lateral * q[:, 0] + self.shear * q[:, 1], self.longitudinal * q[:, 1], zero]
        )
        first = np.zeros((count, 2, 3))
        first[:, 0, 0] = self.lateral
        first[:, 1, 0], first[:, 1, 1] = self.shear, self.longitudinal
        return _jet(x, first, np.zeros((count, 3, 3)))


@dataclass(frozen=True)
class Cylinder:
    """A plane rolled about the y axis, without any strain but the two stretches.

    Attributes:
        radius_mm: of the cylinder.
        lateral, longitudinal: stretches of the skin around and along it.
    """

    radius_mm: float
    lateral: float = 1.0
    longitudinal: float = 1.0

    @property
    def outward(self) -> float:
        """+1: X_u x X_v points away from the axis."""
        return 1.0

    def at(self, q: FloatArray) -> SurfaceJet:
        """The map at points q (n, 2) mm; u = 0 is the generator x = 0, z = radius."""
        rate = self.lateral / self.radius_mm
        angle = rate * q[:, 0]
        sin, cos = self.radius_mm * np.sin(angle), self.radius_mm * np.cos(angle)
        count = len(q)
        first = np.zeros((count, 2, 3))
        first[:, 0, 0], first[:, 0, 2] = rate * cos, -rate * sin
        first[:, 1, 1] = self.longitudinal
        second = np.zeros((count, 3, 3))
        second[:, 0, 0], second[:, 0, 2] = -rate * rate * sin, -rate * rate * cos
        x = np.column_stack([sin, self.longitudinal * q[:, 1], cos])
        return _jet(x, first, second)


@dataclass(frozen=True, eq=False)
class NodeSpline:
    """The bicubic spline through the nodes of a drawn grid, twice continuously differentiable.

    A tensor product of not-a-knot cubic splines over q. Beyond the grid it goes on as the
    second-order Taylor polynomial of its border (in each direction), which keeps two
    derivatives continuous and does not swing; a patch should stay well within the grid.

    Attributes:
        pitch_mm: of the grid.
        coefficients: (R + 2, C + 2, 4, 4, 3) polynomial pieces, [v piece, u piece, v power, u
            power]; the outer pieces are the continuation.
        outward: +1 where X_u x X_v points away from the nodes' centroid.
    """

    pitch_mm: float
    coefficients: FloatArray
    outward: float

    @classmethod
    def of(cls, xyz_mm: FloatArray, pitch_mm: float) -> NodeSpline:
        """The spline through nodes (R + 1, C + 1, 3) mm, row 0 proximal, column 0 lateral.

        Raises:
            NodesError: fewer than 4 x 4 nodes, or nodes without a place; fill them first
                (:func:`kiribench.fem.wear_skin.fill_nodes`).
        """
        nodes = np.asarray(xyz_mm, dtype=np.float64)
        if nodes.ndim != 3 or nodes.shape[2] != 3 or min(nodes.shape[:2]) < 4:
            raise NodesError(
                "spline-too-small",
                "A bicubic surface needs at least 4 x 4 nodes.",
                remedy="Give the whole grid of the scan, not only the patch's part of it.",
                got=f"{nodes.shape}",
            )
        if not np.isfinite(nodes).all():
            row, column = np.argwhere(~np.isfinite(nodes).all(axis=2))[0]
            raise NodesError(
                "spline-missing-node",
                f"Node (row {row}, column {column}) has no place.",
                remedy="Fill missing nodes from their neighbours (fill_nodes) or digitise them.",
            )
        along = _pieces(nodes.shape[0], pitch_mm)
        across = _pieces(nodes.shape[1], pitch_mm)
        coefficients = np.einsum("ikr,jlc,rcd->ijkld", along, across, nodes, optimize=True)
        middle = nodes.reshape(-1, 3).mean(axis=0)
        u = np.gradient(nodes, axis=1)
        v = np.gradient(nodes, axis=0)
        side = np.einsum("rca,rca->rc", np.cross(u, v), nodes - middle).sum()
        return cls(float(pitch_mm), np.ascontiguousarray(coefficients), 1.0 if side >= 0 else -1.0)

    def at(self, q: FloatArray) -> SurfaceJet:
        """The map at points q (n, 2) mm."""
        count = len(q)
        jet = SurfaceJet(np.empty((count, 3)), np.empty((count, 2, 3)), np.empty((count, 3, 3)))
        points = np.ascontiguousarray(q, dtype=np.float64)
        _evaluate(points, self.coefficients, self.pitch_mm, jet.x, jet.first, jet.second)
        return jet


def _pieces(count: int, pitch: float) -> FloatArray:
    """(count + 1, 4, count) rising powers of each piece, linear in the values at the nodes.

    Pieces 1 to count - 1 start in their left node; piece 0 is expanded about the first node,
    the last one about the last node, without its cubic term.
    """
    from scipy.interpolate import CubicSpline

    knots = pitch * np.arange(count)
    spline = CubicSpline(knots, np.eye(count), bc_type="not-a-knot")
    result = np.zeros((count + 1, 4, count))
    result[1:-1] = np.moveaxis(spline.c[::-1], 1, 0)
    for piece, at in ((0, knots[0]), (-1, knots[-1])):
        result[piece, 0] = spline(at)
        result[piece, 1] = spline(at, 1)
        result[piece, 2] = 0.5 * spline(at, 2)
    return result


@njit(cache=True, error_model="numpy")
def _evaluate(
    q: FloatArray,
    coefficients: FloatArray,
    pitch: float,
    x: FloatArray,
    first: FloatArray,
    second: FloatArray,
) -> None:
    """Value and derivatives of the pieces at q (n, 2)."""
    rows, columns = coefficients.shape[0] - 2, coefficients.shape[1] - 2
    value, slope, bend = np.empty(4), np.empty(4), np.empty(4)
    for n in range(q.shape[0]):
        i = min(max(int(np.floor(q[n, 1] / pitch)), -1), rows)
        j = min(max(int(np.floor(q[n, 0] / pitch)), -1), columns)
        t = q[n, 1] - pitch * max(i, 0)
        s = q[n, 0] - pitch * max(j, 0)
        for d in range(3):
            for k in range(4):
                c = coefficients[i + 1, j + 1, k, :, d]
                value[k] = c[0] + s * (c[1] + s * (c[2] + s * c[3]))
                slope[k] = c[1] + s * (2 * c[2] + 3 * s * c[3])
                bend[k] = 2 * c[2] + 6 * s * c[3]
            x[n, d] = value[0] + t * (value[1] + t * (value[2] + t * value[3]))
            first[n, 0, d] = slope[0] + t * (slope[1] + t * (slope[2] + t * slope[3]))
            first[n, 1, d] = value[1] + t * (2 * value[2] + 3 * t * value[3])
            second[n, 0, d] = bend[0] + t * (bend[1] + t * (bend[2] + t * bend[3]))
            second[n, 1, d] = slope[1] + t * (2 * slope[2] + 3 * t * slope[3])
            second[n, 2, d] = 2 * value[2] + 6 * t * value[3]
