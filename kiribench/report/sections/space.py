"""The flexed skin with the patch on it: a picture, and a view that turns on request."""

from __future__ import annotations

import numpy as np

from kiribench.conformability.result import Conformability
from kiribench.report.figures.surface_view import surface_view
from kiribench.report.html import Html, tag
from kiribench.report.subject import SubjectReport
from kiribench.report.svg import figure_block
from kiribench.report.view_mesh import decimate, front_view
from kiribench.report.viewer import Viewer, viewer
from kiribench.report.words import overlap_words
from kiribench.surface.mesh import Mesh

PICTURE_FACES = 12_000
#: The outlines are lifted so much towards the outside that the coarser skin does not hide them.
LIFT_MM = 1.0


def space_section(
    subject: SubjectReport, score: Conformability, surface: Mesh
) -> tuple[Html, Viewer] | None:
    """The section and the packed view; None where no cell was scored."""
    scored = score.scored
    if not scored.any():
        return None
    centres = np.where(scored[..., None], score.skin_outline_3d_mm.mean(axis=2), np.nan)
    frame = front_view(surface, centres)
    vertices, faces = decimate(surface, PICTURE_FACES)
    vertices = frame.turn(vertices)
    skin, patch = frame.turn(score.skin_outline_3d_mm), frame.turn(score.patch_outline_3d_mm)
    grades = np.where(scored, score.grade, "")
    picture = surface_view(
        vertices,
        faces,
        skin,
        patch,
        grades,
        alt=f"The flexed skin of {subject.participant} from the front with the patch cells, "
        "coloured and lettered by grade. The cell map above shows the same grades.",
    )
    view = viewer(
        vertices,
        faces,
        lifted(skin, LIFT_MM),
        lifted(patch, 2 * LIFT_MM),
        grades,
        _hover(score),
    )
    section = tag(
        "section",
        tag("h2", "On the body"),
        tag(
            "div",
            figure_block(
                picture,
                "The bare flexed scan from the front, proximal up. Filled: patch cells, projected "
                "onto the skin, by grade. Thin lines: the cells drawn on the skin that they should "
                "cover. The skin is simplified for the picture; all numbers come from the full "
                "scan. Cells that are seen edge-on are left out.",
            ),
            tag("div", view.html),
            class_="pair",
        ),
        id="space",
    )
    return section, view


def _hover(score: Conformability) -> list[list[str]]:
    rows, columns = score.shape
    return [
        [
            f"row {r}, column {c}: {score.grade[r, c]}, "
            + overlap_words(float(score.overlap[r, c]))
            for c in range(columns)
        ]
        for r in range(rows)
    ]


def lifted(outlines: np.ndarray, by_mm: float) -> np.ndarray:
    """Outlines moved along their own normals, towards the viewer's side.

    Args:
        outlines: (R, C, n, 3), mm; NaN stays NaN.
        by_mm: how far.
    """
    about = outlines - outlines.mean(axis=2, keepdims=True)
    normal = np.cross(about, np.roll(about, -1, axis=2)).sum(axis=2, keepdims=True)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    # All outlines run the same way round; most of the patch faces the viewer.
    sense = np.sign(np.nansum(normal[..., 2]))
    return np.asarray(outlines + sense * by_mm * normal / length)
