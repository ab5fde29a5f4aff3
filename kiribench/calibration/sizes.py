"""Sizes of the sample: from the lines before the table, and from the call."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from kiribench.calibration.curve import Sample
from kiribench.errors import TableError

_SIZES = (
    (r"\bthickness\b", "thickness_mm"),
    (r"\bwidth\b", "width_mm"),
    (r"\b(gauge |gage )?length\b", "length_mm"),
)
_LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_AREAS = {"mm2": 1.0, "cm2": 100.0}


def stated_sizes(header: tuple[tuple[str, str], ...], path: Path) -> Sample:
    """Sizes that the lines before the table state."""
    found: dict[str, float] = {}
    area = None
    for key, value in header:
        match = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*:?", key)
        if match is None:
            continue
        name, unit = match[1].lower(), match[2].lower().replace("^", "").replace("²", "2")
        try:
            number = float(value.replace(",", "."))
        except ValueError:
            continue
        if re.search(r"cross.?section|\barea\b", name) and unit in _AREAS:
            area = number * _AREAS[unit]
        for word, size in _SIZES:
            if re.search(word, name) and unit in _LENGTHS and number > 0:
                found.setdefault(size, number * _LENGTHS[unit])
    sample = Sample(**found)
    product = sample.area_mm2
    if area is not None and product is not None and abs(area - product) > 0.02 * area:
        raise TableError(
            "curve-sample-conflict",
            "The cross-section that the file states is not its width times its thickness.",
            remedy="Correct the lines before the table.",
            file=path,
            got=f"{area:g} mm2",
            expected=f"{product:g} mm2",
        )
    return sample


def merged_sizes(stated: Sample, given: Sample | None, path: Path) -> Sample:
    """The sizes of the file and of the call; they may not contradict each other."""
    given = given or Sample()
    result = {}
    for name in ("length_mm", "width_mm", "thickness_mm"):
        here, there = getattr(given, name), getattr(stated, name)
        if here is not None and not (np.isfinite(here) and here > 0):
            raise TableError(
                "curve-sample-size",
                f"The sample's {name.removesuffix('_mm')} is not a positive length.",
                remedy="Give it in mm.",
                got=here,
            )
        if here is not None and there is not None and abs(here - there) > 1e-9 * there:
            raise TableError(
                "curve-sample-conflict",
                f"The file states another {name.removesuffix('_mm')} of the sample.",
                remedy="Leave the option out, or correct the file.",
                file=path,
                got=f"{here:g} mm",
                expected=f"{there:g} mm",
            )
        result[name] = there if here is None else here
    return Sample(**result)
