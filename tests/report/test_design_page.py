"""The page of a design: the numbers in its drawings are the design's."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from design_toys import drawn_problem, surrogates

from kiribench.design.cells import cells_of
from kiribench.design.limits import Limits
from kiribench.design.methods import design_patch
from kiribench.design.mixing import mixed_up
from kiribench.design.options import DesignOptions
from kiribench.design.result import Designed, OnSkin
from kiribench.lattice import CutMap
from kiribench.report.design_page import design_page
from kiribench.report.palette import ACCENT, INK, PATCH

FloatArray = np.ndarray

#: Half a hundredth of a pixel is what the drawings are rounded to.
PIXEL = 0.02


@cache
def made(method: str = "exact", side: str = "right") -> tuple[Designed, str]:
    """A patch of 4 x 3 cells, one of them without and one with an unreachable target."""
    asked, _ = drawn_problem(1, 4, 3)
    nu = asked.poisson_ratio.copy()
    nu[3, 2], nu[0, 1] = np.nan, 0.9
    reason = np.where(np.isnan(nu), "node-missing", "")
    asked = replace(asked, poisson_ratio=nu, reason=reason, side=side)
    options = DesignOptions(max_generations=30, curves=True)
    result = design_patch(method, asked, surrogates(), Limits(), options)
    return result, design_page(result, surrogates())


def picture(page: str, words: str) -> str:
    """The one drawing whose description holds ``words``."""
    drawings = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    found = [one for one in drawings if words in re.search(r'aria-label="([^"]*)"', one)[1]]
    assert len(found) == 1
    return found[0]


def boxes(svg: str) -> list[tuple[float, float, float, float]]:
    """Left, bottom, right and top of every set of axes, px."""
    found = re.findall(r'<path d="([^"]*)" style="fill: #ffffff"', svg)
    corners = [points(one) for one in found]
    return [(*c.min(axis=0), *c.max(axis=0)) for c in corners]


def points(path: str) -> FloatArray:
    return np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path), dtype=float)


def marks(svg: str, colour: str) -> FloatArray:
    """(n, 2) places of the markers of a colour, px."""
    uses = re.findall(rf'<use [^>]*x="([\d.]+)" y="([\d.]+)"[^>]*fill: {colour}[ ;"]', svg)
    return np.array(uses, dtype=float).reshape(-1, 2)


def lines(svg: str, colour: str) -> list[FloatArray]:
    """The lines of a colour, px, without the axes' own."""
    found = re.findall(
        rf'<path d="([^"]*)" clip-path="[^"]*" style="fill: none; stroke: {colour}[;"]', svg
    )
    return [points(one) for one in found]


def in_axes(places: FloatArray, box: tuple[float, ...], high: float) -> FloatArray:
    """Pixels to a and b on axes that both run from 0 to ``high``."""
    left, top, right, bottom = box
    x = (places[:, 0] - left) / (right - left)
    y = (bottom - places[:, 1]) / (bottom - top)
    return high * np.column_stack([x, y])


def straight(pixels: FloatArray, values: FloatArray, sense: int) -> tuple[float, float]:
    """Slope and offset of the map from values to pixels; fails where there is none."""
    slope, offset = np.polyfit(values, pixels, 1)
    assert sense * slope > 0
    np.testing.assert_allclose(slope * values + offset, pixels, atol=PIXEL)
    return slope, offset


def test_stars_are_the_targets_and_lines_the_surrogates() -> None:
    result, page = made()
    svg = picture(page, "targets over the curves")
    cells = cells_of(result.problem, surrogates(), result.limits, result.options)
    strain = result.problem.longitudinal_strain.ravel()[cells.place]
    out = result.design.quantity("distance").ravel()[cells.place] > 1e-6
    assert out.sum() == 1
    stars = marks(svg, PATCH)[: int((~out).sum())]
    kx, x0 = straight(stars[:, 0], strain[~out], 1)
    ky, y0 = straight(stars[:, 1], cells.target[~out], -1)
    # The hollow star of the target out of reach, of an area of 90 square pixels.
    (hollow,) = lines(svg, INK)
    top = hollow[np.argmin(hollow[:, 1])]
    assert top[0] == pytest.approx(kx * strain[out][0] + x0, abs=PIXEL)
    assert top[1] + np.sqrt(90) / 2 == pytest.approx(ky * 0.9 + y0, abs=PIXEL)
    curves = lines(svg, "#9aa9b5")
    lengths = np.array([0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9]) * 100
    assert len(curves) == 64
    for k in (0, 21, 63):
        a, b = lengths[k // 8], lengths[k % 8]
        at = (curves[k][:, 0] - x0) / kx
        seen = (at > 0.05) & (at < 0.6)
        count = int(seen.sum())
        nu = surrogates().poisson.predict(np.full(count, a), np.full(count, b), at[seen]).mean
        # Lines are thinned to a ninth of a pixel.
        np.testing.assert_allclose(ky * nu + y0, curves[k][seen, 1], atol=0.2)


def test_equivalent_designs_have_the_targets_ratio_and_the_star_is_the_design() -> None:
    result, page = made()
    svg = picture(page, "Curves of equivalent designs")
    titles = re.findall(r"cell \((\d+), (\d+)\): ν (−?[\d.]+) at strain ([\d.]+)", svg)
    named = list(dict.fromkeys(titles))
    assert len(named) == 3 == len(boxes(svg))
    order = np.sort(result.problem.poisson_ratio[np.isfinite(result.problem.poisson_ratio)])
    told = [float(nu.replace("−", "-")) for _, _, nu, _ in named]
    assert told == pytest.approx([order[0], order[len(order) // 2], order[-1]], abs=6e-4)
    stars, curves = marks(svg, PATCH), lines(svg, INK)
    drawn = 0
    for k, (row, column, _, strain) in enumerate(named):
        cell = int(row), int(column)
        box = boxes(svg)[k]
        own = [s for s in stars if box[0] - 1 <= s[0] <= box[2] + 1]
        assert len(own) == 1
        a, b = in_axes(np.array(own), box, 90.0)[0]
        assert a == pytest.approx(100 * result.design.a[cell], abs=0.02)
        assert b == pytest.approx(100 * result.design.b[cell], abs=0.02)
        for curve in curves:
            if not (box[0] - 1 <= curve[:, 0].min() and curve[:, 0].max() <= box[2] + 1):
                continue
            places = in_axes(curve, box, 90.0)
            at = np.full(len(places), result.problem.longitudinal_strain[cell])
            assert at[0] == pytest.approx(float(strain), abs=6e-4)
            nu = surrogates().poisson.predict(places[:, 0], places[:, 1], at).mean
            np.testing.assert_allclose(nu, result.problem.poisson_ratio[cell], atol=2e-3)
            drawn += 1
    # The largest target is out of reach: no design has it.
    assert drawn >= 2 and "as near to it as the method and the limits allow" in page


def test_generations_are_what_was_tried() -> None:
    result, page = made("paper")
    svg = picture(page, "CMA-ES over")
    course = result.generations
    assert course is not None
    left, right = boxes(svg)
    title = re.search(r"cell \((\d+), (\d+)\), ν", svg)
    cell = int(title[1]), int(title[2])
    cells = cells_of(result.problem, surrogates(), result.limits, result.options)
    k = cells.place.tolist().index(cell[0] * 3 + cell[1])
    population = course.population[:, k]
    count = int(np.isfinite(population[:, 0, 0]).sum())
    # The first generation, in ink: the legend's own mark comes after the points.
    places = marks(svg, INK)[: population.shape[1]]
    np.testing.assert_allclose(in_axes(places, left, 90.0), 100 * population[0], atol=0.02)
    assert f"generation {count}" in svg
    # The objective falls, and the bold line is the median of all cells.
    bold = next(one for one in lines(svg, PATCH) if len(one) > 3)
    best = np.log(np.median(course.best, axis=1))
    inside = (bold[:, 0] >= right[0]) & (bold[:, 0] <= right[2])
    assert inside.all()
    steps = (bold[:, 0] - bold[0, 0]) / (bold[-1, 0] - bold[0, 0]) * (len(best) - 1)
    straight(bold[:, 1], np.interp(steps, np.arange(len(best)), best), -1)
    assert "Generations of CMA-ES" not in made()[1]


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_cut_map_and_the_lattice_are_the_designs(side: str) -> None:
    result, page = made(side=side)
    design = result.design
    for name, values in (("a, %", design.a), ("b, %", design.b)):
        svg = picture(page, f"{name}: ")
        numbers = re.findall(r">\s*(\d+)(\*?)</text>", svg)
        # Beside the cells stand the numbers of rows and columns, without asterisk.
        told = [(int(n), bool(star)) for n, star in numbers]
        wanted = [
            (round(100 * v), why != "")
            for v, why in zip(values.ravel(), design.reason.ravel(), strict=True)
        ]
        assert sorted(told) == sorted([*wanted, *((k, False) for k in (0, 1, 2, 3, 0, 1, 2))])
    svg = picture(page, "cuts on 45 x 60 mm")
    path = re.search(r'<path d="([^"]*)"', svg)[1]
    drawn = np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path), float).reshape(-1, 2, 2)
    cuts = CutMap(design.a, design.b, design.cell_mm).half_cuts().cuts()
    start = cuts.start_mm.copy()
    if side == "left":
        start[:, 0] = 45.0 - start[:, 0]
    np.testing.assert_allclose(drawn[:, 0], start, atol=0.006)
    lengths = np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)
    np.testing.assert_allclose(lengths, cuts.length_mm, atol=0.011)


def test_mixing_of_measures_is_drawn_and_told_as_computed() -> None:
    result, page = made()
    cells = cells_of(result.problem, surrogates(), result.limits, result.options)
    mixed = mixed_up(cells)
    place = cells.place
    svg = picture(page, "strain measures are mixed")
    count = len(cells)
    wrong, right = marks(svg, PATCH), marks(svg, ACCENT)
    # On each side the points, then the legend's mark on the left.
    straight(wrong[:count, 0], mixed.a.ravel()[place], 1)
    straight(wrong[:count, 1], mixed.b.ravel()[place], -1)
    straight(right[:count, 0], mixed.right_a.ravel()[place], 1)
    ky, y0 = straight(wrong[-count:, 1], mixed.error.ravel()[place], -1)
    np.testing.assert_allclose(
        ky * mixed.right_error.ravel()[place] + y0, right[-count:, 1], atol=PIXEL
    )
    moved = 100 * np.hypot(mixed.a - mixed.right_a, mixed.b - mixed.right_b).ravel()[place]
    rms = float(np.sqrt(np.nanmean(mixed.error**2)))
    page = page.replace("\u00a0", " ")
    assert f"{np.median(moved):.1f} % of the cell edge" in page
    assert f"misses by {rms:.3f} rms" in page
    assert rms > float(np.sqrt(np.nanmean(mixed.right_error**2)))


def test_the_table_and_the_map_of_errors() -> None:
    result, page = made()
    design = result.design
    rows = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)[1:]
    assert len(rows) == 12
    for row, (r, c) in zip(rows, np.ndindex(4, 3), strict=True):
        cells = [
            html.unescape(re.sub("<.*?>", "", x)) for x in re.findall("<t[hd].*?</t[hd]>", row)
        ]
        assert cells[0] == f"{r}, {c}"
        assert float(cells[2]) == pytest.approx(100 * design.a[r, c], abs=0.006)
        nu = design.quantity("predicted_poisson_ratio")[r, c]
        told = cells[6].replace("−", "-")
        assert (told == "–") if np.isnan(nu) else float(told) == pytest.approx(nu, abs=6e-5)
        assert cells[-1] == design.reason[r, c]
    # One target is out of reach: the largest error is drawn, and the missing one has a letter.
    svg = picture(page, "Error of Poisson")
    worst = f"{result.error[0, 1]:.2f}".replace("-0.", "−.")
    assert f">{worst}<" in re.sub(r"\s", "", svg) and ">N<" in re.sub(r"\s", "", svg)
    assert page.count("Hatched") == 1


def test_a_design_on_the_skin_leads_with_its_own_aim() -> None:
    result, _ = made()
    skin = OnSkin(16, True, "balanced", 2.02, 0.56, 1.63, 0.978, 0.904, 72, 72)
    page = design_page(replace(result, on_skin=skin), surrogates())
    verdict = re.search(r'class="verdict">(.*?)</p>', page)[1]
    assert "0.56 mm (rms)" in verdict and "72 of 72 good" in verdict
    assert "surrogate" not in verdict and "targets are met" not in page
    assert "Neither is an aim of this method" in page
    assert "for the corners of the worn patch" in page


def test_a_patch_of_hundreds_of_cells_has_maps_without_numbers_and_says_what_it_leaves_out() -> (
    None
):
    asked = drawn_problem(2, 25, 25)[0]
    nu = asked.poisson_ratio.copy()
    nu[24, 24] = np.nan
    asked = replace(asked, poisson_ratio=nu, reason=np.where(np.isnan(nu), "node-missing", ""))
    nu[3, 3] = 0.9
    asked = replace(asked, poisson_ratio=nu)
    result = design_patch("exact", asked, surrogates(), Limits(), DesignOptions(curves=True))
    page = design_page(result, surrogates())
    assert len(result.curves) == 3 and "Equivalent designs" in page
    assert page.count("<image") >= 4 and len(page) < 1_500_000
    assert "600 of 624 targets are shown" in page and "600 of 624 cells are shown" in page
    assert "600 of 625 cells are listed" in page
    table = page[page.index("are listed") :]
    assert len(re.findall(r'<th scope="row"', table)) == 600
    assert "24, 24" in table and "3, 3<" in table  # they have a reason
