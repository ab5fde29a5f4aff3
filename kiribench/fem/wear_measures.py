"""What is read off a worn patch: the cells on the skin, and the rubber before the cut tips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.surface_map import SurfaceJet, SurfaceMap
from kiribench.fem.wear_mesh import PatchMesh, lagrange, physical_edge

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

TIP_DISTANCE_MM = 0.5
"""Where the rubber before a crack tip is judged: this far ahead of the tip at rest (or in the
middle of a ligament of less than twice that). The stress at the tip itself is infinite in any
such model; a point at a fixed distance is Taylor's measure (The Theory of Critical Distances,
2007), and does not depend on the mesh. The distance is our choice, a quarter of the thickness."""

BREAKING_STRETCH = 10.2
"""Stretch at which Dragon Skin 20 broke in uniaxial tension: last row of Dragon_Skin_20.csv of
the Soft Robotics Materials Database (crosshead strain, which overstates it; Marechal et al. 2020,
doi 10.1089/soro.2019.0115)."""

BREAKING_STRESS_MPA = 4.434
"""Nominal stress at which it broke: the same row."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True, eq=False)
class CellMeasures:
    """Cells on the skin: see the attributes of the same name of ``WornPatch``; all (R, C)."""

    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    shear: FloatArray


def site_means(mesh: PatchMesh, values: FloatArray) -> FloatArray:
    """Mean over both faces of nodal values (U, k) at the lattice sites: (2R + 1, 2C + 1, k)."""
    rows, columns = mesh.shape
    corners = values[mesh.site_nodes()].reshape(rows, columns, 4, -1)
    total = np.zeros((rows + 1, columns + 1, corners.shape[-1]))
    facets = np.zeros((rows + 1, columns + 1, 1))
    for k, (down, right) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
        into = (slice(down, down + rows), slice(right, right + columns))
        total[into] += corners[:, :, k]
        facets[into] += 1
    return np.asarray(total / facets)


def lengths_on(surface: SurfaceMap, start: FloatArray, end: FloatArray) -> FloatArray:
    """Lengths (...) on the skin of the lines that are straight in q from start to end (..., 2).

    Between the corners of a cell they differ from the geodesics by less than 1e-4 (fraction)
    on limbs; on developable skin they are the geodesics.
    """
    along = end - start
    total = np.zeros(start.shape[:-1])
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        at = start + 0.5 * (1 + node) * along
        first = surface.at(at.reshape(-1, 2)).first.reshape(*start.shape[:-1], 2, 3)
        speed = np.einsum("...i,...ia->...a", along, first)
        total += 0.5 * weight * np.linalg.norm(speed, axis=-1)
    return total


def cell_measures(surface: SurfaceMap, corner_q: FloatArray, cell_mm: float) -> CellMeasures:
    """Stretches and shear of the cells with corners (R + 1, C + 1, 2) in q."""
    along = lengths_on(surface, corner_q[:-1], corner_q[1:]) / cell_mm
    across = lengths_on(surface, corner_q[:, :-1], corner_q[:, 1:]) / cell_mm
    upper, lower = corner_q[:-1], corner_q[1:]
    down = 0.5 * (lower[:, :-1] + lower[:, 1:] - upper[:, :-1] - upper[:, 1:])
    side = 0.5 * (upper[:, 1:] + lower[:, 1:] - upper[:, :-1] - lower[:, :-1])
    middle = 0.25 * (upper[:, :-1] + upper[:, 1:] + lower[:, :-1] + lower[:, 1:])
    metric = surface.at(middle.reshape(-1, 2)).metric.reshape(*middle.shape[:-1], 2, 2)
    dot = np.einsum("rci,rcij,rcj->rc", down, metric, side)
    area = np.sqrt(np.linalg.det(metric)) * (
        side[..., 0] * down[..., 1] - side[..., 1] * down[..., 0]
    )
    return CellMeasures(
        0.5 * (along[:, :-1] + along[:, 1:]), 0.5 * (across[:-1] + across[1:]), dot / area
    )


def tip_state(mesh: PatchMesh, jet: SurfaceJet, mu_mpa: float) -> tuple[FloatArray, FloatArray]:
    """Largest principal stretch and Cauchy stress (MPa) before every tip; (k,) each, half-cuts in
    the order of ``CutMap.half_cuts``, the mean of the two facets beside the ligament."""
    cuts = mesh.cut_map.half_cuts()
    columns = mesh.shape[1]
    index = {
        (int(p), int(q), int(sense)): k
        for k, ((p, q), sense) in enumerate(zip(cuts.site, cuts.direction.sum(axis=1), strict=True))
    }
    facets, edges = np.nonzero(mesh.half_cuts > 0)
    if not len(facets):
        return np.empty(0), np.empty(0)
    which = np.empty(len(facets), dtype=np.int64)
    for at, (facet, edge) in enumerate(zip(facets.tolist(), edges.tolist(), strict=True)):
        i, j = divmod(facet, columns)
        (p, q), sense = _start_of(edge, bool(mesh.mirrored[facet]))
        which[at] = index[j + p, i + q, sense]
    large, small = _ahead(mesh, jet.x, facets, edges)
    stress = mu_mpa * (large**2 - 1 / (large * small) ** 2)
    facets_at = np.bincount(which, minlength=len(cuts))
    return (
        np.bincount(which, large, minlength=len(cuts)) / facets_at,
        np.bincount(which, stress, minlength=len(cuts)) / facets_at,
    )


def _start_of(edge: int, mirrored: bool) -> tuple[tuple[int, int], int]:
    """Site (p, q) from the facet's own where an edge's walk starts, and the walk's sense."""
    physical = physical_edge(edge, mirrored)
    if not mirrored:
        return (((0, 0), (1, 0), (1, 1), (0, 1))[physical], (1, 1, -1, -1)[physical])
    return (((1, 0), (1, 1), (0, 1), (0, 0))[physical], (-1, -1, 1, 1)[physical])


def _ahead(mesh: PatchMesh, x: FloatArray, facets: IntArray, edges: IntArray) -> FloatArray:
    """(2, k) principal stretches on the ligaments of edges of facets, ahead of their tips."""
    template = mesh.template
    order, before = template.order, template.cut_nodes
    elements_after = (template.intervals - before) // order
    ligament = (1 - mesh.half_cuts[facets, edges]) * mesh.cut_map.cell_mm / 2
    distance = np.minimum(TIP_DISTANCE_MM, 0.5 * ligament)
    span = ligament / elements_after
    hop = np.minimum((distance / span).astype(np.int64), elements_after - 1)
    rest = distance / span - hop
    # Distance runs with the square in the element with the quarter point, else linearly.
    along = np.where((hop == 0) & (order == 2), 2 * np.sqrt(np.maximum(rest, 0)) - 1, 2 * rest - 1)
    per_edge = template.intervals // order
    number = before // order + hop
    last = per_edge - 1
    # Element and local coordinates (xi across, eta up) in the template's own axes.
    row = np.choose(edges, [0 * number, number, 0 * number + last, last - number])
    column = np.choose(edges, [number, 0 * number + last, last - number, 0 * number])
    xi = np.choose(edges, [along, 0 * along + 1, -along, 0 * along - 1])
    eta = np.choose(edges, [0 * along - 1, along, 0 * along + 1, -along])
    by_xi, by_eta = _slopes(xi, eta, order)
    nodes = template.elements[row * per_edge + column]
    at_rest = mesh.facet_mm[facets[:, None], nodes]
    now = x[mesh.nodes[facets[:, None], nodes]]
    slopes = np.stack([by_xi, by_eta], axis=-1)
    reference = np.einsum("kai,kar->kir", at_rest, slopes)
    deformed = np.einsum("kad,kar->kdr", now, slopes)
    gradient = np.einsum("kdr,kri->kdi", deformed, np.linalg.inv(reference))
    values = np.linalg.eigvalsh(np.einsum("kdi,kdj->kij", gradient, gradient))
    return np.asarray(np.sqrt(values[:, ::-1].T))


def _slopes(xi: FloatArray, eta: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Derivatives (k, nodes) of the shape functions by xi and eta at one point each."""
    value_xi, slope_xi = lagrange(xi, order)
    value_eta, slope_eta = lagrange(eta, order)
    by_xi = np.einsum("ki,kj->kij", value_eta, slope_xi).reshape(len(xi), -1)
    by_eta = np.einsum("ki,kj->kij", slope_eta, value_xi).reshape(len(xi), -1)
    return by_xi, by_eta
