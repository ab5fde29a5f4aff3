"""The strain of the skin between the two bare poses, as heatmaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.heatmap import heatmap, scale_limit
from kiribench.report.html import Html, tag
from kiribench.report.sections.fit import side_words
from kiribench.report.subject import SubjectReport
from kiribench.report.svg import figure_block
from kiribench.report.words import count, listing, number
from kiribench.strain.result import REASONS, StrainField

LETTERS = {
    "node-missing": "m",
    "cell-degenerate": "d",
    "strain-too-small": "s",
}
POISSON_CEILING = 1.0
MEASURE = {"log": "logarithmic", "engineering": "engineering", "green": "Green-Lagrange"}


def skin_section(subject: SubjectReport, strain: StrainField) -> Html:
    """Longitudinal and lateral strain, Poisson's ratio and shear, each as a map."""
    measure = MEASURE[strain.strain_measure]
    along, across = strain.longitudinal_strain.value, strain.lateral_strain.value
    shared = scale_limit(along, across)
    patch = _patch(subject, strain)
    maps = (
        (
            "longitudinal",
            along,
            shared,
            f"longitudinal strain ({measure})",
            strain.reason,
            "Longitudinal strain: brown is longer at flexion, blue is shorter. "
            f"Mean {number(_mean(along), 3)}, from {_range(along)}.",
        ),
        (
            "lateral",
            across,
            shared,
            f"lateral strain ({measure})",
            strain.reason,
            "Lateral strain, on the same colour scale as the longitudinal one. "
            f"Mean {number(_mean(across), 3)}, from {_range(across)}.",
        ),
        (
            "poisson",
            strain.poisson_ratio.value,
            scale_limit(strain.poisson_ratio.value, ceiling=POISSON_CEILING),
            f"Poisson's ratio ν ({measure} strains)",
            strain.poisson_reason,
            "Poisson's ratio ν = −lateral / longitudinal strain: blue (negative) widens while it "
            "lengthens. "
            f"Median {number(_median(strain.poisson_ratio.value))}. Not given where the "
            f"longitudinal strain is below {strain.min_strain:g}. "
            f"{_beyond(strain.poisson_ratio.value, POISSON_CEILING)}",
        ),
        (
            "shear",
            strain.shear.value,
            scale_limit(strain.shear.value),
            "shear (tangent of the angle)",
            strain.reason,
            "Shear: by how much the right angle between the two directions closes (brown) or "
            "opens (blue). The paper's method does not measure it.",
        ),
    )
    figures = [
        figure_block(
            heatmap(
                values,
                limit=limit,
                label=label,
                mirrored=subject.mirrored,
                name=f"strain-{name}",
                alt=f"Heatmap of {label}, {strain.shape[0]} by {strain.shape[1]} cells, "
                f"from {_range(values)}.",
                reasons=_letters(reason),
                doubtful=np.asarray(reason == "interval-unbounded"),
                patch=patch,
            ),
            caption,
        )
        for name, values, limit, label, reason, caption in maps
    ]
    return tag(
        "section",
        tag("h2", "How the skin deforms"),
        tag(
            "p",
            f"From {pose(strain.reference_pose)} to {pose(strain.deformed_pose)}, cell by cell of "
            "the drawn grid. ",
            "The frame is the patch's place. " if patch else "",
            "Dotted frames mark the smallest and the largest value. ",
            _masked(strain),
            " ",
            side_words(subject),
        ),
        tag("div", figures, class_="two"),
        id="skin",
    )


def pose(acquisition: str) -> str:
    """``flex090`` -> ``90° flexion``; other names as they are."""
    digits = acquisition.removeprefix("flex")
    return f"{int(digits)}° flexion" if digits.isdigit() else acquisition


def _patch(subject: SubjectReport, strain: StrainField) -> tuple[int, int, int, int] | None:
    if subject.conformability is None:
        return None
    row, column = subject.layout.patch_offset
    rows, columns = subject.layout.patch.rows, subject.layout.patch.columns
    if row + rows > strain.shape[0] or column + columns > strain.shape[1]:
        return None
    return row, column, rows, columns


def _letters(reason: NDArray[np.str_]) -> dict[tuple[int, int], str]:
    return {
        (int(r), int(c)): LETTERS.get(str(reason[r, c]), "?") for r, c in np.argwhere(reason != "")
    }


def _masked(strain: StrainField) -> str:
    reason = strain.poisson_reason
    unbounded = int((reason == "interval-unbounded").sum())
    star = (
        f" An asterisk marks {count(unbounded, 'value')} of ν without a finite 95 % interval."
        if unbounded
        else ""
    )
    codes = [str(code) for code in np.unique(reason) if code not in ("", "interval-unbounded")]
    if not codes:
        return "No cell is masked." + star
    parts = [
        f"{LETTERS.get(code, '?')} = {REASONS.get(code, code).rstrip('.').lower()} "
        f"({count(int((reason == code).sum()), 'cell')})"
        for code in codes
    ]
    return f"Hatched cells are masked: {listing(parts)}.{star}"


def _range(values: NDArray[np.float64]) -> str:
    if np.all(np.isnan(values)):
        return "none measured"
    return f"{number(float(np.nanmin(values)))} to {number(float(np.nanmax(values)))}"


def _beyond(values: NDArray[np.float64], limit: float) -> str:
    number_beyond = int((np.abs(values) > limit).sum())
    if not number_beyond:
        return ""
    return f"Beyond ±{limit:g} ({count(number_beyond, 'cell')}) the colour stays at its end."


def _mean(values: NDArray[np.float64]) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")


def _median(values: NDArray[np.float64]) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else float("nan")
