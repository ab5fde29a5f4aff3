"""The true strain of every grid cell between two smooth surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.synthetic.arc import geodesic_arcs
from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.smooth import SmoothSurface


@dataclass(frozen=True, eq=False)
class EdgeLengths:
    """Geodesic lengths between adjacent grid nodes, in mm.

    Attributes:
        lateral_mm: (R + 1, C) edges that run from lateral to medial.
        longitudinal_mm: (R, C + 1) edges that run from proximal to distal.
    """

    lateral_mm: FloatArray
    longitudinal_mm: FloatArray


@dataclass(frozen=True, eq=False)
class StrainTruth:
    """Strain from the 0-degree to the 90-degree surface, one entry a grid cell.

    From the cell's edges (the paper's way):

    Attributes:
        longitudinal_stretch: (R, C) mean of the length ratios of the cell's two
            longitudinal edges (geodesic at 90 degrees over geodesic at 0 degrees).
        lateral_stretch: (R, C) the same for its two lateral edges.
        poisson_ratio: (R, C) -ln(lateral_stretch) / ln(longitudinal_stretch): log measure.
        reference, flexed: the edges' geodesic lengths.

    At the material point of the cell's centre, from the two metrics alone:

        right_cauchy_green: (R, C, 2, 2) C in the orthonormal frame of the 0-degree tangent
            plane whose second axis is longitudinal, X0_v / |X0_v|, and whose first is at
            right angles to it on the medial side. C_11 and C_22 are the squared stretches of
            these two material lines.
        shear: (R, C) tan(gamma) = C_12 / sqrt(det C), gamma being the angle in radians by
            which the two lines, at right angles at 0 degrees, close at 90 degrees; a simple
            shear of amount k gives k. Positive if the angle between lateral-to-medial and
            proximal-to-distal becomes smaller.
        principal_stretches: (R, C, 2) the larger one first: square roots of C's eigenvalues.
    """

    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    poisson_ratio: FloatArray
    reference: EdgeLengths
    flexed: EdgeLengths
    right_cauchy_green: FloatArray
    shear: FloatArray
    principal_stretches: FloatArray


def edge_lengths(surface: SmoothSurface, nodes: FloatArray) -> EdgeLengths:
    """Geodesic lengths between the adjacent nodes (R + 1, C + 1, 2) of a grid."""
    lateral = geodesic_arcs(surface, nodes[:, :-1].reshape(-1, 2), nodes[:, 1:].reshape(-1, 2))
    longitudinal = geodesic_arcs(surface, nodes[:-1].reshape(-1, 2), nodes[1:].reshape(-1, 2))
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    return EdgeLengths(
        lateral.length_mm.reshape(rows + 1, columns),
        longitudinal.length_mm.reshape(rows, columns + 1),
    )


def strain_truth(reference: SmoothSurface, flexed: SmoothSurface, nodes: FloatArray) -> StrainTruth:
    """The strain of the cells between the grid nodes.

    Args:
        reference, flexed: the skin at 0 and at 90 degrees over the same material (u, v).
        nodes: (R + 1, C + 1, 2) material coordinates of the nodes, mm.
    """
    before, after = edge_lengths(reference, nodes), edge_lengths(flexed, nodes)
    lateral_ratio = after.lateral_mm / before.lateral_mm
    longitudinal_ratio = after.longitudinal_mm / before.longitudinal_mm
    lateral = 0.5 * (lateral_ratio[:-1] + lateral_ratio[1:])
    longitudinal = 0.5 * (longitudinal_ratio[:, :-1] + longitudinal_ratio[:, 1:])
    centres = 0.25 * (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:])
    c = right_cauchy_green(reference, flexed, centres)
    eigenvalues = np.linalg.eigvalsh(c)
    return StrainTruth(
        longitudinal_stretch=longitudinal,
        lateral_stretch=lateral,
        poisson_ratio=-np.log(lateral) / np.log(longitudinal),
        reference=before,
        flexed=after,
        right_cauchy_green=c,
        shear=c[..., 0, 1] / np.sqrt(np.linalg.det(c)),
        principal_stretches=np.sqrt(eigenvalues[..., ::-1]),
    )


def right_cauchy_green(
    reference: SmoothSurface, flexed: SmoothSurface, q: FloatArray
) -> FloatArray:
    """(..., 2, 2) C at the material points q (..., 2), in the frame of :class:`StrainTruth`.

    With G the 0-degree metric, the frame's first axis is (1, -G_uv/G_vv) / sqrt(det G / G_vv)
    in material coordinates and its second (0, 1) / sqrt(G_vv); C is the 90-degree metric in
    these two.
    """
    g0, g1 = reference.metric(q), flexed.metric(q)
    frame = np.zeros_like(g0)
    frame[..., 0, 0] = np.sqrt(g0[..., 1, 1] / np.linalg.det(g0))
    frame[..., 0, 1] = -g0[..., 0, 1] / g0[..., 1, 1] * frame[..., 0, 0]
    frame[..., 1, 1] = 1.0 / np.sqrt(g0[..., 1, 1])
    return np.asarray(frame @ g1 @ np.swapaxes(frame, -1, -2))
