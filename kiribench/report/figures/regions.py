"""The regional map: the share of cells that fit at least fairly, region by region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from kiribench.report.figures.cellmap import Sheet
from kiribench.report.html import Html
from kiribench.report.palette import INK, MASKED, SEQUENTIAL, ink_on
from kiribench.report.svg import drawing, inline_svg


def region_map(
    regions: Sequence[Sequence[str]],
    ratios: Mapping[str, tuple[int, int]],
    *,
    mirrored: bool,
    name: str = "regions",
    alt: str,
) -> Html:
    """The map of regions, each with its satisfactory cells and their share.

    Args:
        regions: R x C region labels.
        ratios: label -> (satisfactory cells, scored cells).
        mirrored: lateral at the right (a left leg seen from the front).
        name, alt: see :func:`kiribench.report.svg.inline_svg`.
    """
    from matplotlib.colors import LinearSegmentedColormap

    rows, columns = len(regions), len(regions[0])
    scale = LinearSegmentedColormap.from_list("share", SEQUENTIAL)
    with drawing():
        sheet = Sheet(rows, columns, cell_px=48.0, mirrored=mirrored)
        figure, axes = sheet.open()
        inks: dict[str, str] = {}
        for row in range(rows):
            for column in range(columns):
                label = regions[row][column]
                good, scored = ratios.get(label, (0, 0))
                if scored:
                    fill = scale(good / scored)[:3]
                    inks[label] = ink_on(fill)
                    sheet.box(axes, row, column, facecolor=fill, edgecolor=fill)
                else:
                    inks[label] = INK
                    sheet.box(axes, row, column, facecolor=MASKED, edgecolor="#ffffff")
        sheet.borders(axes, regions, width=2.2)
        for label, (row_, column_) in label_places(regions).items():
            good, scored = ratios.get(label, (0, 0))
            share = (
                f"{100 * good / scored:.1f} %".replace(".0 %", " %") if scored else "none scored"
            )
            ink = inks[label]
            shown = label if len(label) <= 6 else label[:5] + "…"
            sheet.write(
                axes, row_, column_, shown, dy_px=-17, fontsize=16, weight="bold", color=ink
            )
            sheet.write(axes, row_, column_, share, dy_px=4, fontsize=13, color=ink)
            sheet.write(
                axes, row_, column_, f"{good} of {scored}", dy_px=21, fontsize=10, color=ink
            )
        return inline_svg(figure, name, alt)


def label_places(regions: Sequence[Sequence[str]]) -> dict[str, tuple[float, float]]:
    """Where each region's name goes: the middle of its largest connected part.

    Args:
        regions: R x C region labels.

    Returns:
        label -> (row, column) of the cell that the label is centred on, in halves of cells;
        always within the region.
    """
    rows, columns = len(regions), len(regions[0])
    best: dict[str, list[tuple[int, int]]] = {}
    seen: set[tuple[int, int]] = set()
    for start in ((r, c) for r in range(rows) for c in range(columns)):
        if start in seen:
            continue
        label = regions[start[0]][start[1]]
        part, stack = [], [start]
        seen.add(start)
        while stack:
            row, column = stack.pop()
            part.append((row, column))
            for near in (
                (row + 1, column),
                (row - 1, column),
                (row, column + 1),
                (row, column - 1),
            ):
                if (
                    0 <= near[0] < rows
                    and 0 <= near[1] < columns
                    and near not in seen
                    and regions[near[0]][near[1]] == label
                ):
                    seen.add(near)
                    stack.append(near)
        if len(part) > len(best.get(label, [])):
            best[label] = part
    return {label: _middle(part) for label, part in best.items()}


def _middle(part: Sequence[tuple[int, int]]) -> tuple[float, float]:
    row = sum(r for r, _ in part) / len(part)
    column = sum(c for _, c in part) / len(part)
    around = {(int(row), int(column)), (int(row + 0.5), int(column + 0.5))}
    if around <= set(part):
        return row, column
    return min(part, key=lambda cell: (cell[0] - row) ** 2 + (cell[1] - column) ** 2)
