"""One self-contained HTML file of a designed patch: targets, cuts, search, mistakes avoided."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.design.cells import Cells, cells_of
from kiribench.design.mixing import mixed_up
from kiribench.design.reachable import axis, reachable
from kiribench.design.response import KernelResponse
from kiribench.design.result import REASONS, Designed
from kiribench.design.summary import design_text
from kiribench.design.surrogates import Surrogates
from kiribench.lattice import CutMap
from kiribench.report.figures.design_cuts import cuts_drawing
from kiribench.report.figures.design_maps import MANY, cut_lengths, evenly, of_all, signed_map
from kiribench.report.figures.design_targets import (
    equivalent_figure,
    generations_figure,
    mixing_figure,
    targets_figure,
)
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.svg import figure_block
from kiribench.report.words import number

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

DRAWN = 20
"""Rows and columns of a larger patch whose cuts are drawn."""

CURVES = (0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9)
"""Cut lengths whose curves are drawn, fractions of the cell edge; each a with each b."""


def write_design_report(path: Path, result: Designed, surrogates: Surrogates) -> Path:
    """Write the page of a designed patch.

    Args:
        path: the HTML file.
        result: of :func:`kiribench.design.methods.design_patch`, with its curves.
        surrogates: that it was made with.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(design_page(result, surrogates), encoding="utf-8", newline="\n")
    return path


def design_page(result: Designed, surrogates: Surrogates) -> str:
    """The whole HTML document; the same input gives the same text."""
    cells = cells_of(result.problem, surrogates, result.limits, result.options)
    design = result.design
    mirrored = design.side == "left"
    sections = [
        _head(result),
        _targets(result, cells),
        _cuts(result, mirrored=mirrored),
        _errors(result, mirrored=mirrored),
        _equivalent(result, cells),
        _generations(result, cells),
        _mixing(cells),
        _table(result),
    ]
    who = f"subject {design.participant}" if design.participant else "patch"
    return document(f"kiribench: design of {who}", text([tag("main", sections)]))


def _head(result: Designed) -> Html:
    design = result.design
    lines = [line.strip() for line in design_text(result).splitlines()]
    title = f"Subject {design.participant}" if design.participant else "Patch"
    return tag(
        "header",
        tag("p", "Design", class_="kicker"),
        tag("h1", f"{title}: {design.shape[0]} × {design.shape[1]} cells, {design.method}"),
        tag("p", _sentence(lines[-1].removeprefix("Verdict: ")), class_="verdict"),
        bullets(_sentence(line) for line in lines[1:-1]),
    )


def _sentence(words: str) -> str:
    """With a capital, unless it begins with a name such as flex090."""
    first = words.split(" ", 1)[0].rstrip(":")
    return words if first[-1:].isdigit() else words[:1].upper() + words[1:]


def _targets(result: Designed, cells: Cells) -> Html:
    kept = cells.surrogates.poisson
    low, high = float(kept.low[2]), float(kept.high[2])
    strains = np.linspace(low, min(high, max(0.3, 1.2 * float(cells.strain.max()))), 41)
    lengths = [x for x in CURVES if x <= cells.high + 1e-9]
    response = KernelResponse.of(kept, strains)
    grid = response.on_grid(np.array(lengths), np.array(lengths))
    curves = [(strains, grid[:, i, j]) for i in range(len(lengths)) for j in range(len(lengths))]
    some = strains[::4]
    span = reachable(KernelResponse.of(kept, some), cells.high)
    beyond = result.design.quantity("distance").ravel()[cells.place] > 1e-6
    stars = evenly(len(cells), beyond)
    return tag(
        "section",
        tag("h2", "Targets among what cuts can do"),
        figure_block(
            targets_figure(
                curves,
                (some, span.low, span.high),
                cells.problem.longitudinal_strain.ravel()[cells.place][stars],
                cells.target[stars],
                beyond[stars],
                cells.surrogates.measure,
            ),
            f"A star is what one cell of skin does. Each line is one cut pattern ({len(curves)} "
            "of them), pulled; the shaded band is what any cuts within the limits can reach. "
            "Strains below or beyond the lines were not simulated."
            + of_all(len(stars), len(cells), "targets"),
        ),
    )


def _cuts(result: Designed, *, mirrored: bool) -> Html:
    design = result.design
    marked = design.reason != ""
    cut_map = CutMap(design.a, design.b, design.cell_mm)
    gap = cut_map.minimum_gap_mm
    large = marked.size > MANY
    shown = CutMap(design.a[:DRAWN, :DRAWN], design.b[:DRAWN, :DRAWN], design.cell_mm)
    part = " of the first rows and columns" if large else ""
    star = "" if large else " An asterisk: see the reasons."

    return tag(
        "section",
        tag("h2", "Cuts"),
        tag(
            "div",
            figure_block(
                cut_lengths(design.a, marked, "a", mirrored=mirrored),
                f"Cuts across the pull, percent of the cell edge.{star}",
            ),
            figure_block(
                cut_lengths(design.b, marked, "b", mirrored=mirrored), "Cuts along the pull."
            ),
            figure_block(
                cuts_drawing(shown if large else cut_map, mirrored=mirrored),
                f"The cuts{part} as half-cuts averaged between cells; the narrowest ligament is "
                f"{gap:.2f} mm before the kerf. kiribench export writes the files for the laser.",
            ),
            class_="triple",
        ),
    )


def _errors(result: Designed, *, mirrored: bool) -> Html:
    design = result.design
    letters = {
        (int(r), int(c)): str(design.reason[r, c])[:1].upper() or "?"
        for r, c in np.argwhere(~np.isfinite(result.error))
    }
    large = result.error.size > MANY
    blank = "White" if large else "Hatched"
    blocks = []
    largest = float(np.nanmax(np.abs(result.error)))
    if largest > result.options.tolerance + 1e-9 or letters:
        blocks.append(
            figure_block(
                signed_map(
                    result.error,
                    f"predicted minus target ν ({design.strain_measure})",
                    "Error of Poisson's ratio in every cell",
                    "map-error",
                    letters,
                    mirrored=mirrored,
                ),
                "By the surrogate's own prediction, each cell flat and for itself."
                + ("" if large else " Dashed: the smallest and the largest.")
                + (f" {blank}: no target, cuts filled in." if letters else ""),
            )
        )
    words = None
    if result.on_skin is not None:
        words = (
            "Neither is an aim of this method: it puts the corners of the worn patch on their "
            "nodes, where neighbours, straps and the curved skin act on every cell."
        )
    elif not blocks:
        words = (
            f"No cell misses its target Poisson's ratio by more than {largest:.4f}, by the "
            "surrogate's own prediction."
        )
        if np.char.startswith(design.reason, "strain-").any():
            words += " Where the target strain was not simulated, it is that of the nearest one."
    logs = np.log(np.where(result.nominal_stress_mpa > 0, result.nominal_stress_mpa, np.nan))
    known = np.isfinite(logs)
    if known.any():
        count = np.maximum(known.sum(axis=0), 1)
        uneven = logs - np.where(known, logs, 0.0).sum(axis=0) / count
        blocks.append(
            figure_block(
                signed_map(
                    uneven,
                    "ln force against the column's mean",
                    "Difference of force of cells in series",
                    "map-force",
                    letters,
                    mirrored=mirrored,
                ),
                (
                    "Nominal stress at the target strains, each cell flat and for itself."
                    if result.on_skin is not None
                    else "Cells of a column are in series and carry one force. A cell that is "
                    "stiffer at its target strain than its column (positive) will stretch less "
                    "than it should, a softer one more."
                )
                + ("" if large else " Dashed: the stiffest and the softest."),
            )
        )
    return tag(
        "section",
        tag("h2", "Errors and forces"),
        tag("p", words) if words else None,
        tag("div", blocks, class_="pair"),
    )


def _equivalent(result: Designed, cells: Cells) -> Html | None:
    if not result.curves:
        return None
    order = np.argsort(cells.target)
    chosen = list(dict.fromkeys(int(order[i]) for i in (0, len(order) // 2, len(order) - 1)))
    ticks = axis(cells.high)
    fields = cells.poisson.on_grid(ticks, ticks, np.array(chosen))
    shown = []
    for field, k in zip(fields, chosen, strict=True):
        row, column = divmod(int(cells.place[k]), result.problem.shape[1])
        curve = next(curve for curve in result.curves if curve.cell == (row, column))
        cuts = np.array([result.design.a[row, column], result.design.b[row, column]])
        nu, strain = number(cells.target[k], 3), f"{cells.strain[k]:.3f}"
        title = f"cell ({row}, {column}): ν {nu} at strain {strain}"
        shown.append((title, (ticks, field), curve.pieces, cuts))
    return tag(
        "section",
        tag("h2", "Equivalent designs"),
        figure_block(
            equivalent_figure(shown, cells.high),
            "Every point of a black line has the target's Poisson's ratio at its strain; the "
            f"star was chosen{_off_the_line(result)}. The dashed arc is as far from no cuts at "
            "all as the star. Blue: widens when pulled; brown: narrows. The three cells have the "
            "smallest, the middle and the largest target.",
        ),
    )


def _off_the_line(result: Designed) -> str:
    """Why a star need not lie on its line."""
    if result.on_skin is not None:
        return ", off the line, for the corners of the worn patch"
    if result.design.method == "uniform":
        return " for all cells together"
    if float(np.nanmax(np.abs(result.error))) > result.options.tolerance + 1e-9:
        return ", as near to it as the method and the limits allow"
    return ""


def _generations(result: Designed, cells: Cells) -> Html | None:
    course = result.generations
    if course is None:
        return None
    k = int(np.argsort(cells.target)[len(cells) // 2])
    ticks = axis(cells.high)
    field = cells.poisson.on_grid(ticks, ticks, np.array([k]))[0]
    columns = result.problem.shape[1]
    row, column = divmod(int(cells.place[k]), columns)
    lines = evenly(len(cells))
    return tag(
        "section",
        tag("h2", "Generations of CMA-ES"),
        figure_block(
            generations_figure(
                course.population[:, k],
                course.best[:, lines],
                (ticks, field),
                float(cells.target[k]),
                cells.high,
                f"cell ({row}, {column}), ν {number(cells.target[k], 3)}",
            ),
            "Left: what was tried in one cell; the line has its target's Poisson's ratio. Right: "
            f"the objective of {len(lines)} of {len(cells)} cells. They stopped after "
            f"{int(course.stopped.min())} to {int(course.stopped.max())} generations.",
        ),
    )


def _mixing(cells: Cells) -> Html:
    count = len(cells)
    if count > MANY:
        nu = np.full(cells.problem.poisson_ratio.size, np.nan)
        place = cells.place[evenly(count)]
        nu[place] = cells.problem.poisson_ratio.ravel()[place]
        problem = replace(cells.problem, poisson_ratio=nu.reshape(cells.problem.shape))
        cells = cells_of(problem, cells.surrogates, cells.limits, cells.options)
    mixed = mixed_up(cells)
    place = cells.place
    parts = [array.ravel()[place] for array in (mixed.right_a, mixed.right_b, mixed.a, mixed.b)]
    error, right = mixed.error.ravel()[place], mixed.right_error.ravel()[place]
    measure = cells.surrogates.measure
    moved = 100 * np.hypot(parts[2] - parts[0], parts[3] - parts[1])
    return tag(
        "section",
        tag("h2", "If strain measures were mixed"),
        figure_block(
            mixing_figure(
                (parts[0], parts[1]),
                (parts[2], parts[3]),
                cells.target,
                error,
                right,
                f"targets in {measure} strain read as {mixed.read_as}",
            ),
            f"The same targets, designed by the least cuts as if their numbers were "
            f"{mixed.read_as} strains: the cuts move by {np.median(moved):.1f} % of the cell edge "
            f"(median, {moved.max():.1f} % at most), and the true Poisson's ratio misses by "
            f"{np.sqrt(np.mean(error**2)):.3f} rms instead of {np.sqrt(np.mean(right**2)):.3f}. "
            "kiribench refuses to do this." + of_all(len(cells), count, "cells"),
        ),
    )


def _table(result: Designed) -> Html:
    design = result.design
    names = (
        "target_longitudinal_strain",
        "target_poisson_ratio",
        "predicted_poisson_ratio",
        "predicted_poisson_ratio_sd",
        "distance",
        "nominal_stress_mpa",
    )
    low, high = design.quantity("reachable_low"), design.quantity("reachable_high")
    rows = []
    shown = evenly(design.reason.size, design.reason.ravel() != "")
    for r, c in zip(*np.unravel_index(shown, design.shape), strict=True):
        numbers = [number(float(design.quantity(name)[r, c]), 4) for name in names]
        reach = (number(float(one[r, c]), 3) for one in (low, high))
        rows.append(
            (
                f"{r}, {c}",
                design.region[r, c],
                f"{100 * design.a[r, c]:.2f}",
                f"{100 * design.b[r, c]:.2f}",
                *numbers[:4],
                " to ".join(reach) if np.isfinite(low[r, c]) else "–",
                *numbers[4:],
                design.reason[r, c],
            )
        )
    codes = sorted(set(design.reason[design.reason != ""].tolist()))
    reasons = [
        f"{code}: {REASONS.get(code, 'No target; the cuts are filled in.')}" for code in codes
    ]
    return tag(
        "section",
        tag("h2", "All cells"),
        tag(
            "p",
            f"{len(shown)} of {design.reason.size} cells are listed, those with a reason first; "
            "the design table has them all.",
        )
        if len(shown) < design.reason.size
        else None,
        bullets(reasons) if reasons else None,
        table(
            (
                "Cell", "Region", "a, %", "b, %", "Strain", "Target ν", "Predicted ν", "sd",
                "Reach of ν", "Distance", "MPa", "Reason",
            ),
            rows,
            caption=f"Row and column of the patch; strains and ν in {design.strain_measure} "
            "strain. Reach: from the smallest to the largest ν of any allowed cuts at that strain; "
            "distance: of the target from it. MPa: nominal stress at the target strain.",
            numeric=range(2, 11),
        ),
    )  # fmt: skip
