"""The split of a mismatch: each pure case is found, and costs what it costs."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import LINEAR_ALGEBRA

from kiribench.conformability.causes import costs, fit_affine, main_cause, parts_alone
from kiribench.conformability.overlap import overlaps
from kiribench.conformability.result import CAUSES
from kiribench.strain.gradient import triangular

SIDE = 15.0
CELL = 0.5 * SIDE * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
TURN = np.deg2rad(10.0)
ROTATION = np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])
HOURGLASS = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])


def outline(corners: np.ndarray, pieces: int = 4) -> np.ndarray:
    after = np.roll(corners, -1, axis=0)
    w = np.arange(pieces) / pieces
    return np.concatenate([a + w[:, None] * (b - a) for a, b in zip(corners, after, strict=True)])


def turned_square_overlap(turn: float) -> float:
    """Area of a unit square and its turned copy: an octagon, the square less 4 corners.

    The turned square leaves a right triangle in each corner, with legs in the ratio
    sin : cos and hypotenuse h; the side is h cos + h + h sin = 1 by symmetry.
    """
    sin, cos = np.sin(turn), np.cos(turn)
    hypotenuse = 1.0 / (1.0 + sin + cos)
    return 1.0 - 4.0 * 0.5 * hypotenuse**2 * sin * cos


PURE = {
    "shift": (CELL + np.array([1.5, 0.0]), 0.9),
    "rotation": (CELL @ ROTATION.T, turned_square_overlap(TURN)),
    "longitudinal-stretch": (CELL * [0.8, 1.0], 0.8),
    "lateral-stretch": (CELL * [1.0, 0.7], 0.7),
    # A simple shear g moves the medial side by g / 2 distally, the lateral side back: two
    # triangles of legs 1/2 and g / 4 ... each of the two sides loses g / 4 in sum g / 4.
    "shear": (CELL @ triangular(1.0, 1.0, 0.4).T, 1.0 - 0.4 / 4.0),
}


@pytest.mark.parametrize("cause", list(PURE))
def test_pure_case_is_all_there_is(cause: str) -> None:
    patch, expected = PURE[cause]
    skin, k = outline(CELL), outline(patch)
    fit = fit_affine(CELL, patch)
    loss = costs(fit, skin, k, "paper")
    at = CAUSES.index(cause)
    assert loss[at] == pytest.approx(1.0 - expected, abs=1e-9)
    assert loss[at] == pytest.approx(1.0 - float(overlaps(skin, k).paper), abs=1e-9)
    others = np.delete(loss, at)
    np.testing.assert_allclose(others, 0.0, atol=1e-9)
    assert main_cause(loss) == cause


def test_hourglass_is_rest() -> None:
    patch = CELL + HOURGLASS
    fit = fit_affine(CELL, patch)
    skin, k = outline(CELL), outline(patch)
    loss = costs(fit, skin, k, "paper")
    assert fit.rest_mm == pytest.approx(1.0, abs=LINEAR_ALGEBRA)
    assert main_cause(loss) == "rest"
    assert loss[-1] == pytest.approx(1.0 - float(overlaps(skin, k).paper), abs=1e-9)
    np.testing.assert_allclose(loss[:-1], 0.0, atol=1e-9)


def test_mixed_case_is_taken_apart_exactly() -> None:
    matrix = ROTATION @ triangular(0.9, 1.1, 0.2)
    patch = CELL @ matrix.T + [0.7, -0.4]
    fit = fit_affine(CELL, patch)
    assert fit.rotation == pytest.approx(TURN, abs=LINEAR_ALGEBRA)
    assert fit.longitudinal == pytest.approx(0.9, abs=LINEAR_ALGEBRA)
    assert fit.lateral == pytest.approx(1.1, abs=LINEAR_ALGEBRA)
    assert fit.shear == pytest.approx(0.2, abs=LINEAR_ALGEBRA)
    assert fit.rest_mm == pytest.approx(0.0, abs=LINEAR_ALGEBRA)
    np.testing.assert_allclose(fit.shift, [0.7, -0.4], atol=LINEAR_ALGEBRA)


def test_the_parts_together_are_the_whole() -> None:
    rng = np.random.default_rng(4)
    skin_corners, patch_corners = (CELL + rng.normal(size=(4, 2)) for _ in range(2))
    skin, patch = outline(skin_corners), outline(patch_corners)
    fit = fit_affine(skin_corners, patch_corners)
    alone = parts_alone(fit, skin, patch)
    about = skin - fit.centre
    cos, sin = np.cos(fit.rotation), np.sin(fit.rotation)
    turn = np.array([[cos, -sin], [sin, cos]])
    affine = turn @ triangular(fit.longitudinal, fit.lateral, fit.shear)
    together = fit.centre + (alone[0] - skin) + about @ affine.T + (alone[5] - skin)
    np.testing.assert_allclose(together, patch, atol=1e-9)


def test_oversize_costs_nothing_by_the_papers_definition_but_by_the_others() -> None:
    patch = CELL * [1.2, 1.0]
    fit = fit_affine(CELL, patch)
    at = CAUSES.index("longitudinal-stretch")
    skin, k = outline(CELL), outline(patch)
    assert costs(fit, skin, k, "paper")[at] == pytest.approx(0.0, abs=1e-9)
    assert costs(fit, skin, k, "strict")[at] == pytest.approx(1.0 - 1.0 / 1.2, abs=1e-9)
    assert costs(fit, skin, k, "iou")[at] == pytest.approx(1.0 - 1.0 / 1.2, abs=1e-9)


def test_a_perfect_fit_has_no_main_cause() -> None:
    skin = outline(CELL)
    assert main_cause(costs(fit_affine(CELL, CELL), skin, skin, "iou")) == "none"
