"""One self-contained HTML file of a design space: figures, failures, cost and settings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.design_space import curves_figure, scatter_figure, slices_figure
from kiribench.report.figures.design_space_sheets import sheets_figure
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.svg import figure_block
from kiribench.schema.design_space import DesignSpace, read_design_space, read_frame

FloatArray = NDArray[np.float64]

SLICES_MM = (10.0, 50.0, 120.0, 250.0)
"""The paper's slices."""
SHOWN = ("35-85", "90-90", "50-50", "95-5", "5-95", "1-1")
"""Designs whose curves are drawn where they are in the table; else its first ones."""
DEFORMED = ("35-85", "90-90")
"""The paper's two examples, drawn deformed."""
DEFORMED_MM = (0.0, 50.0, 120.0, 200.0)


def write_design_space_report(path: Path, design_space: Path) -> Path:
    """Write the page of a table of :mod:`kiribench.fem.campaign`.

    Args:
        path: the HTML file.
        design_space: the Parquet table; its sidecar stands beside it.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(design_space_page(design_space), encoding="utf-8", newline="\n")
    return path


def design_space_page(design_space: Path) -> str:
    """The whole HTML document; the same table gives the same text."""
    frame = read_frame(design_space)
    good = bool((frame["status"] == "ok").any())
    space = read_design_space(design_space) if good else None
    sections = [_head(design_space, space)]
    if space is not None:
        step = frame["step"].to_numpy()[space.table_row - 1]
        displacement = frame["displacement_mm"].to_numpy(dtype=np.float64)[space.table_row - 1]
        sections += [_space(space), _slices(space, step, displacement), _curves(space)]
        if space.sidecar.get("Model") == "sheet":
            sections.append(_sheets(space))
        sections.append(_record(space.sidecar))
    return document("kiribench: design space", text([tag("main", sections)]))


def _head(path: Path, space: DesignSpace | None) -> Html:
    if space is None:
        return tag("header", tag("h1", "Design space"), tag("p", f"{path.name}: no row is ok."))
    sidecar = space.sidecar
    incomplete = sidecar.get("Incomplete", {})
    overlap = sidecar.get("FacesOverlap", {}).get("Designs", [])
    error = sidecar.get("MeshErrorPoisson", {}).get("Largest")
    number = len(space.design_names)
    verdict = (
        "Every design reached its last step."
        if not incomplete
        else f"{len(incomplete)} of {number} designs did not reach their last step."
    )
    notes = [
        f"Poisson's ratio (log strain) from {space.poisson_ratio.min():.3f} to "
        f"{space.poisson_ratio.max():.3f}; longitudinal strain up to "
        f"{space.longitudinal_strain.max():.3f}.",
        None if error is None else f"Estimated mesh error of Poisson's ratio: at most {error:.4f}.",
        f"Crack faces interpenetrate by more than 0.1 mm in {len(overlap)} designs: contact is "
        "not modelled."
        if overlap
        else None,
        *(f"{name}: {reason}." for name, reason in list(incomplete.items())[:20]),
    ]
    return tag(
        "header",
        tag("p", "Design space", class_="kicker"),
        tag(
            "h1",
            f"{number} designs, {len(space.poisson_ratio)} states, "
            f"{sidecar.get('Model', 'unknown')} model",
        ),
        tag("p", verdict, class_="verdict"),
        bullets([note for note in notes if note]),
    )


def _space(space: DesignSpace) -> Html:
    return tag(
        "section",
        tag("h2", "Strain, cuts and Poisson's ratio"),
        figure_block(
            scatter_figure(
                space.longitudinal_strain, space.a_percent, space.b_percent, space.poisson_ratio
            ),
            "Each point is one design at one load step. a: cuts across the pull, b: cuts along "
            "it, percent of the cell. Blue widens when it is pulled, brown narrows.",
        ),
    )


def _slices(space: DesignSpace, step: FloatArray, displacement: FloatArray) -> Html:
    sheet = space.sidecar.get("Model") == "sheet"
    there = np.unique(displacement if sheet else step)
    wanted: Sequence[float] = SLICES_MM if sheet else (1, 5, 12, 25)
    used = sorted({float(there[np.abs(there - value).argmin()]) for value in wanted})
    parts = []
    for value in used:
        rows = (displacement if sheet else step) == value
        title = f"U = {value:g} mm"
        if not sheet and space.longitudinal_stretch is not None:
            title = f"stretch {space.longitudinal_stretch[rows].mean():.3f}"
        parts.append(
            (title, space.a_percent[rows], space.b_percent[rows], space.poisson_ratio[rows])
        )
    return tag(
        "section",
        tag("h2", "Slices"),
        figure_block(
            slices_figure(parts),
            "Poisson's ratio (log) of each design at one load; the line is ν = 0. Hatched: no "
            "answer, or not asked for."
            + (" At one displacement the strain differs from design to design." if sheet else ""),
        ),
    )


def _curves(space: DesignSpace) -> Html:
    names = [name for name in SHOWN if name in space.design_names] or list(space.design_names[:6])
    curves = []
    for name in names:
        rows = space.design == space.design_names.index(name)
        curves.append((name, space.longitudinal_strain[rows], space.poisson_ratio[rows]))
    return tag(
        "section",
        tag("h2", "Poisson's ratio while pulled"),
        figure_block(
            curves_figure(curves), "One line a design, named a-b in percent. Both strains are log."
        ),
    )


def _sheets(space: DesignSpace) -> Html:
    from kiribench.fem.shapes import sheet_shapes

    names = [name for name in DEFORMED if name in space.design_names] or [space.design_names[0]]
    blocks: list[Html] = []
    for name in names:
        row = int(np.flatnonzero(space.design == space.design_names.index(name))[0])
        a, b = float(space.a_percent[row]), float(space.b_percent[row])
        shapes = sheet_shapes(a / 100, b / 100, DEFORMED_MM)
        blocks.append(
            figure_block(
                sheets_figure(shapes, f"a = {a:g} %, b = {b:g} %", name=f"sheet-{len(blocks)}"),
                "The sheet at rest and pulled, to one scale; drawn from a coarse mesh.",
            )
        )
    return tag("section", tag("h2", "Deformed sheets"), blocks)


def _record(sidecar: dict[str, Any]) -> Html:
    cost = sidecar.get("Cost", {})
    rows: list[tuple[str, str]] = [
        (str(name), _shown(sidecar[name]))
        for name in ("Model", "Steps", "Specimen", "Mesh", "Material", "SoftwareVersion")
        if name in sidecar
    ]
    rows += [(f"Cost, {name}", _shown(value)) for name, value in cost.items()]
    return tag(
        "section",
        tag("h2", "Settings and cost"),
        table(("What", "Value"), rows, caption="As in the JSON beside the table"),
    )


def _shown(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_shown(part)}" for key, part in value.items())
    if isinstance(value, list):
        return ", ".join(_shown(part) for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
