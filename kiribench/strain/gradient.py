"""The in-plane deformation gradient of a cell, and what it is made of.

A cell has four corners in the order proximal-lateral, proximal-medial, distal-medial,
distal-lateral (the nodes (r, c), (r, c+1), (r+1, c+1), (r+1, c)), flattened about its
centre in each pose. The mid-lines join the midpoints of opposite sides; they are half the
sum and half the difference of the two diagonals, so the gradient at the centre of the
bilinear map uses both diagonals and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Kinematics:
    """The deformation of cells; leading shape ``...`` of the corners.

    Attributes:
        gradient: (..., 2, 2) ``F`` in the material frames (:func:`material_frame`);
            upper triangular, because the longitudinal mid-line is the first axis of
            both frames.
        longitudinal_stretch, lateral_stretch, shear: ``a, b, g`` of
            ``F = [[a, g b], [0, b]]``: stretch of the longitudinal fibre, stretch of
            the width across it, tangent of the closing of the right angle (the
            triangular decomposition, Srinivasa 2012, doi 10.1016/j.ijengsci.2012.05.002).
        principal_stretches: (..., 2), larger first; square roots of the eigenvalues of
            ``C = F'F``.
        principal_angle: (...) radians, direction of the larger one in the reference, in
            (-pi/2, pi/2]; 0 where both are equal.
        rotation: (...) radians, angle of the polar factor R in ``F = R U``.
        area_ratio: (...) det F.
        green: (..., 3) ``(C - 1) / 2`` as (ll, tt, lt); hencky: the same of ``ln U``.
    """

    gradient: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    shear: FloatArray
    principal_stretches: FloatArray
    principal_angle: FloatArray
    rotation: FloatArray
    area_ratio: FloatArray
    green: FloatArray
    hencky: FloatArray


def mid_lines(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitudinal and lateral mid-lines of cells.

    Args:
        corners: (..., 4, n) in the order of the module's docstring.

    Returns:
        (..., n) from the proximal to the distal side, (..., n) from the lateral to the
        medial side.
    """
    along = 0.5 * (
        corners[..., 3, :] + corners[..., 2, :] - corners[..., 0, :] - corners[..., 1, :]
    )
    across = 0.5 * (
        corners[..., 1, :] + corners[..., 2, :] - corners[..., 0, :] - corners[..., 3, :]
    )
    return along, across


def signed_area(corners: FloatArray) -> FloatArray:
    """Area of the mid-line parallelogram, which is the area of the quad, with its sign.

    Args:
        corners: (..., 4, 2); positive where the turn from the longitudinal to the lateral
            mid-line is counter-clockwise.
    """
    along, across = mid_lines(corners)
    return np.asarray(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0])


def material_frame(corners: FloatArray) -> FloatArray:
    """Corners in the cell's own frame: first axis distal, second medial.

    The first axis lies along the longitudinal mid-line; the second is perpendicular to
    it on the medial side, whatever the handedness of the input, so a left and a right
    leg give the same numbers.

    Args:
        corners: (..., 4, 2) flattened corners, mm.

    Returns:
        (..., 4, 2) about the mean of the corners, mm.
    """
    along, _ = mid_lines(corners)
    first = along / np.linalg.norm(along, axis=-1, keepdims=True)
    second = np.stack([-first[..., 1], first[..., 0]], axis=-1)
    second = second * np.where(signed_area(corners) < 0.0, -1.0, 1.0)[..., None]
    centred = corners - corners.mean(axis=-2, keepdims=True)
    return np.stack(
        [
            np.einsum("...cn,...n->...c", centred, first),
            np.einsum("...cn,...n->...c", centred, second),
        ],
        axis=-1,
    )


def gradient_of(reference: FloatArray, deformed: FloatArray) -> FloatArray:
    """Gradient at the centre of the bilinear map between two quads.

    Args:
        reference, deformed: (..., 4, 2) corners, mm, each in its own frame.

    Returns:
        (..., 2, 2) ``F`` with ``F dX = dx``.
    """
    x = np.stack(mid_lines(deformed), axis=-1)
    big_x = np.stack(mid_lines(reference), axis=-1)
    return np.asarray(x @ np.linalg.inv(big_x))


def decompose(gradient: FloatArray) -> Kinematics:
    """Everything that a deformation gradient says, in closed form.

    Args:
        gradient: (..., 2, 2), positive determinant.
    """
    f11, f12 = gradient[..., 0, 0], gradient[..., 0, 1]
    f21, f22 = gradient[..., 1, 0], gradient[..., 1, 1]
    det = f11 * f22 - f12 * f21
    along = np.hypot(f11, f21)
    across = det / along
    shear = (f11 * f12 + f21 * f22) / det
    # Polar decomposition of a 2 x 2 matrix: R is the rotation by the angle of the
    # complex number (F11 + F22) + i (F21 - F12); |that| = trace of U.
    rotation = np.arctan2(f21 - f12, f11 + f22)
    cos, sin = np.cos(rotation), np.sin(rotation)
    u11 = cos * f11 + sin * f21
    u12 = cos * f12 + sin * f22
    u22 = -sin * f12 + cos * f22
    mean = 0.5 * (u11 + u22)
    half = np.hypot(0.5 * (u11 - u22), u12)
    principal = np.stack([mean + half, mean - half], axis=-1)
    angle = 0.5 * np.arctan2(2.0 * u12, u11 - u22)
    log_mean = 0.5 * np.log(principal).sum(axis=-1)
    log_half = 0.5 * (np.log(principal[..., 0]) - np.log(principal[..., 1]))
    c2, s2 = np.cos(2.0 * angle), np.sin(2.0 * angle)
    hencky = np.stack([log_mean + log_half * c2, log_mean - log_half * c2, log_half * s2], axis=-1)
    green = np.stack(
        [
            0.5 * (f11 * f11 + f21 * f21 - 1.0),
            0.5 * (f12 * f12 + f22 * f22 - 1.0),
            0.5 * (f11 * f12 + f21 * f22),
        ],
        axis=-1,
    )
    return Kinematics(
        gradient=gradient,
        longitudinal_stretch=along,
        lateral_stretch=across,
        shear=shear,
        principal_stretches=principal,
        principal_angle=angle,
        rotation=rotation,
        area_ratio=det,
        green=green,
        hencky=hencky,
    )


def triangular(longitudinal: float, lateral: float, shear: float) -> FloatArray:
    """(2, 2) matrix ``[[a, g b], [0, b]]`` of two stretches and a shear."""
    return np.array([[longitudinal, shear * lateral], [0.0, lateral]])
