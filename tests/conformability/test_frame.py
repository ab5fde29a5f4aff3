"""The frame of the worn scan: found, kept, assumed or refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from curved_surfaces import grid_uv, nodes_on, patch_mesh
from tolerances import FRAME_MM

from kiribench.conformability.frame import Brought, Registering, bring_together, under_patch
from kiribench.errors import RegistrationError
from kiribench.surface.acquisition import Acquired
from kiribench.surface.mesh import Mesh
from kiribench.surface.rigid import RigidTransform, rotation_of
from kiribench.surface.topology import Topology, topology


def limb(uv: np.ndarray) -> np.ndarray:
    """A tapering limb with a bump, so that no sliding leaves it unchanged."""
    u, v = uv[..., 0], uv[..., 1]
    radius = 45.0 - 0.15 * u + 4.0 * np.exp(-((u - 5.0) ** 2 + (v - 3.0) ** 2) / 600.0)
    angle = v / 45.0
    return np.stack([u, radius * np.sin(angle), radius * np.cos(angle)], axis=-1)


GRID = grid_uv(4, 4)
SKIN = limb(GRID)


def acquired(mesh: Mesh, corners: np.ndarray, name: str) -> Acquired:
    return Acquired(name, mesh, topology(mesh), nodes_on(mesh, corners), False, (), ())


@pytest.fixture(scope="module")
def bare() -> Acquired:
    return acquired(patch_mesh(limb, (75.0, 60.0), 1.6, seed=1), SKIN, "flex090")


def with_patch(uv: np.ndarray) -> np.ndarray:
    """The limb under a 2 mm patch."""
    inside = (np.abs(uv) < 33.0).all(axis=-1)
    at = limb(uv)
    outward = at * [0.0, 1.0, 1.0]
    outward = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return at + 2.0 * inside[..., None] * outward


@cache
def still(half: tuple[float, float]) -> tuple[Mesh, Topology]:
    """The worn scan before it is moved."""
    mesh = patch_mesh(with_patch, half, 1.5, seed=2)
    return mesh, topology(mesh)


def worn(motion: RigidTransform, half: tuple[float, float] = (62.0, 50.0)) -> Acquired:
    """The same limb seen again with other triangles, a 2 mm patch on it, and moved."""
    mesh, table = still(half)
    moved = motion.moved(mesh)
    corners = motion.apply(with_patch(GRID + np.array([1.0, -0.5])))
    return Acquired("flex090worn", moved, table, nodes_on(moved, corners), False, (), ())


def bring(
    one: Acquired,
    bare: Acquired,
    *,
    registering: Registering = "auto",
    declared: bool = False,
) -> Brought:
    return bring_together(
        one,
        bare,
        SKIN,
        thickness_mm=2.0,
        registering=registering,
        declared=declared,
        samples=200,
        rng=np.random.default_rng(0),
    )


MOTION = RigidTransform(rotation_of(np.array([0.05, -0.1, 0.08])), np.array([8.0, -5.0, 12.0]))
SMALL = RigidTransform(rotation_of(np.array([0.0, 0.002, 0.004])), np.array([0.8, -0.6, 0.3]))
FAR = RigidTransform(rotation_of(np.array([0.4, 1.0, -0.7])), np.array([400.0, 90.0, -250.0]))


@pytest.mark.parametrize("motion", [MOTION, SMALL, FAR], ids=["moved", "slightly", "far"])
def test_the_motion_is_found_by_the_skin_outside_the_patch(
    bare: Acquired, motion: RigidTransform
) -> None:
    one = worn(motion)
    brought = bring(one, bare)
    assert brought.report.method == "registered"
    true = motion.inverse().apply(one.nodes.positions_mm)
    error = np.linalg.norm(brought.patch_mm - true, axis=-1)
    assert float(error.max()) < FRAME_MM
    # The patch itself was placed 1 mm too far distally: registering must not undo that.
    offset = (brought.patch_mm - SKIN)[..., 0].mean()
    assert offset == pytest.approx(1.0, abs=FRAME_MM)
    assert brought.report.residual_rms_mm is not None
    assert brought.report.residual_rms_mm < 0.05
    assert brought.draws_mm is not None
    assert brought.draws_mm.shape == (200, 5, 5, 3)
    spread = float(np.sqrt((brought.draws_mm**2).mean()))
    assert spread == pytest.approx(brought.report.shift_sd_mm, rel=0.3)


def test_scans_in_one_frame_are_not_moved_by_more_than_the_noise(bare: Acquired) -> None:
    one = worn(RigidTransform.identity())
    brought = bring(one, bare)
    error = np.linalg.norm(brought.patch_mm - one.nodes.positions_mm, axis=-1)
    assert brought.report.method == "kept"
    assert float(error.max()) == 0.0
    assert brought.report.shift_mm == 0.0
    assert brought.draws_mm is not None


def test_a_declared_frame_and_none_are_taken_as_given(bare: Acquired) -> None:
    one = worn(SMALL)
    for registering, declared, method in (("auto", True, "declared"), ("none", False, "none")):
        brought = bring(one, bare, registering=registering, declared=declared)
        assert brought.report.method == method
        assert brought.draws_mm is None
        np.testing.assert_array_equal(brought.patch_mm, one.nodes.positions_mm)


def test_a_scan_of_the_patch_alone_is_assumed_in_place_and_says_so(bare: Acquired) -> None:
    one = worn(RigidTransform.identity(), half=(31.5, 31.5))
    brought = bring(one, bare)
    assert brought.report.method == "assumed"
    assert [fault.code for fault in brought.warnings] == ["frame-assumed"]
    assert brought.warnings[0].severity == "warning"


def test_a_scan_of_the_patch_alone_elsewhere_is_refused(bare: Acquired) -> None:
    one = worn(FAR, half=(31.5, 31.5))
    with pytest.raises(RegistrationError) as caught:
        bring(one, bare)
    assert caught.value.code == "registration-too-little-skin"


def test_faces_under_the_patch_are_left_out(bare: Acquired) -> None:
    one = worn(RigidTransform.identity())
    hidden = under_patch(one.mesh, one.nodes.positions_mm)
    centres = one.mesh.corners_mm.mean(axis=1)
    on_patch = (
        np.linalg.norm(centres[:, 1:], axis=1)
        > np.linalg.norm(
            limb(
                np.stack([centres[:, 0], 45.0 * np.arctan2(centres[:, 1], centres[:, 2])], axis=1)
            )[:, 1:],
            axis=1,
        )
        + 1.0
    )
    # The sheet reaches 2 mm beyond its corners; every raised face is hidden.
    assert on_patch.sum() > 500
    assert hidden[on_patch].all()
    assert 0.3 < float((~hidden).mean()) < 0.8
