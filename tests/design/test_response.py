"""The surrogate at fixed strain: the model's own mean, with derivatives that are right."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from design_toys import surrogates
from tolerances import AUTOGRAD, DIFFERENCE_SLOPE

from kiribench.design.coordinates import Coordinates, warp_jet
from kiribench.design.correlations import FAMILIES as COMPILED
from kiribench.design.correlations import correlations, weighted_jets
from kiribench.design.design_part import KEPT_GRIDS, DesignPart, with_three
from kiribench.design.response import KernelResponse
from kiribench.errors import UsageError
from kiribench.surrogate.kernel_form import KernelForm, TorchParameters, design_correlation
from kiribench.surrogate.kernels import FAMILIES

RNG = np.random.default_rng(1)
STRAIN = RNG.uniform(0.06, 0.55, 9)
POINTS = RNG.uniform(0.0, 0.9, (9, 2))


@pytest.mark.parametrize("model", ["gp_kronecker", "gp"])
def test_it_is_the_models_mean(model: str) -> None:
    kept = surrogates(model).poisson
    response = KernelResponse.of(kept, STRAIN)
    expected = kept.predict(100 * POINTS[:, 0], 100 * POINTS[:, 1], STRAIN).mean
    np.testing.assert_allclose(response.jet(POINTS).value, expected, rtol=0, atol=1e-9)
    ticks = np.array([0.0, 0.31, 0.9])
    grid = response.on_grid(ticks, ticks[:2], np.array([4, 2]))
    a, b = np.meshgrid(100 * ticks, 100 * ticks[:2], indexing="ij")
    for row, cell in zip(grid, (4, 2), strict=True):
        np.testing.assert_allclose(
            row.ravel(), kept.predict(a.ravel(), b.ravel(), STRAIN[cell]).mean, rtol=0, atol=1e-9
        )


@pytest.mark.parametrize("model", ["gp_kronecker", "gp"])
def test_derivatives_against_finite_differences(model: str) -> None:
    response = KernelResponse.of(surrogates(model).poisson, STRAIN)
    at, step = response.jet(POINTS), 1e-4
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead, behind = response.jet(POINTS + shift), response.jet(POINTS - shift)
        slope = (ahead.value - behind.value) / (2 * step)
        curvature = (ahead.slope - behind.slope) / (2 * step)
        scale = np.abs(at.slope).max(), np.abs(at.curvature).max()
        assert np.abs(slope - at.slope[:, axis]).max() < DIFFERENCE_SLOPE * scale[0]
        # A first cut shorter than any in the table lies where the warp turns straight.
        inside = (POINTS > 0.06).all(axis=1)
        assert np.abs(curvature - at.curvature[:, axis])[inside].max() < 10 * (
            DIFFERENCE_SLOPE * scale[1]
        )


@pytest.mark.parametrize("cornered", [False, True])
@pytest.mark.parametrize("warped", [False, True])
@pytest.mark.parametrize("family", list(FAMILIES))
def test_every_kernel_against_torchs_differentiation(
    family: str, warped: bool, cornered: bool
) -> None:
    form = KernelForm(family, "gaussian", 3, warped=warped, cornered=cornered)
    lengths = np.array([0.3, 0.5, 0.7][: 2 + cornered])
    parameters = TorchParameters(
        torch.tensor([*lengths, 0.4], dtype=torch.float64),
        torch.tensor([[0.5, 3.0], [2.0, 0.2]], dtype=torch.float64),
        torch.tensor([0.05, 0.11], dtype=torch.float64),
        torch.tensor(0.0, dtype=torch.float64),
    )
    nodes = torch.tensor(RNG.uniform(0, 1, (6, 2)))
    weights = RNG.normal(size=(1, 6))
    coordinates = Coordinates(
        np.array([1.0, 1.0]),
        np.array([98.0, 98.0]),
        ((0.5, 3.0), (2.0, 0.2)) if warped else None,
        (0.05, 0.11) if cornered else None,
        lengths,
    )
    at_nodes = np.ascontiguousarray(with_three(coordinates.jet(nodes.numpy())[0]).T)
    part = DesignPart(0.3, coordinates, at_nodes, family, None, lambda _: weights)
    response = KernelResponse(part, weights, weights)
    for point in RNG.uniform(0.02, 0.98, (5, 2)):

        def mean(x: torch.Tensor) -> torch.Tensor:
            scaled = (100 * x - 1.0) / 98.0
            k = design_correlation(form, scaled[None, :], nodes, parameters)
            return (k * torch.tensor(weights)).sum() + 0.3

        x = torch.tensor(point, requires_grad=True)
        slope = torch.autograd.functional.jacobian(mean, x).numpy()
        curvature = torch.autograd.functional.hessian(mean, x).numpy()
        at = response.jet(point[None, :], np.zeros(1, dtype=np.int64))
        assert at.value[0] == pytest.approx(float(mean(x.detach())), abs=1e-12)
        np.testing.assert_allclose(at.slope[0], slope, atol=AUTOGRAD * np.abs(slope).max())
        np.testing.assert_allclose(
            at.curvature[0], curvature, atol=AUTOGRAD * np.abs(curvature).max()
        )
        grid = response.on_grid(point[:1], point[1:])
        assert grid[0, 0, 0] == pytest.approx(float(mean(x.detach())), abs=1e-12)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_compiled_correlations_are_the_families_products(family: str) -> None:
    assert set(COMPILED) == set(FAMILIES)
    at, nodes = RNG.normal(size=(5, 3)), RNG.normal(size=(3, 7))
    expected = np.ones((5, 7))
    for c in range(3):
        gap = np.abs(np.subtract.outer(at[:, c], nodes[c]))
        expected *= FAMILIES[family](torch.tensor(gap)).numpy()
    np.testing.assert_allclose(correlations(family, at, nodes), expected, rtol=1e-13)
    weights, cells = RNG.normal(size=(2, 7)), np.array([1, 0, 1, 1, 0])
    value = weighted_jets(family, at, nodes, weights, cells)[:, 0]
    np.testing.assert_allclose(value, (weights[cells] * expected).sum(axis=1), atol=1e-13)


def test_points_at_a_design_and_far_from_all_have_finite_derivatives() -> None:
    nodes = np.zeros((3, 1))
    at = np.array([[0.0, 0.0, 0.0], [1e4, 0.0, 0.0], [0.0, -1e4, 1e4]])
    for family in FAMILIES:
        jets = weighted_jets(family, at, nodes, np.ones((1, 1)), np.zeros(3, dtype=np.int64))
        assert np.isfinite(jets).all()
        assert jets[0, 0] == 1.0
        assert (jets[0, 1:4] == 0.0).all()
        assert (np.abs(jets[1:]) < 1e-60).all()


def test_what_is_kept_of_a_process_is_made_once_and_goes_with_a_new_fit() -> None:
    kept = surrogates().poisson
    first, second = (KernelResponse.of(kept, STRAIN[:k]) for k in (2, 5))
    assert first.part is second.part
    ticks = np.linspace(0.0, 0.9, 7)
    assert first.part.on_grid(ticks, ticks) is second.part.on_grid(ticks, ticks)
    fine = np.linspace(0.0, 0.9, 70)
    assert first.part.on_grid(fine, fine) is not second.part.on_grid(fine, fine)
    for count in range(2, 9):
        second.part.on_grid(ticks[:count], ticks)
    assert len(second.part._grids) <= KEPT_GRIDS
    other = surrogates("gp").poisson
    assert KernelResponse.of(other, STRAIN).part is not first.part


def test_the_warp_runs_straight_on_beyond_its_ends() -> None:
    x = np.array([-0.2, -0.1, 1.1, 1.2])
    value, slope, curvature = warp_jet(x, (2.0, 5.0))
    assert curvature.tolist() == [0, 0, 0, 0]
    np.testing.assert_allclose((value[1] - value[0]) / 0.1, slope[0], rtol=1e-12)
    np.testing.assert_allclose((value[3] - value[2]) / 0.1, slope[3], rtol=1e-12)


def test_a_model_without_derivatives_is_refused() -> None:
    with pytest.raises(UsageError) as caught:
        KernelResponse.of(surrogates("polynomial").poisson, STRAIN)
    assert caught.value.code == "surrogate-not-smooth"
