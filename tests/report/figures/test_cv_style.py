"""Logarithmic axes of the figures of a cross-validation have numbers, not formulas."""

from __future__ import annotations

import re

import numpy as np

from kiribench.report.figures.cv_learning import learning_figure
from kiribench.report.figures.cv_residuals import _bounds, residual_figure
from kiribench.report.figures.cv_style import marks_of
from kiribench.report.figures.cv_time import time_figure


def texts(svg: str) -> set[str]:
    return {
        re.sub(r"<[^>]*>", "", one).strip() for one in re.findall(r"<text[^>]*>.*?</text>", svg)
    }


def test_tick_numbers_are_numbers() -> None:
    curves = {"gp": [(7, 0.2, 0.05), (21, 0.03, 0.01), (60, 0.004, None)]}
    points = {"gp": (0.5, 0.003), "rbf": (0.002, 0.2)}
    marks = marks_of(list(points))
    drawn = [
        learning_figure(curves, marks=marks, groups="designs", unit=0.002, name="x", alt="x"),
        time_figure(points, marks=marks, unit=0.002, name="y", alt="y"),
    ]
    rng = np.random.default_rng(0)
    X = np.column_stack(
        [rng.integers(1, 4, 90) * 30.0, rng.integers(1, 4, 90) * 30.0, rng.random(90)]
    )
    residual = rng.standard_normal(90) * 10.0 ** -(X[:, 0] / 30)
    drawn.append(residual_figure(X, residual, unit=0.002, name="z", alt="z"))
    for svg, expected in zip(drawn, ("20", "0.01", "0.01"), strict=True):
        found = texts(str(svg))
        assert not any("math" in text or "$" in text for text in found), found
        assert expected in found


def test_models_close_to_each_other_have_numbers_beside_them() -> None:
    points = {"gp": (0.231, 0.00475), "gp_kronecker": (0.32, 0.00264)}
    svg = time_figure(points, marks=marks_of(list(points)), unit=None, name="y", alt="y")
    assert {"0.2", "0.5", "0.002", "0.005"} <= texts(str(svg))


def test_a_lattice_of_uneven_levels_is_a_map_without_overlaps() -> None:
    """Tiles meet half-way between the levels; 95 and 99 % stand beside each other."""
    levels = np.array([1.0, 50.0, 95.0, 99.0])
    np.testing.assert_allclose(_bounds(levels), [-23.5, 25.5, 72.5, 97.0, 101.0])
    np.testing.assert_allclose(_bounds(levels[:1]), [0.0, 2.0])


def test_a_model_has_one_mark_in_every_figure() -> None:
    marks = marks_of([f"m{k}" for k in range(56)])
    assert len(set(marks.values())) == 56
