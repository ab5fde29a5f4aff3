"""The networks' written-out gradient against autograd, and what they can learn."""

from __future__ import annotations

import numpy as np
import torch

from kiribench.surrogate.mlp_ensemble import MLPEnsemble, _forward, _Network


def test_the_slope_is_that_of_autograd() -> None:
    generator = torch.Generator().manual_seed(1)
    network = _Network(3, (4, 7, 5, 1), torch.device("cpu"))
    network.flat.copy_(torch.randn(network.flat.shape, generator=generator))
    inputs = torch.randn((3, 11, 4), generator=generator)
    values = torch.randn((3, 11), generator=generator)
    layers = [layer.clone().requires_grad_(True) for layer in network.layers]
    loss = (_forward(layers, inputs) - values).square().mean(1).sum()
    by_autograd = torch.cat([x.flatten() for x in torch.autograd.grad(loss, layers)])
    torch.testing.assert_close(network.slope(inputs, values), by_autograd, rtol=2e-5, atol=2e-5)


def test_a_smooth_curve_is_learnt_and_unknown_ground_is_doubted() -> None:
    x = np.linspace(0.0, 1.0, 200)[:, None]
    model = MLPEnsemble(members=2, width=24, max_steps=800).fit(x, np.sin(6.0 * x[:, 0]))
    mean, sd = model.predict(x, return_std=True)
    assert np.sqrt(np.mean((mean - np.sin(6.0 * x[:, 0])) ** 2)) < 0.02
    assert model.predict(np.array([[3.0]]), return_std=True)[1][0] > 3.0 * np.median(sd)
