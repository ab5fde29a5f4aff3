"""The strain of every cell from two poses that are already flattened and measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault
from kiribench.strain.gradient import decompose, gradient_of, material_frame, signed_area
from kiribench.strain.measures import check_measure, strain_of, strain_rate_of
from kiribench.strain.result import Estimate, StrainField, StrainMeasure
from kiribench.strain.uncertainty import Z95, fieller, propagate

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose:
    """A node grid in one pose.

    Attributes:
        name: acquisition name.
        longitudinal_mm: (R, C+1) geodesic lengths (r, c) to (r+1, c), NaN where absent.
        lateral_mm: (R+1, C) geodesic lengths (r, c) to (r, c+1).
        corners: (R, C, 4, 2) flattened corners, mm, in right-handed tangent frames seen
            from outside; NaN where a corner is absent.
        sd_mm: (R+1, C+1) node sd per tangent direction.
        denoised: whether the scan was denoised first.
        around_hole: (R, C) cells with a path around a hole of the scan; None for none.
    """

    name: str
    longitudinal_mm: FloatArray
    lateral_mm: FloatArray
    corners: FloatArray
    sd_mm: FloatArray
    denoised: bool = False
    around_hole: NDArray[np.bool_] | None = None


def at_corners(nodes: FloatArray) -> FloatArray:
    """(R+1, C+1) node values at the (R, C, 4) corners of the cells."""
    return np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=-1)


def edge_stretches(reference: Pose, deformed: Pose) -> tuple[FloatArray, FloatArray]:
    """Mean length ratio of the two opposite edges of every cell (paper, Fig. 2).

    Returns:
        (R, C) longitudinal, (R, C) lateral; NaN beside an absent node.
    """
    along = deformed.longitudinal_mm / reference.longitudinal_mm
    across = deformed.lateral_mm / reference.lateral_mm
    return 0.5 * (along[:, :-1] + along[:, 1:]), 0.5 * (across[:-1] + across[1:])


def cell_reasons(reference: Pose, deformed: Pose) -> NDArray[np.str_]:
    """(R, C) reason code of every cell that cannot be measured, else ``""``.

    A cell is degenerate if it has no area, or if it is turned over against the majority of
    the cells in its pose: a swapped pair of nodes.
    """
    reason = np.full(reference.corners.shape[:2], "", dtype="<U32")
    for pose in (reference, deformed):
        area = signed_area(pose.corners)
        present = np.isfinite(area)
        sense = np.sign(np.nansum(np.sign(area)))
        with np.errstate(invalid="ignore"):
            reason[present & ~(area * (sense or 1.0) > 0.0)] = "cell-degenerate"
    for pose in (reference, deformed):
        reason[~np.isfinite(pose.corners).all(axis=(-1, -2))] = "node-missing"
    for pose in (reference, deformed):
        if pose.around_hole is not None:
            reason[pose.around_hole] = "path-around-hole"
    return reason


def strain_field(
    participant: str,
    reference: Pose,
    deformed: Pose,
    *,
    strain_measure: StrainMeasure = "log",
    min_strain: float = 0.03,
    notes: tuple[str, ...] = (),
    warnings: tuple[Fault, ...] = (),
) -> StrainField:
    """Measure every cell.

    Args:
        participant: id for the result.
        reference, deformed: the same node grid in two poses.
        strain_measure: of the two strains and of Poisson's ratio.
        min_strain: Poisson's ratio is masked where the absolute longitudinal strain is
            below this.
        notes, warnings: passed on to the result.

    Raises:
        UsageError: the strain measure does not exist.
    """
    check_measure(strain_measure)
    reason = cell_reasons(reference, deformed)
    fine = reason == ""

    def full(values: FloatArray) -> FloatArray:
        out = np.full((*fine.shape, *values.shape[1:]), np.nan)
        out[fine] = values
        return out

    along, across = (stretch[fine] for stretch in edge_stretches(reference, deformed))
    big_x = material_frame(reference.corners[fine])
    x = material_frame(deformed.corners[fine])
    kinematics = decompose(gradient_of(big_x, x))
    covariance = propagate(
        big_x, x, at_corners(reference.sd_mm)[fine], at_corners(deformed.sd_mm)[fine]
    )

    def estimate(value: FloatArray, sd: FloatArray) -> Estimate:
        return Estimate(full(value), full(sd), full(value - Z95 * sd), full(value + Z95 * sd))

    sd = np.sqrt(np.einsum("...qq->...q", covariance))
    rate_along = strain_rate_of(along, strain_measure)
    rate_across = strain_rate_of(across, strain_measure)
    strain_along = strain_of(along, strain_measure)
    strain_across = strain_of(across, strain_measure)
    ratio = fieller(
        -strain_across,
        strain_along,
        rate_across**2 * covariance[..., 1, 1],
        rate_along**2 * covariance[..., 0, 0],
        -rate_across * rate_along * covariance[..., 0, 1],
    )
    small = ~(np.abs(strain_along) >= min_strain) | (strain_along == 0.0)
    poisson_reason = reason.copy()
    poisson_reason[fine] = np.where(
        small, "strain-too-small", np.where(ratio.bounded, "", "interval-unbounded")
    )

    def masked(values: FloatArray) -> FloatArray:
        return full(np.where(small, np.nan, values))

    return StrainField(
        participant=participant,
        strain_measure=strain_measure,
        min_strain=min_strain,
        longitudinal_stretch=estimate(along, sd[..., 0]),
        lateral_stretch=estimate(across, sd[..., 1]),
        longitudinal_strain=estimate(strain_along, np.abs(rate_along) * sd[..., 0]),
        lateral_strain=estimate(strain_across, np.abs(rate_across) * sd[..., 1]),
        shear=estimate(kinematics.shear, sd[..., 2]),
        poisson_ratio=Estimate(
            masked(ratio.value), masked(ratio.sd), masked(ratio.low), masked(ratio.high)
        ),
        gradient=full(kinematics.gradient),
        gradient_longitudinal_stretch=full(kinematics.longitudinal_stretch),
        gradient_lateral_stretch=full(kinematics.lateral_stretch),
        principal_stretches=full(kinematics.principal_stretches),
        principal_angle_deg=full(np.rad2deg(kinematics.principal_angle)),
        rotation_deg=full(np.rad2deg(kinematics.rotation)),
        area_ratio=full(kinematics.area_ratio),
        green=full(kinematics.green),
        hencky=full(kinematics.hencky),
        reason=reason,
        poisson_reason=poisson_reason,
        reference_edges_mm=(reference.longitudinal_mm, reference.lateral_mm),
        deformed_edges_mm=(deformed.longitudinal_mm, deformed.lateral_mm),
        sd_reference_mm=reference.sd_mm,
        sd_deformed_mm=deformed.sd_mm,
        reference_pose=reference.name,
        deformed_pose=deformed.name,
        denoised=(reference.denoised, deformed.denoised),
        notes=notes,
        warnings=warnings,
    )
