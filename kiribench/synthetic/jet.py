"""Second-order Taylor arithmetic in two variables: exact derivatives of closed forms.

A jet carries a function's value and its derivatives up to second order with respect to
(u, v) through sums, products and elementary functions by the chain rule, so that the
derivatives of a surface are as exact as its formula (forward automatic differentiation;
Griewank and Walther, Evaluating Derivatives, 2008, chapter 13).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Jet:
    """A function of (u, v) with derivatives, at many points at once.

    Attributes:
        c: (6, ...) float64: f, f_u, f_v, f_uu, f_uv, f_vv; or (3, ...), first order only.
    """

    c: FloatArray

    # numpy must leave ``array * jet`` to Jet.__rmul__.
    __array_ufunc__ = None

    @classmethod
    def variables(cls, q: FloatArray, order: int = 2) -> tuple[Jet, Jet]:
        """The independent variables at the points q.

        Args:
            q: (..., 2) points (u, v).
            order: 1 or 2, the highest derivative that is carried.
        """
        size = {1: 3, 2: 6}[order]
        u = np.zeros((size, *q.shape[:-1]))
        v = np.zeros_like(u)
        u[0], u[1] = q[..., 0], 1.0
        v[0], v[2] = q[..., 1], 1.0
        return cls(u), cls(v)

    @property
    def value(self) -> FloatArray:
        """(...) the function's values."""
        return np.asarray(self.c[0])

    def _shift(self, constant: float) -> Jet:
        out = self.c.copy()
        out[0] += constant
        return Jet(out)

    def __add__(self, other: Jet | float) -> Jet:
        return Jet(self.c + other.c) if isinstance(other, Jet) else self._shift(other)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.c)

    def __sub__(self, other: Jet | float) -> Jet:
        return Jet(self.c - other.c) if isinstance(other, Jet) else self._shift(-other)

    def __rsub__(self, other: float) -> Jet:
        return (-self)._shift(other)

    def __mul__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.c * other)
        a, b = self.c, other.c
        out = a[0] * b
        out += a * b[0]
        out[0] *= 0.5
        if len(out) == 6:
            out[3] += 2.0 * a[1] * b[1]
            out[4] += a[1] * b[2] + a[2] * b[1]
            out[5] += 2.0 * a[2] * b[2]
        return Jet(out)

    __rmul__ = __mul__

    def __truediv__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.c / other)
        return self * other.reciprocal()

    def __rtruediv__(self, other: float) -> Jet:
        return self.reciprocal() * other

    def _chain(self, f: FloatArray, f1: FloatArray, f2: FloatArray) -> Jet:
        """f(self), given f, f' and f'' at self's values."""
        a = self.c
        out = f1 * a
        out[0] = f
        if len(out) == 6:
            out[3] += f2 * a[1] * a[1]
            out[4] += f2 * a[1] * a[2]
            out[5] += f2 * a[2] * a[2]
        return Jet(out)

    def reciprocal(self) -> Jet:
        """1 / self."""
        r = 1.0 / self.c[0]
        return self._chain(r, -r * r, 2.0 * r**3)

    def sqrt(self) -> Jet:
        """The square root, for positive values."""
        r = np.sqrt(self.c[0])
        return self._chain(r, 0.5 / r, -0.25 / r**3)

    def exp(self) -> Jet:
        """The exponential."""
        e = np.exp(self.c[0])
        return self._chain(e, e, e)

    def tanh(self) -> Jet:
        """The hyperbolic tangent."""
        t = np.tanh(self.c[0])
        slope = 1.0 - t * t
        return self._chain(t, slope, -2.0 * t * slope)

    def sin(self) -> Jet:
        """The sine of radians."""
        s, c = np.sin(self.c[0]), np.cos(self.c[0])
        return self._chain(s, c, -s)

    def cos(self) -> Jet:
        """The cosine of radians."""
        s, c = np.sin(self.c[0]), np.cos(self.c[0])
        return self._chain(c, -s, -c)

    def arctan(self) -> Jet:
        """The arc tangent, in radians."""
        x = self.c[0]
        slope = 1.0 / (1.0 + x * x)
        return self._chain(np.arctan(x), slope, -2.0 * x * slope * slope)

    def erf(self) -> Jet:
        """The error function."""
        x = self.c[0]
        slope = 2.0 / np.sqrt(np.pi) * np.exp(-x * x)
        return self._chain(np.asarray(erf(x)), slope, -2.0 * x * slope)


def gauss(x: Jet, y: Jet, centre: tuple[float, float], width: tuple[float, float]) -> Jet:
    """exp(-((x - x0)/wx)^2 / 2 - ((y - y0)/wy)^2 / 2)."""
    a = (x - centre[0]) / width[0]
    b = (y - centre[1]) / width[1]
    return (-0.5 * (a * a + b * b)).exp()
