"""A smooth surface given by a closed form: points, normals, metric, Christoffel symbols."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kiribench.synthetic.jet import FloatArray, Jet

Embedding = Callable[[Jet, Jet], tuple[Jet, Jet, Jet]]


@dataclass(frozen=True, eq=False)
class SmoothSurface:
    """A regular parametrised surface X(u, v) in millimetres.

    Attributes:
        embedding: maps the jets of u and v to the jets of x, y and z.
        outward: +1 if X_u x X_v points out of the body, -1 if it points inwards.
    """

    embedding: Embedding
    outward: float = 1.0

    def _jets(self, q: FloatArray, order: int) -> FloatArray:
        x, y, z = self.embedding(*Jet.variables(np.asarray(q, dtype=np.float64), order))
        return np.stack([x.c, y.c, z.c], axis=-1)

    def points_mm(self, q: FloatArray) -> FloatArray:
        """(..., 3) positions of the material points q (..., 2)."""
        return np.asarray(self._jets(q, 1)[0])

    def tangents(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """X_u and X_v, each (..., 3), at q (..., 2)."""
        jets = self._jets(q, 1)
        return jets[1], jets[2]

    def normals(self, q: FloatArray) -> FloatArray:
        """(..., 3) unit normals that point out of the body, at q (..., 2)."""
        x_u, x_v = self.tangents(q)
        normal = np.cross(x_u, x_v) * self.outward
        return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))

    def metric(self, q: FloatArray) -> FloatArray:
        """(..., 2, 2) first fundamental form at q (..., 2)."""
        x = np.stack(self.tangents(q), axis=-2)
        return np.asarray(x @ np.swapaxes(x, -1, -2))

    def area_density(self, q: FloatArray) -> FloatArray:
        """(...) sqrt(det g), mm^2 of surface a unit of du dv, at q (..., 2)."""
        x_u, x_v = self.tangents(q)
        e = np.einsum("...i,...i", x_u, x_u)
        f = np.einsum("...i,...i", x_u, x_v)
        g = np.einsum("...i,...i", x_v, x_v)
        return np.asarray(np.sqrt(e * g - f * f))

    def metric_and_christoffel(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The metric and the Christoffel symbols of the second kind at q (..., 2).

        Gamma^k_ij = g^kl <X_ij, X_l>.

        Returns:
            (..., 2, 2) metric and (..., 2, 2, 2) symbols, indexed k, i, j.
        """
        jets = self._jets(q, 2)
        x = np.stack([jets[1], jets[2]], axis=-2)
        second = np.stack(
            [np.stack([jets[3], jets[4]], -2), np.stack([jets[4], jets[5]], -2)], axis=-3
        )
        g = x @ np.swapaxes(x, -1, -2)
        first_kind = np.einsum("...ijx,...lx->...lij", second, x)
        return g, np.einsum("...kl,...lij->...kij", np.linalg.inv(g), first_kind)
