"""One self-contained HTML file of checked designs: verdict, grades, body, errors, placement."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.result import DEFINITIONS
from kiribench.fem.wear_measures import BREAKING_STRETCH
from kiribench.lattice import CutMap
from kiribench.reference.check import CheckedDesign, FlatGround, KneeGround
from kiribench.reference.export import check_object
from kiribench.reference.placement import DIRECTIONS, Placement, placement_text
from kiribench.report.check_words import DRAWN_NOTE, PREDICTED_NOTE, check_verdict
from kiribench.report.figures.check_course import course_figure
from kiribench.report.figures.definitions import definition_map
from kiribench.report.figures.grades import grade_map
from kiribench.report.figures.heatmap import heatmap, scale_limit
from kiribench.report.figures.surface_view import surface_view
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.sections.space import LIFT_MM, PICTURE_FACES, lifted
from kiribench.report.svg import figure_block
from kiribench.report.verdict import SYNTHETIC_NOTE
from kiribench.report.view_mesh import decimate, front_view
from kiribench.report.viewer import Viewer, viewer
from kiribench.report.words import count, number, overlap_words, percent

FloatArray = NDArray[np.float64]


def write_check_page(
    path: Path,
    checked: Sequence[CheckedDesign],
    tolerances: Sequence[Placement | None],
    *,
    synthetic: bool = False,
    drawn: bool = False,
) -> Path:
    """Write the page.

    Args:
        path: the HTML file.
        checked: designs of one patch on one ground; the first is shown in full.
        tolerances: one a design, or None.
        synthetic: the skin is computed, and the page says so first.
        drawn: it has a worn scan whose misfit was drawn; the page says why none is compared.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    page = check_page(checked, tolerances, synthetic=synthetic, drawn=drawn)
    path.write_text(page, encoding="utf-8", newline="\n")
    return path


def check_page(
    checked: Sequence[CheckedDesign],
    tolerances: Sequence[Placement | None],
    *,
    synthetic: bool = False,
    drawn: bool = False,
) -> str:
    """The whole HTML document; the same designs give the same text."""
    first = checked[0]
    space = _space(first)
    sections: list[Html | None] = [
        _methods(checked),
        _cells(first),
        space[0] if space else None,
        _errors(first),
        _placement(checked, tolerances),
        _course(checked),
        _record(first, drawn),
    ]
    body = text([_head(checked, synthetic), tag("main", [one for one in sections if one])])
    who = first.design.participant or "a patch"
    return document(
        f"{who}: predicted conformability",
        body,
        payload=space[1].payload if space else None,
        script_hashes=space[1].script_hashes if space else (),
    )


def _mirrored(checked: CheckedDesign) -> bool:
    return checked.design.side == "left"


def _head(checked: Sequence[CheckedDesign], synthetic: bool) -> Html:
    first = checked[0]
    where = "worn on the flexed skin" if first.ground.kind == "worn" else "in the plane"
    return tag(
        "header",
        tag("p", "kiribench · check of a design", class_="kicker"),
        tag("h1", f"{first.design.participant or 'Patch'} ", tag("span", where, class_="quiet")),
        tag("p", PREDICTED_NOTE, class_="flag"),
        tag("p", SYNTHETIC_NOTE, class_="flag") if synthetic else None,
        tag("p", check_verdict(checked, note=False), class_="verdict"),
    )


def _grades(checked: CheckedDesign) -> list[list[str | None]]:
    return [[str(grade) or None for grade in row] for row in checked.conformability.grade]


def _methods(checked: Sequence[CheckedDesign]) -> Html:
    rows, maps = [], []
    for index, one in enumerate(checked):
        content = check_object(one)
        share = content["share"]
        rows.append(
            [
                one.design.method,
                *(
                    percent(share[name][key])
                    for name in DEFINITIONS[:2]
                    for key in ("fair", "good")
                ),
                *(number(share[name]["mean"], 3) for name in DEFINITIONS),
                number(content["mesh"]["largest_overlap_error"], 3),
            ]
        )
        score = one.conformability
        maps.append(
            figure_block(
                definition_map(
                    _grades(one),
                    np.zeros(score.shape, dtype=bool),
                    mirrored=_mirrored(one),
                    name=f"method-{index}",
                    alt=f"Grades of {one.design.method}: {score.whole.good} good, "
                    f"{score.whole.fair} fair, {score.whole.poor} poor.",
                ),
                [
                    tag("strong", f"{one.design.method}: "),
                    f"{score.whole.good} good, {score.whole.fair} fair, {score.whole.poor} poor.",
                ],
            )
        )
    head = ("Design", "Fair, paper", "Good, paper", "Fair, strict", "Good, strict", "Mean, paper",
            "Mean, strict", "Mean, iou", "Mesh error")  # fmt: skip
    return tag(
        "section",
        tag("h2", "Designs side by side"),
        table(
            head,
            rows,
            caption="Share of cells that are at least fair (overlap 75 % or more) and good (90 % "
            "or more) by two definitions, mean overlaps, and the largest error of an overlap by "
            "the mesh.",
            numeric=tuple(range(1, len(head))),
        ),
        tag("div", maps, class_="triple"),
        id="designs",
    )


def _cells(first: CheckedDesign) -> Html:
    score = first.conformability
    drawing = grade_map(
        _grades(first),
        score.overlap,
        [[str(label) for label in row] for row in first.design.region],
        score.definition_matters,
        mirrored=_mirrored(first),
        alt=f"Predicted grades of {first.design.method}: {score.whole.good} good, "
        f"{score.whole.fair} fair, {score.whole.poor} poor.",
    )
    mesh = heatmap(
        first.mesh_overlap,
        limit=scale_limit(first.mesh_overlap),
        label="error of the overlap by the mesh",
        mirrored=_mirrored(first),
        name="mesh-error",
        alt="Estimated error of every cell's overlap by the mesh.",
    )
    content = check_object(first)
    lifted_share = content["lift_off_share"]
    contested = count(int(score.definition_matters.sum()), "cell")
    notes = [
        f"Graded by '{score.grade_by}'; the grade of {contested} depends on the definition "
        "(corner mark).",
        f"{percent(lifted_share)} of the facets would lift off: the skin would have to hold them."
        if lifted_share
        else "No facet lifts off.",
        f"Largest stretch before a cut tip {number(content['largest_tip_stretch'])}; the rubber "
        f"broke at {number(BREAKING_STRETCH, 1)} in a tension test.",
    ]
    if first.worn.face_overlap_mm > 0.1:
        notes.append(
            f"Cut faces pass through each other by {number(first.worn.face_overlap_mm)} mm: "
            "contact of the faces is not modelled."
        )
    ground = first.ground
    if isinstance(ground, FlatGround) and ground.flat is not None:
        notes.append(
            "The skin does not lie flat: its cells' edges had to change by "
            f"{percent(ground.flat.strain_rms)} (rms). The flat check cannot show that part."
        )
    return tag(
        "section",
        tag("h2", f"Cells of {first.design.method}"),
        tag(
            "div",
            figure_block(drawing, "Predicted grade and overlap of every cell."),
            figure_block(
                mesh,
                "What the mesh adds, from two meshes. A grade closer than this to its limit is "
                "not decided.",
            ),
            class_="pair",
        ),
        bullets(notes),
        id="cells",
    )


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


def _space(first: CheckedDesign) -> tuple[Html, Viewer] | None:
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


def _errors(first: CheckedDesign) -> Html:
    measure = first.design.strain_measure
    parts = [
        ("strain-error", first.strain_error, f"longitudinal strain ({measure}), minus target"),
        ("poisson-error", first.poisson_error, f"Poisson's ratio ({measure}), minus target"),
        ("shear", first.worn.shear, "shear of the patch cell"),
    ]
    blocks = []
    for name, values, label in parts:
        if not np.isfinite(values).any():
            continue
        blocks.append(
            figure_block(
                heatmap(
                    values,
                    limit=scale_limit(values, ceiling=1.0),
                    label=label,
                    mirrored=_mirrored(first),
                    name=name,
                    alt=f"Map of the {label}.",
                ),
                f"{label[:1].upper()}{label[1:]}.",
            )
        )
    source = (
        "the design's own targets"
        if first.target_source == "design"
        else "what the skin does, because the design table has no targets"
    )
    return tag(
        "section",
        tag("h2", "Strain against its target"),
        tag(
            "p",
            f"Of {first.design.method}, as simulated, against {source}. A patch whose corners lie "
            "on their nodes has no error here but that of the target itself.",
        ),
        tag("div", blocks, class_="triple"),
        id="errors",
    )


def _placement(
    checked: Sequence[CheckedDesign], tolerances: Sequence[Placement | None]
) -> Html | None:
    rows = []
    for one, tolerance in zip(checked, tolerances, strict=True):
        if tolerance is None:
            continue
        for grade in ("good", "fair"):
            cells = []
            for limit in tolerance.tolerances:
                beyond = "> " if getattr(limit, f"{grade}_open") else ""
                cells.append(f"{beyond}{number(getattr(limit, grade), 1)}")
            rows.append([f"{one.design.method}, {grade}", *cells])
    known = next((one for one in tolerances if one is not None), None)
    if known is None:
        return None
    units = {one.direction: one.unit.replace("deg", "°") for one in known.tolerances}
    head = (
        "Design and grade",
        *(f"{name.replace('_', ' ')}, {units[name]}" for name in DIRECTIONS),
    )
    return tag(
        "section",
        tag("h2", "How exactly it has to be put on"),
        tag("p", placement_text(known)),
        table(
            head,
            rows,
            caption=f"Largest error in each direction at which {percent(known.share, 0)} of the "
            f"cells still have the grade by '{known.definition}'; 0 where they have not even "
            "without one. Offsets in mm on the skin as drawn; strap slip: the distal strap slides "
            "back.",
            numeric=tuple(range(1, len(head))),
        ),
        id="placement",
    )


def _course(checked: Sequence[CheckedDesign]) -> Html | None:
    courses = [
        (one.design.method, one.design.settings["MethodSettings"]["Iterations"])
        for one in checked
        if isinstance(one.design.settings.get("MethodSettings"), dict)
        and isinstance(one.design.settings["MethodSettings"].get("Iterations"), list)
    ]
    if not courses:
        return None
    return tag(
        "section",
        tag("h2", "Course of the design"),
        [
            figure_block(
                course_figure(iterations, name=f"course-{index}", method=method),
                f"'{method}': distance of the corners from their nodes, step by step. A new mesh "
                "starts anew; steps are compared on one mesh only.",
            )
            for index, (method, iterations) in enumerate(courses)
        ],
        id="course",
    )


def _record(first: CheckedDesign, drawn: bool) -> Html:
    options = first.options
    friction = "full stick" if np.isinf(options.spec.friction) else f"{options.spec.friction:g}"
    return tag(
        "section",
        tag("h2", "How it was computed"),
        bullets(
            [
                "A membrane of incompressible neo-Hookean rubber in plane stress, with every cut "
                "as a slit, free to slide on a smooth map of the skin through the scanned nodes.",
                f"Friction {friction}; straps '{options.spec.straps}'; "
                f"{options.elements} elements a facet edge, "
                + (
                    f"judged against {options.coarser}."
                    if first.coarse is not None
                    else "the coarsest mesh there is."
                ),
                "Overlaps by the code that scores a worn scan; no registration, the corners were "
                "computed on the bare scan. Intervals hold the uncertainty of the skin's nodes.",
                "Not in it: bending, contact of the cut faces, thickness, viscosity, a skin that "
                "gives way, and everything that a person does while putting it on.",
                *([DRAWN_NOTE] if drawn else []),
            ]
        ),
        id="record",
    )
