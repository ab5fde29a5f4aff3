"""Fields of cells from poses: masks, reasons, measures; the rest of the truth is in test_truth."""

from __future__ import annotations

import numpy as np
import pytest
from tolerances import FIRST_ORDER_SD, LINEAR_ALGEBRA

from kiribench.errors import UsageError
from kiribench.strain.export import COLUMNS, strain_object, strain_rows
from kiribench.strain.field import Pose, strain_field
from kiribench.strain.uncertainty import cell_quantities

NODES = 15.0 * np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij"), axis=-1)


def flat_pose(nodes: np.ndarray, name: str = "flex000", sd_mm: float = 0.25) -> Pose:
    """A pose of plane nodes (R+1, C+1, 2) in (distal, medial); NaN is absent."""
    corners = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    return Pose(
        name,
        np.linalg.norm(np.diff(nodes, axis=0), axis=-1),
        np.linalg.norm(np.diff(nodes, axis=1), axis=-1),
        corners - corners.mean(axis=2, keepdims=True),
        np.full(nodes.shape[:2], sd_mm),
    )


def test_edges_alone_misread_a_shear_and_the_gradient_does_not() -> None:
    sheared = NODES @ np.array([[1.0, 0.3], [0.0, 1.0]]).T
    field = strain_field("X", flat_pose(NODES), flat_pose(sheared), strain_measure="engineering")
    np.testing.assert_allclose(field.lateral_strain.value, np.sqrt(1.09) - 1.0, atol=LINEAR_ALGEBRA)
    np.testing.assert_allclose(field.longitudinal_strain.value, 0.0, atol=LINEAR_ALGEBRA)
    np.testing.assert_allclose(field.gradient_lateral_stretch, 1.0, atol=LINEAR_ALGEBRA)
    np.testing.assert_allclose(field.gradient_longitudinal_stretch, 1.0, atol=LINEAR_ALGEBRA)
    np.testing.assert_allclose(field.shear.value, 0.3, atol=LINEAR_ALGEBRA)


@pytest.mark.parametrize(
    ("measure", "ratio"),
    [
        ("engineering", 0.1 / 0.25),
        ("log", -np.log(0.9) / np.log(1.25)),
        ("green", (1.0 - 0.81) / (1.5625 - 1.0)),
    ],
)
def test_poisson_ratio_uses_one_measure_on_both_sides(measure: str, ratio: float) -> None:
    field = strain_field(
        "X", flat_pose(NODES), flat_pose(NODES * [1.25, 0.9]), strain_measure=measure
    )
    np.testing.assert_allclose(field.poisson_ratio.value, ratio, atol=LINEAR_ALGEBRA)
    assert field.strain_measure == measure


def test_small_strain_masks_the_ratio_with_its_reason() -> None:
    field = strain_field("X", flat_pose(NODES), flat_pose(NODES * [1.02, 1.01]), min_strain=0.03)
    assert (field.reason == "").all()
    assert (field.poisson_reason == "strain-too-small").all()
    assert np.isnan(field.poisson_ratio.value).all()
    row = strain_rows(field)[0]
    assert row["poisson_ratio"] is None
    assert row["poisson_reason"] == "strain-too-small"
    assert row["longitudinal_stretch"] == pytest.approx(1.02)


def test_a_ratio_without_a_finite_interval_says_so() -> None:
    # sd of a strain from 0.25 mm nodes: 0.0236; 1.96 sd = 0.046 > 0.04 > min_strain.
    field = strain_field("X", flat_pose(NODES), flat_pose(NODES * [1.04, 0.99]))
    assert (field.poisson_reason == "interval-unbounded").all()
    assert np.isfinite(field.poisson_ratio.value).all()
    assert np.isnan(field.poisson_ratio.low).all()
    better = strain_field(
        "X", flat_pose(NODES, sd_mm=0.1), flat_pose(NODES * [1.04, 0.99], sd_mm=0.1)
    )
    assert (better.poisson_reason == "").all()
    assert np.isfinite(better.poisson_ratio.low).all()


def test_zero_strain_is_masked_even_without_a_limit() -> None:
    field = strain_field("X", flat_pose(NODES), flat_pose(NODES), min_strain=0.0)
    assert (field.poisson_reason == "strain-too-small").all()


def test_a_missing_node_takes_its_four_cells_and_no_other() -> None:
    deformed = NODES * [1.2, 1.1]
    deformed[1, 1] = np.nan
    field = strain_field("X", flat_pose(NODES), flat_pose(deformed, "flex090"))
    expected = [["node-missing"] * 2, ["node-missing"] * 2, ["", ""]]
    assert field.reason.tolist() == expected
    assert field.poisson_reason.tolist() == expected
    assert np.isfinite(field.longitudinal_stretch.value[2]).all()
    assert np.isnan(field.longitudinal_stretch.value[:2]).all()
    summary = strain_object(field)
    assert summary["measured"] == 2
    assert summary["not_measured"] == {"node-missing": 4}


def test_two_swapped_nodes_fold_cells_and_are_named() -> None:
    deformed = NODES.copy()
    deformed[1, 1], deformed[1, 2] = NODES[1, 2].copy(), NODES[1, 1].copy()
    field = strain_field("X", flat_pose(NODES), flat_pose(deformed))
    assert "cell-degenerate" in field.reason
    assert np.isnan(field.longitudinal_stretch.value[field.reason == "cell-degenerate"]).all()


def test_mirroring_swaps_lateral_and_medial_and_nothing_else() -> None:
    rng = np.random.default_rng(2)
    deformed = NODES * [1.2, 1.1] + 0.5 * rng.normal(size=NODES.shape)
    one = strain_field("X", flat_pose(NODES), flat_pose(deformed))
    # The other leg: the same skin seen in a mirror, node columns still from lateral.
    other = strain_field("X", flat_pose(NODES * [1.0, -1.0]), flat_pose(deformed * [1.0, -1.0]))
    np.testing.assert_allclose(other.shear.value, one.shear.value, atol=1e-12)
    np.testing.assert_allclose(other.rotation_deg, one.rotation_deg, atol=1e-10)
    # Columns counted from the wrong side: cells swap places and the shear changes sign.
    swapped = strain_field("X", flat_pose(NODES[:, ::-1]), flat_pose(deformed[:, ::-1]))
    np.testing.assert_allclose(
        swapped.longitudinal_stretch.value[:, ::-1], one.longitudinal_stretch.value, atol=1e-12
    )
    np.testing.assert_allclose(swapped.shear.value[:, ::-1], -one.shear.value, atol=1e-12)


def test_rows_have_the_documented_columns_and_no_nan() -> None:
    deformed = NODES * [1.2, 1.1]
    deformed[0, 0] = np.nan
    rows = strain_rows(strain_field("X", flat_pose(NODES), flat_pose(deformed)))
    assert len(rows) == 6
    for row in rows:
        assert list(row) == list(COLUMNS)
        assert not any(isinstance(value, float) and np.isnan(value) for value in row.values())


def test_unknown_measure_is_refused() -> None:
    with pytest.raises(UsageError):
        strain_field("X", flat_pose(NODES), flat_pose(NODES), strain_measure="true")


def test_the_ratios_uncertainty_agrees_with_monte_carlo() -> None:
    # A lopsided cell: in a parallelogram the errors of the two strains are not correlated.
    rng = np.random.default_rng(8)
    sd_mm, draws = 0.05, 100_000
    nodes = np.array([[[0.0, 0.0], [0.0, 15.0]], [[15.0, 9.0], [12.0, 13.0]]])
    deformed = np.array([[[0.0, 0.0], [1.0, 17.0]], [[20.0, 11.0], [14.0, 15.0]]])
    field = strain_field("X", flat_pose(nodes, sd_mm=sd_mm), flat_pose(deformed, sd_mm=sd_mm))
    order = ([0, 0, 1, 1], [0, 1, 1, 0])
    stretches = cell_quantities(
        nodes[order] + sd_mm * rng.normal(size=(draws, 4, 2)),
        deformed[order] + sd_mm * rng.normal(size=(draws, 4, 2)),
    )
    ratio = -np.log(stretches[:, 1]) / np.log(stretches[:, 0])
    assert float(field.poisson_ratio.sd[0, 0]) == pytest.approx(ratio.std(), rel=FIRST_ORDER_SD)
