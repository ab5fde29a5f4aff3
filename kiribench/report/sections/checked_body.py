"""The checked patch on the body: a picture, and the turning view with its cuts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.lattice import CutMap
from kiribench.reference.check import CheckedDesign
from kiribench.reference.ground import KneeGround
from kiribench.report.figures.surface_view import surface_view
from kiribench.report.html import Html, tag
from kiribench.report.sections.space import LIFT_MM, PICTURE_FACES, lifted
from kiribench.report.svg import figure_block
from kiribench.report.view_mesh import decimate, front_view
from kiribench.report.viewer import Viewer, viewer
from kiribench.report.words import overlap_words

FloatArray = NDArray[np.float64]


def body(first: CheckedDesign) -> tuple[Html, Viewer] | None:
    """Section and viewer; None in the plane, or where no cell was scored."""
    ground, score = first.ground, first.conformability
    if not isinstance(ground, KneeGround) or not score.scored.any():
        return None
    surface = ground.skin.bare.mesh
    centres = np.where(score.scored[..., None], score.skin_outline_3d_mm.mean(axis=2), np.nan)
    frame = front_view(surface, centres)
    vertices, faces = decimate(surface, PICTURE_FACES)
    vertices = frame.turn(vertices)
    skin, patch = frame.turn(score.skin_outline_3d_mm), frame.turn(score.patch_outline_3d_mm)
    grades = np.where(score.scored, score.grade, "")
    picture = surface_view(
        vertices, faces, skin, patch, grades,
        alt="The flexed skin with the predicted patch cells, coloured and lettered by grade.",
    )  # fmt: skip
    rows, columns = score.shape
    hover = [
        [
            f"row {r}, column {c}: {score.grade[r, c]}, "
            + overlap_words(float(score.overlap[r, c]))
            for c in range(columns)
        ]
        for r in range(rows)
    ]
    view = viewer(
        vertices, faces, lifted(skin, LIFT_MM), lifted(patch, 2 * LIFT_MM), grades, hover,
        slits_mm=_raised(frame.turn(slit_ends(first)), 2.5 * LIFT_MM, patch),
    )  # fmt: skip
    section = tag(
        "section",
        tag("h2", "On the body"),
        tag(
            "div",
            figure_block(
                picture,
                f"The bare flexed scan with the predicted cells of {first.design.method}, from "
                "the front. Filled: patch cells by grade. Thin lines: the skin cells that they "
                "should cover.",
            ),
            tag("div", view.html, tag("p", "The turning view also shows the cuts, drawn closed.",
                                      class_="quiet")),
            class_="pair",
        ),
        id="space",
    )  # fmt: skip
    return section, view


def slit_ends(checked: CheckedDesign) -> FloatArray:
    """(k, 2, 3) both ends of every half-cut on the surface, drawn closed, mm.

    A tip lies on the line between its site and the next one, at the half-cut's share of it.
    """
    design = checked.design
    cuts = CutMap(design.a, design.b, design.cell_mm).half_cuts()
    site = checked.worn.site_mm
    p, q = cuts.site[:, 0], cuts.site[:, 1]
    step = np.rint(cuts.direction).astype(np.int64)
    start, onward = site[q, p], site[q + step[:, 1], p + step[:, 0]]
    share = (cuts.length_mm / (design.cell_mm / 2))[:, None]
    return np.stack([start, start + share * (onward - start)], axis=1)


def _raised(ends: FloatArray, by_mm: float, patch: FloatArray) -> FloatArray:
    """Ends of cuts moved away from the body along the normal of the nearest patch cell."""
    cells = patch[np.isfinite(patch).all(axis=(2, 3))]
    centre = cells.mean(axis=1)
    about = cells - centre[:, None]
    normal = np.cross(about, np.roll(about, -1, axis=1)).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(normal[:, 2].sum())
    middle = ends.mean(axis=1)
    nearest = np.linalg.norm(middle[:, None] - centre[None], axis=2).argmin(axis=1)
    return np.asarray(ends + by_mm * normal[nearest][:, None])
