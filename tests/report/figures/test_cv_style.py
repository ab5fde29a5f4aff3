"""Logarithmic axes of the figures of a cross-validation have numbers, not formulas."""

from __future__ import annotations

import re

import numpy as np

from kiribench.report.figures.cv_learning import learning_figure
from kiribench.report.figures.cv_residuals import residual_figure
from kiribench.report.figures.cv_time import time_figure


def texts(svg: str) -> set[str]:
    return {
        re.sub(r"<[^>]*>", "", one).strip() for one in re.findall(r"<text[^>]*>.*?</text>", svg)
    }


def test_tick_numbers_are_numbers() -> None:
    curves = {"gp": [(7, 0.2, 0.05), (21, 0.03, 0.01), (60, 0.004, None)]}
    drawn = [
        learning_figure(curves, groups="designs", unit=0.002, name="x", alt="x"),
        time_figure({"gp": (0.5, 0.003), "rbf": (0.002, 0.2)}, unit=0.002, name="y", alt="y"),
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
