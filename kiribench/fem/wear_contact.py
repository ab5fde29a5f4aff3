"""Contact of a worn patch: with the skin, facet by facet, and of crack faces with each other.

Neither is enforced by the model. The skin holds the patch by whatever normal force it takes, so a
hollow, or rubber that is compressed across a convex skin, pulls on it; the faces of a cut may
pass through each other. Both are measured here, so that they can be stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.gauge import deepest_overlap
from kiribench.fem.surface_map import SurfaceJet
from kiribench.fem.wear_mesh import PatchMesh, physical_edge

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

DENSITY_KG_M3 = 1080.0
"""Of Dragon Skin 20 (specific gravity 1.08, Smooth-On technical bulletin)."""


def weight_mpa(thickness_mm: float) -> float:
    """Weight of the sheet per area, MPa: a pull below it is less than what gravity does."""
    return DENSITY_KG_M3 * 9.81 * thickness_mm * 1e-9


@dataclass(frozen=True, eq=False)
class FacetContact:
    """Contact with the skin by facet, (2R, 2C) each.

    Attributes:
        pressure_mpa: outward force of the skin / deformed area; negative where it would pull.
        area_mm2: deformed.
    """

    pressure_mpa: FloatArray
    area_mm2: FloatArray


def facet_contact(
    mesh: PatchMesh, jet: SurfaceJet, force: FloatArray, outward: float, thickness_mm: float
) -> FacetContact:
    """Contact from the nodal forces (U, 3): the force of a node goes to its facets in equal
    parts."""
    normal = np.einsum("na,na->n", force, jet.normal(outward))
    share = normal / np.bincount(mesh.nodes.ravel())
    template = mesh.template
    x = jet.x[mesh.nodes][:, template.elements]
    tangents = np.einsum("fmad,qar->fmqrd", x, template.shapes, optimize=True)
    area = np.linalg.norm(np.cross(tangents[..., 0, :], tangents[..., 1, :]), axis=-1)
    total = np.einsum("fmq,q->f", area, template.weights)
    pressure = thickness_mm * share[mesh.nodes].sum(axis=1) / total
    return FacetContact(pressure.reshape(mesh.shape), total.reshape(mesh.shape))


def face_overlap(mesh: PatchMesh, jet: SurfaceJet) -> FloatArray:
    """(2R, 2C) largest depth, mm, to which a crack face of a facet and the opposite face pass
    through each other.

    Both faces of a half-cut are laid into the skin's tangent plane at its tip.
    """
    rows, columns = mesh.shape
    template = mesh.template
    facet = np.arange(rows * columns).reshape(rows, columns)
    walk = slice(0, template.cut_nodes + 1)
    depth = np.zeros(rows * columns)
    for one, two, edge, opposite in (
        (facet[:, :-1].ravel(), facet[:, 1:].ravel(), 1, 3),
        (facet[:-1].ravel(), facet[1:].ravel(), 2, 0),
    ):
        for turned in (False, True):
            chosen = mesh.mirrored[one] == turned
            mine, theirs = physical_edge(edge, turned), physical_edge(opposite, not turned)
            here, there = one[chosen], two[chosen]
            cut = mesh.half_cuts[here, mine] > 0
            here, there = here[cut], there[cut]
            left = mesh.nodes[here][:, template.edges[mine, walk]]
            right = mesh.nodes[there][:, template.edges[theirs, walk]]
            if turned:
                left, right = right, left
            found = _overlap_of(jet, left, right)
            for side in (here, there):
                depth[side] = np.maximum(depth[side], found)
    return depth.reshape(mesh.shape)


def _overlap_of(jet: SurfaceJet, left: IntArray, right: IntArray) -> FloatArray:
    """(f,) depths over faces (f, k) of nodes from site to tip, in tangent planes at the tips."""
    tip = left[:, -1]
    u = jet.first[tip, 0] / np.linalg.norm(jet.first[tip, 0], axis=1, keepdims=True)
    v = jet.first[tip, 1] - np.einsum("fd,fd->f", jet.first[tip, 1], u)[:, None] * u
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    frame = np.stack([u, v], axis=1)
    both = np.stack([left, right])
    flat = np.einsum("fid,sfkd->sfki", frame, jet.x[both] - jet.x[tip][None, :, None])
    faces, count = left.shape
    return deepest_overlap(
        flat.reshape(-1, 2),
        np.arange(faces * count),
        faces * count + np.arange(faces * count),
        count * np.arange(faces + 1),
        count * np.arange(faces + 1),
    )
