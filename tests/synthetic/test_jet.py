"""Jets against differentiation by hand and by central differences."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import DIFFERENCE_QUOTIENT, ROUNDING

from kiribench.synthetic.jet import Jet, gauss

POINTS = np.random.default_rng(1).uniform(0.3, 1.4, (40, 2))


def test_a_polynomial_by_hand() -> None:
    u, v = Jet.variables(POINTS)
    f = 3.0 * u * u * v - v / 2.0 + (1.0 - u) * v * v
    x, y = POINTS.T
    by_hand = [
        3 * x * x * y - y / 2 + (1 - x) * y * y,
        6 * x * y - y * y,
        3 * x * x - 0.5 + 2 * (1 - x) * y,
        6 * y,
        6 * x - 2 * y,
        2 * (1 - x),
    ]
    np.testing.assert_allclose(f.c, by_hand, atol=ROUNDING)


FUNCTIONS = {
    "reciprocal": lambda u, v: 1.0 / (u + 0.5 * v * v),
    "quotient": lambda u, v: (u * v) / (u + v),
    "sqrt": lambda u, v: (u * v + 1.0).sqrt(),
    "exp": lambda u, v: (u - 0.7 * v * u).exp(),
    "tanh": lambda u, v: (2.0 * u - v).tanh(),
    "sin": lambda u, v: (u * v).sin(),
    "cos": lambda u, v: (u * u - v).cos(),
    "arctan": lambda u, v: (u / v).arctan(),
    "erf": lambda u, v: (u * v - 0.4).erf(),
    "gauss": lambda u, v: gauss(u, v, (0.5, 0.8), (0.6, 0.9)),
    "subtraction": lambda u, v: 2.0 - (-u) * v - 3.0,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_are_difference_quotients(name: str) -> None:
    function, h = FUNCTIONS[name], 1e-4

    def value(du: float, dv: float) -> np.ndarray:
        return function(*Jet.variables(POINTS + np.array([du, dv]) * h)).value

    centre = value(0, 0)
    expected = [
        centre,
        (value(1, 0) - value(-1, 0)) / (2 * h),
        (value(0, 1) - value(0, -1)) / (2 * h),
        (value(1, 0) - 2 * centre + value(-1, 0)) / h**2,
        (value(1, 1) - value(1, -1) - value(-1, 1) + value(-1, -1)) / (4 * h * h),
        (value(0, 1) - 2 * centre + value(0, -1)) / h**2,
    ]
    jet = function(*Jet.variables(POINTS))
    np.testing.assert_allclose(jet.c, expected, atol=DIFFERENCE_QUOTIENT)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_first_order_jets_are_the_first_part_of_second_order_ones(name: str) -> None:
    first = FUNCTIONS[name](*Jet.variables(POINTS, 1))
    second = FUNCTIONS[name](*Jet.variables(POINTS, 2))
    np.testing.assert_array_equal(first.c, second.c[:3])


def test_a_numpy_number_on_the_left_is_a_scale() -> None:
    u, _ = Jet.variables(POINTS)
    np.testing.assert_array_equal((np.float64(2.0) * u).c, (u + u).c)
