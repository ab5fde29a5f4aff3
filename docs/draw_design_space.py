"""Draws the pictures of design-space.md from the shipped table of sheets.

Run as a script: ``python docs/draw_design_space.py``. The same table gives the same pictures.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kiribench.fem.shapes import sheet_shapes
from kiribench.report.design_space_page import DEFORMED_MM, SHOWN, SLICES_MM
from kiribench.report.figures.design_space import curves_figure, scatter_figure, slices_figure
from kiribench.report.figures.design_space_sheets import sheet_animation, sheets_figure
from kiribench.report.html import Html
from kiribench.schema.design_space import read_design_space, read_frame

HERE = Path(__file__).parent
TABLE = HERE.parent / "data" / "synthetic" / "design_space" / "sheet.parquet"
MOVING_MM = tuple(float(at) for at in range(0, 201, 10))


def write(name: str, drawing: Html) -> None:
    """One SVG file with a white ground, readable on a dark page too."""
    start, end, rest = str(drawing).partition(">")
    ground = '<rect width="100%" height="100%" fill="#ffffff"/>'
    (HERE / name).write_text(start + end + ground + rest + "\n", encoding="utf-8", newline="\n")


def main() -> None:
    """All of them."""
    space = read_design_space(TABLE)
    frame = read_frame(TABLE)
    displacement = frame["displacement_mm"].to_numpy(dtype=np.float64)[space.table_row - 1]
    write(
        "design-space.svg",
        scatter_figure(
            space.longitudinal_strain, space.a_percent, space.b_percent, space.poisson_ratio
        ),
    )
    slices = []
    for at in SLICES_MM:
        rows = displacement == at
        slices.append(
            (
                f"U = {at:g} mm",
                space.a_percent[rows],
                space.b_percent[rows],
                space.poisson_ratio[rows],
            )
        )
    write("design-space-slices.svg", slices_figure(slices))
    curves = []
    for name in SHOWN:
        rows = space.design == space.design_names.index(name)
        curves.append((name, space.longitudinal_strain[rows], space.poisson_ratio[rows]))
    write("design-space-curves.svg", curves_figure(curves))
    for a, b in ((35, 85), (90, 90)):
        shapes = sheet_shapes(a / 100, b / 100, DEFORMED_MM)
        title = f"a = {a} %, b = {b} %"
        write(f"sheet-{a}-{b}.svg", sheets_figure(shapes, title, name=f"sheet-{a}-{b}"))
    shapes = sheet_shapes(0.9, 0.9, MOVING_MM)
    (HERE / "sheet-90-90.gif").write_bytes(sheet_animation(shapes, "a = b = 90 %", width_px=200))


if __name__ == "__main__":
    main()
