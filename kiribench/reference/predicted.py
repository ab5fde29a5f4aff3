"""Where a patch is predicted to lie, scored as a worn one would be.

The patch's corners are computed on the bare flexed scan itself: there is no worn scan and
nothing to register, the rest is the code of ``conform`` (outlines with geodesic sides, log map,
three definitions, causes, intervals). The intervals hold the uncertainty of the skin's nodes
only: nothing in them says how far the model is from a patch that is worn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.outlines import PIECES, FlatOutlines, flat_outlines
from kiribench.conformability.result import Conformability, FrameReport
from kiribench.conformability.score import ScoreOptions, missing_reasons, score_outlines
from kiribench.design.skin import Skin
from kiribench.errors import NodesError
from kiribench.strain.gradient import signed_area
from kiribench.surface.locate import locate
from kiribench.surface.mesh import SurfacePoints
from kiribench.surface.nodes import LocatedNodes

FloatArray = NDArray[np.float64]

#: A spline through nodes 15 mm apart leaves the scan by some tenths of a millimetre; a corner
#: farther away lies beyond the scan's border or over a hole.
OFF_SKIN_MM = 3.0

PREDICTED = FrameReport("predicted", 0.0, 0.0, None, None, 0, 0.0, 0.0, 0)


def predicted_conformability(
    skin: Skin, corner_mm: FloatArray, options: ScoreOptions | None = None
) -> Conformability:
    """Score a patch whose corners lie at given places on the skin.

    Args:
        skin: the bare flexed scan.
        corner_mm: (R+1, C+1, 3) corners of the patch's cells, in the frame of the scan; NaN
            where unknown.
        options: of the score; registration and denoising do not matter here.

    Raises:
        NodesError: ``predicted-no-cell``, where no cell has all its corners on the skin.
    """
    options = options or ScoreOptions()
    options.check()
    patch = corners_on_skin(skin, corner_mm)
    reason = missing_reasons(skin.under, patch, patch)
    if not (reason == "").any():
        raise NodesError(
            "predicted-no-cell",
            "No cell of the patch has all its corners on the scan.",
            remedy="Check the patch's offset in the grid, and that the scan reaches beyond it.",
        )
    return score_outlines(
        skin.participant,
        flat_outlines(skin.bare.mesh, skin.under, patch, skin.bare.topology),
        reason,
        skin.region,
        options,
        skin_sd_mm=skin.under.sd_mm,
        patch_sd_mm=np.zeros_like(skin.under.sd_mm),
        lift_off_mm=np.where(patch.present, 0.0, np.nan),
        frame=PREDICTED,
        draws_mm=None,
        cell_mm=skin.layout.patch.cell_mm,
        rng=np.random.default_rng(options.seed),
        notes=(*skin.bare.notes, *_filled_note(skin)),
        warnings=skin.bare.warnings,
    )


def _filled_note(skin: Skin) -> tuple[str, ...]:
    count = int(skin.filled.sum())
    if not count:
        return ()
    return (f"{count} missing nodes of the flexed grid were filled in for the map of the skin.",)


def corners_on_skin(skin: Skin, corner_mm: FloatArray) -> LocatedNodes:
    """The closest points of the scan to the corners; absent beyond ``OFF_SKIN_MM``."""
    known = np.isfinite(corner_mm).all(axis=-1)
    found = locate(skin.bare.mesh, corner_mm[known])
    near = np.asarray(found.distance_mm <= OFF_SKIN_MM)
    row, col = (axis[near] for axis in np.nonzero(known))
    points: SurfacePoints = found.points[near]
    index = np.full(known.shape, -1, dtype=np.int32)
    index[row, col] = np.arange(int(near.sum()), dtype=np.int32)
    offset = np.full(known.shape, np.nan)
    offset[row, col] = found.distance_mm[near]
    positions = np.full(corner_mm.shape, np.nan)
    positions[row, col] = points.positions_mm(skin.bare.mesh)
    return LocatedNodes(points, index, np.zeros(known.shape), offset, positions, "computed")


def flat_conformability(
    participant: str,
    skin_mm: FloatArray,
    patch_mm: FloatArray,
    region: NDArray[np.str_],
    *,
    cell_mm: float,
    options: ScoreOptions | None = None,
) -> Conformability:
    """Score a patch in a plane: straight sides, no uncertainty.

    Args:
        skin_mm, patch_mm: (R+1, C+1, 2) corners of skin and patch cells, x from lateral to
            medial, y from proximal to distal, mm.
        region: (R, C) labels. cell_mm: of the patch.
    """
    options = options or ScoreOptions(samples=100)
    options.check()
    nodes = np.zeros(skin_mm.shape[:2])
    outlines = plane_outlines(skin_mm, patch_mm)
    reason = np.where(np.isfinite(outlines.patch).all(axis=(-1, -2)), "", "patch-node-missing")
    return score_outlines(
        participant,
        outlines,
        reason.astype("<U32"),
        region,
        options,
        skin_sd_mm=nodes,
        patch_sd_mm=nodes,
        lift_off_mm=nodes,
        frame=PREDICTED,
        draws_mm=None,
        cell_mm=cell_mm,
        rng=np.random.default_rng(options.seed),
    )


def plane_outlines(skin_mm: FloatArray, patch_mm: FloatArray) -> FlatOutlines:
    """Outlines of cells in a plane; arguments as in :func:`flat_conformability`."""
    outlines, spatial = [], []
    for nodes in (skin_mm, patch_mm):
        # Longitudinal first, as everywhere in the flat frames.
        corners = np.stack(
            [nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2
        )[..., ::-1]
        following = np.roll(corners, -1, axis=2)
        share = np.arange(PIECES)[:, None] / PIECES
        line = corners[:, :, :, None] * (1 - share) + following[:, :, :, None] * share
        outline = line.reshape(*corners.shape[:2], -1, 2)
        outlines.append(outline)
        space = np.zeros((*outline.shape[:-1], 3))
        space[..., 0], space[..., 1] = outline[..., 1], -outline[..., 0]
        spatial.append(space)
    centre = outlines[0][:, :, ::PIECES].mean(axis=2, keepdims=True)
    flat = [outline - centre for outline in outlines]
    areas = [signed_area(outline[:, :, ::PIECES]) for outline in flat]
    shape = areas[0].shape
    axes = np.zeros((*shape, 2, 3))
    axes[..., 0, 1], axes[..., 1, 0] = -1.0, 1.0
    return FlatOutlines(
        skin=flat[0],
        patch=flat[1],
        skin_3d=spatial[0],
        patch_3d=spatial[1],
        axes=axes,
        curvature=np.zeros(shape),
        turned=(areas[0] <= 0) | (areas[1] <= 0),
        around_hole=np.zeros(shape, dtype=bool),
    )
