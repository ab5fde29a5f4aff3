"""What a strain measurement returns: one array a quantity, a reason where there is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault

FloatArray = NDArray[np.float64]
TextArray = NDArray[np.str_]

StrainMeasure = Literal["log", "engineering", "green"]
STRAIN_MEASURES: tuple[str, ...] = get_args(StrainMeasure)

#: Reason codes of a strain table, with the sentence that a report prints.
REASONS = {
    "node-missing": "A corner node is missing or hidden in one of the two poses.",
    "path-around-hole": "A path of the cell leads around a hole of a scan, so that its length "
    "is not that of the skin.",
    "cell-degenerate": "The cell is folded or has no area in the reference pose.",
    "strain-too-small": "The longitudinal strain is smaller than the stated minimum.",
    "interval-unbounded": "The node uncertainty does not exclude zero longitudinal strain, "
    "so the ratio has no finite 95 % interval.",
}


@dataclass(frozen=True, eq=False)
class Estimate:
    """A measured quantity of every cell with its uncertainty from the node positions.

    Attributes:
        value: (R, C); NaN exactly where the cell's reason is not empty.
        sd: (R, C) standard deviation, first order in the node uncertainty.
        low, high: (R, C) 95 % interval; NaN where there is no finite one.
    """

    value: FloatArray
    sd: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class StrainField:
    """The strain of every grid cell between two poses of one participant.

    Shapes are (R, C), row 0 proximal, column 0 lateral. The material frame of a cell has
    its first axis along the longitudinal mid-line (distal), its second across (medial),
    in each pose.

    Attributes:
        participant: the subject's id.
        strain_measure: the measure of the two strains and of Poisson's ratio.
        min_strain: below this longitudinal strain (absolute) Poisson's ratio is masked.
        longitudinal_stretch, lateral_stretch: mean of the length ratios of the two
            opposite geodesic edges (the paper's way).
        longitudinal_strain, lateral_strain: these stretches in ``strain_measure``.
        shear: tangent of the angle by which the right angle between the longitudinal and
            the lateral fibre has closed (``F = Q [[a, g b], [0, b]]``), from the gradient.
        poisson_ratio: minus lateral over longitudinal strain, with Fieller's interval.
        gradient: (R, C, 2, 2) in-plane deformation gradient at the cell's centre.
        gradient_longitudinal_stretch, gradient_lateral_stretch: ``a`` and ``b`` above; a
            simple shear leaves them at 1, while it lengthens edges.
        principal_stretches: (R, C, 2), larger first.
        principal_angle_deg: (R, C) direction of the larger one in the reference, from
            the longitudinal towards the medial axis.
        rotation_deg: (R, C) angle of R in ``F = R U``: how far the material turns against
            its longitudinal fibre; from the longitudinal towards the medial axis.
        area_ratio: (R, C) determinant of the gradient.
        green: (R, C, 3) Green-Lagrange strains (ll, tt, lt); hencky: the same of ln U.
        reason: (R, C) why the cell has no strain; empty where it has.
        poisson_reason: (R, C) why Poisson's ratio or its interval is absent.
        reference_edges_mm, deformed_edges_mm: longitudinal (R, C+1) and lateral (R+1, C)
            geodesic edge lengths; NaN beside a missing node.
        sd_reference_mm, sd_deformed_mm: (R+1, C+1) node uncertainty used.
        reference_pose, deformed_pose: acquisition names.
        denoised: whether (reference, deformed) scans were denoised.
        notes: facts a reader needs (assumed node sd, noise estimates), as sentences.
        warnings: what is doubtful in the input.
    """

    participant: str
    strain_measure: StrainMeasure
    min_strain: float
    longitudinal_stretch: Estimate
    lateral_stretch: Estimate
    longitudinal_strain: Estimate
    lateral_strain: Estimate
    shear: Estimate
    poisson_ratio: Estimate
    gradient: FloatArray
    gradient_longitudinal_stretch: FloatArray
    gradient_lateral_stretch: FloatArray
    principal_stretches: FloatArray
    principal_angle_deg: FloatArray
    rotation_deg: FloatArray
    area_ratio: FloatArray
    green: FloatArray
    hencky: FloatArray
    reason: TextArray
    poisson_reason: TextArray
    reference_edges_mm: tuple[FloatArray, FloatArray]
    deformed_edges_mm: tuple[FloatArray, FloatArray]
    sd_reference_mm: FloatArray
    sd_deformed_mm: FloatArray
    reference_pose: str
    deformed_pose: str
    denoised: tuple[bool, bool] = (False, False)
    notes: tuple[str, ...] = ()
    warnings: tuple[Fault, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C) number of cells down and across."""
        rows, columns = self.reason.shape
        return int(rows), int(columns)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(R, C) whether the cell has a strain."""
        return np.asarray(self.reason == "")
