"""One synthetic subject in memory: smooth surfaces, scans, nodes and the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import UsageError
from kiribench.schema.layout import Layout
from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.knees import STORED, Knee
from kiribench.synthetic.overlap_truth import OverlapTruth, overlap_truth
from kiribench.synthetic.smooth import SmoothSurface
from kiribench.synthetic.strain_truth import StrainTruth, strain_truth
from kiribench.synthetic.tessellate import Tessellation, tessellate
from kiribench.synthetic.worn import Motion, PatchRelief, random_motion

MARGIN_MM = 26.0
"""Skin scanned around the drawn grid."""

REST_COARSENESS = 2.0
"""The scan at rest, which is less curved, has edges so many times as long."""

FINE_BESIDE_MM = 6.0
FINE_LENGTH = 0.45
"""Scans are finest over the patch's width and so much more, and over this share of its
length: over the bend, where the skin is most curved."""

LONGITUDINAL_FINENESS = 1.25
LATERAL_FINENESS = 1.15
"""The bent skin is stretched: its scan's points are closer in material mm by these."""


@dataclass(frozen=True)
class Imperfections:
    """What real scans have and the default ones have not.

    Attributes:
        edge_mm: length of the bent scans' triangle edges about the patella; elsewhere they grow
            to 1.8 times that, and at 0 degrees they are 2 times as long.
        noise_mm: standard deviation of the scans' vertices along the normal, white.
        node_noise_mm: standard deviation of the nodes along each surface direction.
        node_sd_mm: what the tables state as that, where node_noise_mm is 0.
        holes: holes in each scan, of 5 to 9 mm material radius.
        missing_nodes: nodes of each table that were not found.
        seed: of all random draws.
    """

    edge_mm: float = 2.22
    noise_mm: float = 0.0
    node_noise_mm: float = 0.0
    node_sd_mm: float = 0.1
    holes: int = 0
    missing_nodes: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "edge_mm": (0.2, 8.0),
            "noise_mm": (0.0, 2.0),
            "node_noise_mm": (0.0, 3.0),
            "node_sd_mm": (0.0, 3.0),
            "holes": (0, 50),
            "missing_nodes": (0, 60),
            "seed": (0, 2**63 - 1),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise UsageError(
                    "synth-option",
                    f"The option {name} is out of range.",
                    got=value,
                    expected=f"{low} to {high}",
                    remedy="Choose a value in the range.",
                )


@dataclass(frozen=True, eq=False)
class Scan:
    """A triangulated scan.

    Attributes:
        vertices_mm: (n, 3) float64 in the scan's own frame.
        faces: (m, 3) int32, counter-clockwise seen from outside.
        q: (n, 2) float64 material coordinates (u, v) mm of the vertices.
        noise_mm: (n,) float64 displacement along the normal that is noise.
    """

    vertices_mm: FloatArray
    faces: NDArray[np.int32]
    q: FloatArray
    noise_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes of one acquisition.

    Attributes:
        xyz_mm: (R + 1, C + 1, 3) positions in the scan's frame.
        q: (R + 1, C + 1, 2) true material coordinates mm, without the node noise.
        sd_mm: standard deviation along each surface direction, as the table states it.
        missing: (R + 1, C + 1) True where the node was not found.
    """

    xyz_mm: FloatArray
    q: FloatArray
    sd_mm: float
    missing: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class SyntheticSubject:
    """A subject with everything that is known about it.

    Attributes:
        knee: the parameters that it was made from.
        layout: grid and patch.
        half_extent_mm: half sizes in u and v of the scanned skin, material mm.
        reference, flexed: the smooth skin at 0 and at 90 degrees.
        scans: by acquisition, flex000, flex090 and flex090worn.
        nodes: by acquisition.
        patch_relief: how the patch lies on the skin.
        worn_motion: takes the frame of flex090 to that of flex090worn.
        strain: truth of the grid's cells.
        overlap: truth of the patch's cells.
    """

    knee: Knee
    layout: Layout
    imperfections: Imperfections
    half_extent_mm: tuple[float, float]
    reference: SmoothSurface
    flexed: SmoothSurface
    scans: Mapping[str, Scan] = field(repr=False)
    nodes: Mapping[str, Nodes] = field(repr=False)
    patch_relief: PatchRelief = field(repr=False)
    worn_motion: Motion = field(repr=False)
    strain: StrainTruth = field(repr=False)
    overlap: OverlapTruth = field(repr=False)


def grid_nodes(layout: Layout) -> FloatArray:
    """(R + 1, C + 1, 2) material coordinates (u, v) mm of the drawn nodes, centred."""
    grid = layout.grid
    u = (np.arange(grid.columns + 1) - 0.5 * grid.columns) * grid.pitch_mm
    v = (np.arange(grid.rows + 1) - 0.5 * grid.rows) * grid.pitch_mm
    return np.stack(np.meshgrid(u, v), axis=-1)


def patch_nodes(layout: Layout) -> FloatArray:
    """(R + 1, C + 1, 2) material coordinates mm of the skin nodes under the patch."""
    row, column = layout.patch_offset
    nodes = grid_nodes(layout)
    return nodes[row : row + layout.patch.rows + 1, column : column + layout.patch.columns + 1]


def subject(
    knee: Knee | str,
    *,
    layout: Layout | None = None,
    imperfections: Imperfections | None = None,
) -> SyntheticSubject:
    """Make a subject: scans, nodes and truth.

    Args:
        knee: its parameters, or the label of a stored one (S1, S2, S3).
        layout: grid and patch; the knee's by default.
        imperfections: resolution, noise, holes and the seed.

    Raises:
        UsageError: ``synth-unknown-subject``; use S1, S2 or S3, or pass a Knee.
    """
    if isinstance(knee, str):
        if knee not in STORED:
            raise UsageError(
                "synth-unknown-subject",
                "There is no stored synthetic subject of that name.",
                got=knee,
                expected=", ".join(STORED),
                remedy="Choose one of these, or ask for random subjects.",
            )
        knee = STORED[knee]
    layout = layout or Layout.of()
    flaws = imperfections or Imperfections()
    rng = np.random.default_rng([flaws.seed, *knee.label.encode()])
    reference, flexed = knee.build.reference(), knee.build.flexed()
    grid, under = grid_nodes(layout), patch_nodes(layout)
    extent = (float(grid[0, -1, 0]) + MARGIN_MM, float(grid[-1, 0, 1]) + MARGIN_MM)
    relief = PatchRelief.of(knee.mismatch, under, layout.patch.thickness_mm)
    corners = relief.on_skin(under)
    motion = random_motion(rng)

    edge, rest_edge = flaws.edge_mm, REST_COARSENESS * flaws.edge_mm
    half_u, half_v = relief.half_mm
    fine = (float(half_u) + FINE_BESIDE_MM, FINE_LENGTH * float(half_v))
    rest_step = (rest_edge, rest_edge * np.sqrt(0.75))
    bent_step = (edge / LATERAL_FINENESS, edge / LONGITUDINAL_FINENESS)
    flatter = (bent_step[0] * np.sqrt(0.75), bent_step[1])
    worn_step = (bent_step[0], bent_step[1] * np.sqrt(0.75))
    plain = tessellate(extent, fine, rest_step, rng)
    bent = tessellate(extent, fine, flatter, rng, rows_along_u=False)
    covered = tessellate(extent, fine, worn_step, rng)

    scans = {
        "flex000": _scan(reference, plain, None, flaws, rng),
        "flex090": _scan(flexed, bent, None, flaws, rng),
        "flex090worn": _moved(_scan(flexed, covered, relief, flaws, rng), motion),
    }
    worn = _nodes(flexed, corners, relief, flaws, rng)
    nodes = {
        "flex000": _nodes(reference, grid, None, flaws, rng),
        "flex090": _nodes(flexed, grid, None, flaws, rng),
        "flex090worn": Nodes(motion.apply(worn.xyz_mm), worn.q, worn.sd_mm, worn.missing),
    }
    return SyntheticSubject(
        knee=knee,
        layout=layout,
        imperfections=flaws,
        half_extent_mm=extent,
        reference=reference,
        flexed=flexed,
        scans=scans,
        nodes=nodes,
        patch_relief=relief,
        worn_motion=motion,
        strain=strain_truth(reference, flexed, grid),
        overlap=overlap_truth(flexed, under, corners),
    )


def _scan(
    surface: SmoothSurface,
    tessellation: Tessellation,
    relief: PatchRelief | None,
    flaws: Imperfections,
    rng: np.random.Generator,
) -> Scan:
    q, faces = tessellation.q, tessellation.faces
    noise = flaws.noise_mm * rng.standard_normal(len(q))
    height = noise if relief is None else noise + relief.height_mm(q)
    vertices = surface.points_mm(q) + height[:, None] * surface.normals(q)
    if surface.outward < 0:
        faces = faces[:, ::-1].copy()
    if flaws.holes:
        centroid = q[faces].mean(axis=1)
        extent = np.abs(q).max(axis=0)
        centres = rng.uniform(-0.85, 0.85, (flaws.holes, 2)) * extent
        radii = rng.uniform(5.0, 9.0, flaws.holes)
        distance = np.linalg.norm(centroid[:, None] - centres, axis=2)
        faces = faces[(distance > radii).all(axis=1)]
        used = np.unique(faces)
        faces = np.searchsorted(used, faces).astype(np.int32)
        vertices, q, noise = vertices[used], q[used], noise[used]
    return Scan(vertices, faces, q, noise)


def _moved(scan: Scan, motion: Motion) -> Scan:
    return Scan(motion.apply(scan.vertices_mm), scan.faces, scan.q, scan.noise_mm)


def _nodes(
    surface: SmoothSurface,
    q: FloatArray,
    relief: PatchRelief | None,
    flaws: Imperfections,
    rng: np.random.Generator,
) -> Nodes:
    """The nodes at q, moved by the noise within the surface (to first order in the noise)."""
    x_u, x_v = surface.tangents(q)
    first = x_u / np.linalg.norm(x_u, axis=-1, keepdims=True)
    second = np.cross(surface.normals(q), first)
    draw = flaws.node_noise_mm * rng.standard_normal((*q.shape[:-1], 2))
    step = draw[..., :1] * first + draw[..., 1:] * second
    basis = np.stack([x_u, x_v], axis=-2)
    moved = q + np.einsum(
        "...ij,...j->...i", np.linalg.inv(surface.metric(q)), np.einsum("...ix,...x", basis, step)
    )
    xyz = surface.points_mm(moved)
    if relief is not None:
        xyz = xyz + relief.thickness_mm * surface.normals(moved)
    missing = np.zeros(q.shape[:-1], dtype=bool)
    if flaws.missing_nodes:
        lost = rng.choice(missing.size, size=min(flaws.missing_nodes, missing.size), replace=False)
        missing.ravel()[lost] = True
    return Nodes(xyz, q, flaws.node_noise_mm or flaws.node_sd_mm, missing)
